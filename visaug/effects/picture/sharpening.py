"""Sharpening."""

from visaug.effects.effect import Spreading, Stage
from visaug.effects.optics.spread import gaussian_blur
from visaug.effects.parameter import Parameter, Strength


class Sharpening(Spreading):
    """An unsharp mask: the difference from a Gaussian blur is added.

    The noise of single pixels grows by about 1 + amount and becomes negatively correlated with the surrounding pixels.
    """

    name = "sharpening"
    stage = Stage.PICTURE
    order = 20
    aliases = ("unsharp mask", "halo", "edge enhancement")
    summary = "An unsharp mask amplifies edges and noise."
    equation = "y <- clip(y + amount (y - y * G), 0, 1), G a Gaussian of standard deviation radius, integrated over each pixel"
    source = "A. Polesel et al., IEEE Trans. Image Processing 9 (2000) 505, linear unsharp masking"
    separates = """image a slanted edge: the response overshoots on both sides; the noise of a flat decreases
    towards low frequencies"""
    amount = Strength(0.5, "1", 0.0, 10.0, "cameras and editors: 0.3 to 1.5", trials=(0.3, 1.0))
    radius_px = Parameter(1.0, "px", 0.2, 50.0, "standard deviation of the blur: 0.5 to 2 px", trials=(2.0,))

    def apply(self, signal, p, stream, context):
        return (signal + p.amount * (signal - gaussian_blur(signal, p.radius_px, p.radius_px))).clamp(0, 1)
