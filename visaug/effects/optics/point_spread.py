"""Point spread of the optics."""

from visaug.effects.effect import Parameter, Spreading, Stage, Strength
from visaug.effects.optics.spread import gaussian_blur


class PointSpread(Spreading):
    """A Gaussian blur of the mean light, integrated over pixels. Shot noise is added afterwards, so noise stays white."""

    name = "point_spread"
    stage = Stage.OPTICS
    order = 40
    aliases = ("PSF", "MTF", "blur")
    summary = "The optics blur the image before the pixels sample it."
    equation = """mu_p convolved with a Gaussian of standard deviation sigma along rows, aspect sigma along
    columns, integrated over each pixel"""
    source = "B. Zhang et al., Applied Optics 46 (2007) 1819, on the Gaussian as the image of a point"
    separates = """compare the noise of neighbouring pixels in flats: crosstalk correlates it, point spread does not"""
    # trials: its shifts grow a thousandfold from 0.1 to 0.6 px
    sigma_px = Strength(
        0.7, "px", 0.0, 50.0, "an f/2.8 lens on 3 um pixels: 0.3 to 1 px", trials=(0.2, 0.6, 1.2)
    )
    aspect = Parameter(1.0, "1", 0.2, 5.0, "vertical to horizontal width; 1: round")

    def apply(self, signal, p, stream, context):
        return gaussian_blur(signal, p.sigma_px * p.aspect, p.sigma_px)
