"""Smear."""

from visaug.effects.effect import Effect, Stage, Strength, choice


class Smear(Effect):
    """While a column is transferred, each of its charge packets passes the light of other rows.

    With passes `both`, a transfer before the exposure counts too, so every pixel passes all rows and the smear is the mean
    of the column at any distance. With `below` or `above`, one transfer counts, and a pixel collects from rows of lower, or
    higher, number only. A crop uses its own rows in place of the whole column.
    """

    name = "smear"
    stage = Stage.GENERATION
    order = 15  # light alone smears: after PRNU, before the dark current
    local = False
    aliases = ("frame-transfer smear", "vertical stripes", "parasitic light")
    summary = "Charge is generated while a column is transferred, at any distance from the light source."
    equation = "mu_e <- mu_e + (transfer_s / exposure_s) mean of mu_e over the column"
    source = "J. Janesick, Scientific Charge-Coupled Devices (SPIE, 2001), on frame-transfer smear"
    separates = """image a bright spot at several exposures: smear does not grow with the exposure, and does
    not require a full well as blooming does"""
    transfer_s = Strength(
        2e-4, "s", 0.0, 1.0, "transfer time of a whole frame: 0.1 to 10 ms", trials=(2e-4, 1e-3)
    )
    passes = choice(("both", "below", "above"), "rows whose light a charge packet passes")

    def apply(self, signal, p, stream, context):
        share = p.transfer_s / context.exposure_s.clamp_min(1e-9)
        if p.passes == "both":
            return signal + share * signal.mean(-2, keepdim=True)
        oriented = signal if p.passes == "below" else signal.flip(-2)
        passed = (oriented.cumsum(-2) - oriented) / signal.shape[-2]
        return signal + share * (passed if p.passes == "below" else passed.flip(-2))
