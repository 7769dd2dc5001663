"""Uneven light of a source."""

from visaug.effects.effect import Noiseless, Stage, Strength


def _coefficient(default: float, source: str) -> Strength:
    """A coefficient of the surface, relative to the mean light."""
    return Strength(default, "fraction", -0.5, 0.5, source, trials=(0.003, 0.02))


class UnevenLight(Noiseless):
    """The light of a lamp or of an integrating sphere varies smoothly over the sensor.

    A surface of second order describes it: a slope and a bend over the rows and over the columns. Flats and scenes are lit
    alike; the mean light of a flat does not change. It belongs to the laboratory and not to the camera: leave it out of a
    camera file for augmentation, unless the scenes are lit so.
    """

    name = "uneven_light"
    stage = Stage.OPTICS
    order = 1
    aliases = ("shading", "illumination", "inhomogeneous illumination", "flat field", "light gradient")
    summary = "The light of the source varies smoothly over the sensor."
    equation = """mu_p <- mu_p (1 + row_slope y + column_slope x + row_bend (y^2 - 1/3) + column_bend (x^2 -
    1/3)), x and y from -1 to 1 over the sensor"""
    source = "EMVA 1288 release 4 Linear, homogeneity of the light source; a Taylor series to second order"
    separates = """turn the camera by 180 degrees in front of the source, or move it: uneven light keeps its
    direction; vignetting, dust and prnu stay where they are on the sensor"""
    row_slope = _coefficient(
        0.01, "half of the change from the first row to the last; EMVA 1288 allows 3 % over the sensor"
    )
    column_slope = _coefficient(0.01, "half of the change from the first column to the last")
    row_bend = _coefficient(0.0, "light of the first and last rows minus that of the middle")
    column_bend = _coefficient(0.0, "light of the first and last columns minus that of the middle")

    def apply(self, signal, p, stream, context):
        height, width = context.resolution
        y = (2 * context.rows(signal) + 1) / height - 1
        x = (2 * context.columns(signal) + 1) / width - 1
        # 1/3 is the mean of a squared coordinate over the sensor.
        bends = p.row_bend * (y**2 - 1 / 3) + p.column_bend * (x**2 - 1 / 3)
        return signal * (1 + p.row_slope * y + p.column_slope * x + bends).clamp_min(0)
