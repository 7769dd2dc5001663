"""Nonlinear response."""

import torch

from visaug.effects.effect import Noiseless, Stage, Strength, choice


class Nonlinearity(Noiseless):
    """The capacitance of the sense node and the gain of its amplifier depend on the voltage, so the response is not linear.

    The curve starts at 0 with slope 1 and follows its tangent beyond full scale. Within the bounds its slope is at least
    0.25, so the response is monotone. With an infinite full well, full scale is the range of the converter.
    """

    name = "nonlinearity"
    stage = Stage.READOUT
    order = 0
    aliases = ("linearity error", "INL", "gamma", "compression")
    summary = "The response is not proportional to the signal."
    equation = "V <- V + S (quadratic x^2 + cubic x^3), x = V / S in [0, 1], S the full scale; linear outside"
    source = """EMVA 1288 release 4 Linear, linearity error; J. Janesick, Photon Transfer (SPIE 2007), nonlinearity"""
    separates = """take flats at several exposures with constant light: the mean is not proportional to the
    exposure while dark frames do not change; blooming and saturation act only near the full well"""
    quadratic = Strength(
        -0.02,
        unit="fraction",
        low=-0.15,
        high=0.15,
        trials=(-0.01, -0.04),
        source="deviation at full scale; EMVA 1288 datasheets state 0.2 to 3 %",
    )
    cubic = Strength(
        0.0,
        unit="fraction",
        low=-0.15,
        high=0.15,
        trials=(-0.01, -0.04),
        source="deviation at full scale; the next term of the curve",
    )
    full_scale = choice(
        ("full_well", "converter"), "signal range to which the curve refers: full well or converter range"
    )

    def apply(self, signal, p, stream, context):
        converter = (context.max_dn - context.black_level_dn) * context.gain_e_per_dn
        well = context.full_well_e
        use_well = torch.isfinite(well) & (p.full_scale == "full_well")
        scale = torch.where(use_well, well, converter)
        share = signal / scale
        x = share.clamp(0, 1)
        beyond = (share - 1).clamp_min(0) * (2 * p.quadratic + 3 * p.cubic)
        return signal + scale * (x * x * (p.quadratic + p.cubic * x) + beyond)
