"""Quantisation of the picture."""

from visaug.effects.effect import Effect, Stage
from visaug.effects.parameter import Parameter
from visaug.effects.straight_through import round_through


class PictureQuantization(Effect):
    """The picture is stored with a small number of bits, as by a file or a link. The converter's own steps are `bit_depth`."""

    name = "picture_quantization"
    stage = Stage.PICTURE
    order = 30
    aliases = ("posterization", "contouring", "colour banding")
    summary = "The picture is stored with a small number of bits."
    equation = "y <- round(y (2^bits - 1)) / (2^bits - 1)"
    source = "B. Widrow and I. Kollar, Quantization Noise (Cambridge 2008)"
    separates = "look at the histogram of the picture: at most 2^bits values occur"
    differentiable = False
    why_not = """the number of bits is an integer; the gradient of the image passes straight through, as for rounding"""
    bits = Parameter(8.0, "bits", 1.0, 16.0, "most pictures: 8", integer=True, trials=(8,))

    def apply(self, signal, p, stream, context):
        top = 2.0 ** p.bits.round() - 1
        return round_through(signal.clamp(0, 1) * top) / top
