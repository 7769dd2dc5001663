"""Black sun."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class BlackSun(Effect):
    """The reset level of a pixel under a very bright source collects light before it is sampled (eclipse).

    Correlated double sampling subtracts that level, so the output of a saturated pixel falls again and the centre of the sun
    becomes dark. Circuits that clamp the reset level prevent it. Requires a camera with a full well.
    """

    name = "black_sun"
    stage = Stage.CHARGE
    order = 77  # what is beyond the full well is still known
    aliases = ("eclipse", "sun spot", "black dot")
    summary = "The centre of a very bright source becomes dark."
    equation = "N <- max(0, min(N, W) - share max(0, N - onset W)), W: full well"
    source = """derived: correlated double sampling subtracts a reset level that has collected `share` of the light;
    principle of the sampling after J. Ohta, Smart CMOS Image Sensors and Applications (CRC Press), chapter 2"""
    separates = "image the sun or a laser at rising intensity: the centre is bright, saturated, then dark; dead pixels are fixed"
    proposed = False  # frames of a laboratory contain no source so far above the full well
    share = Strength(
        0.01,
        unit="fraction",
        high=1.0,
        trials=(0.01, 0.1),
        source="time between reset and its sample relative to the exposure: 1 us to 10 us of 1 ms",
    )
    onset = Parameter(2.0, "full wells", 1.0, 1e6, "charge from which a clamp no longer helps; assumed")

    def apply(self, signal, p, stream, context):
        deepest_e = 1e9  # in place of an unlimited full well
        well = context.full_well_e.clamp_max(deepest_e)
        fallen = torch.minimum(signal, well) - p.share * (signal - p.onset * well).clamp_min(0)
        return torch.where(p.share > 0, fallen.clamp_min(0), signal)
