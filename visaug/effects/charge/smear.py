"""Smear."""

from visaug.effects.effect import Effect, Parameter, Stage


class Smear(Effect):
    """While a column is shifted, each of its packets passes under the light of the others.

    passes `both`: a shift before the exposure counts too, so every pixel passes all rows and the smear is
    the column's mean, whatever the distance. `below` or `above`: one shift counts, and a pixel collects
    from the rows of lower, or higher, number alone. A crop takes its own rows for the column's.
    """

    name = "smear"
    stage = Stage.GENERATION
    order = 15  # light alone smears: after PRNU, before the dark current
    summary = "Light is collected while a column is read, whatever the distance to its source."
    equation = "mu_e <- mu_e + (transfer_s / exposure_s) mean of mu_e over the column"
    source = "J. Janesick, Scientific Charge-Coupled Devices (SPIE, 2001), on frame-transfer smear"
    separates = "a bright spot at several exposures: smear does not grow with them; blooming needs full well"
    transfer_s = Parameter(
        2e-4,
        unit="s",
        high=1.0,
        strength=True,
        trials=(2e-4, 1e-3),
        source="shift of a whole frame: 0.1 to 10 ms",
    )
    passes = Parameter(
        "both", options=("both", "below", "above"), source="rows that a packet passes under light"
    )

    def apply(self, signal, p, stream, context):
        share = p.transfer_s / context.exposure_s.clamp_min(1e-9)
        if p.passes == "both":
            return signal + share * signal.mean(-2, keepdim=True)
        oriented = signal if p.passes == "below" else signal.flip(-2)
        passed = (oriented.cumsum(-2) - oriented) / signal.shape[-2]
        return signal + share * (passed if p.passes == "below" else passed.flip(-2))
