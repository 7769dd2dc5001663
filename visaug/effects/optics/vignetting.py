"""Vignetting."""

from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice


class Vignetting(Effect):
    """Transmission falls from 1 on the axis as a power of the distance in half diagonals of the sensor, or as cos^4.

    The natural law is the fourth power of the cosine of the field angle, whose first term is the power 2; vignetting by the
    lens barrel falls more steeply, with a power of 4 and above. A measured transmission (`map`, a file: a mean flat of a
    uniform source divided by its maximum) replaces the law.
    """

    name = "vignetting"
    stage = Stage.OPTICS
    order = 10
    aliases = ("shading", "lens shading", "corner fall-off", "flat field")
    summary = "Transmission decreases smoothly from the centre of the field to the corners."
    equation = """mu_p <- mu_p max(0, 1 - corner_loss (r / r_corner)^power); cos4: mu_p <- mu_p cos^4 a, tan a
    ~ r, cos^4 a = 1 - corner_loss at r_corner"""
    source = "D. B. Goldman, IEEE TPAMI 32 (2010) 2276; cos^4 law"
    separates = """take flats with the camera rotated in front of the source: vignetting stays fixed on the
    sensor, uneven illumination does not"""
    map_unit = "fraction of the light that passes"
    map_low = 0.0
    corner_loss = Strength(0.2, "fraction", 0.0, 1.0, "loss in the corners: 5 to 60 %", trials=(0.08, 0.3))
    power = Parameter(
        2.0,
        low=1.0,
        high=8.0,
        trials=(2.0, 4.0),
        source="2: a small field; higher: vignetting by the lens barrel",
        of=("power",),
    )
    law = choice(("power", "cos4"), "cos4: natural vignetting, R. Kingslake, Optical System Design (1983)")
    centre_row = Parameter(
        0.0, "fraction", -0.5, 0.5, "vertical offset of the optical axis from the centre", trials=(0.05,)
    )
    centre_column = Parameter(
        0.0, "fraction", -0.5, 0.5, "horizontal offset of the optical axis from the centre", trials=(0.05,)
    )

    def apply(self, signal, p, stream, context):
        if (measured := context.measured_map(self.name, signal)) is not None:
            return signal * measured
        height, width = context.resolution
        y = context.rows(signal) + 0.5 - height * (0.5 + p.centre_row)
        x = context.columns(signal) + 0.5 - width * (0.5 + p.centre_column)
        r2 = (x**2 + y**2) / (height**2 + width**2) * 4 + 1e-12  # never 0: a root of 0 has no gradient
        all_but = 0.999  # of the light that cos^4 can lose, short of 90 degrees
        if p.law == "cos4":
            tangent2 = (1 - p.corner_loss.clamp_max(all_but)) ** -0.5 - 1  # of the field angle in the corner
            return signal * (1 + tangent2 * r2) ** -2
        return signal * (1 - p.corner_loss * r2 ** (p.power / 2)).clamp_min(0)
