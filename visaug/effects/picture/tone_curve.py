"""Tone curve."""

import torch

from visaug.effects.effect import Effect, Stage
from visaug.effects.parameter import Parameter, choice


class ToneCurve(Effect):
    """The values of the picture follow a curve that rises from 0 to 1: a power, the sRGB curve, or a table.

    Pictures that are linear in light become encoded ones. For pictures that are already encoded (`transfer="srgb"`) it is a
    further change of contrast. A table (`map`: a file of 2 or more values from 0 to 1, evenly spaced over the input)
    replaces the law; values between are interpolated.
    """

    name = "tone_curve"
    stage = Stage.PICTURE
    order = 10
    aliases = ("gamma", "contrast")
    summary = "A curve such as gamma changes the contrast of the picture."
    equation = "y <- y^(1 / gamma); srgb: 12.92 y up to 0.0031308, then 1.055 y^(1 / 2.4) - 0.055"
    source = "IEC 61966-2-1 (sRGB); ITU-R BT.709"
    separates = """image a step wedge: values against light follow the curve, and so does the noise against the mean"""
    map_unit = "share of full scale"
    map_low = 0.0
    map_is_table = True
    gamma = Parameter(2.2, "1", 0.1, 10.0, "1: none; 2.2: displays", trials=(1.5, 2.2), of=("gamma",))
    curve = choice(("gamma", "srgb"), "srgb: the curve of nearly all 8-bit pictures")

    def apply(self, signal, p, stream, context):
        signal = signal.clamp(0, 1)
        if (table := context.maps.get(self.name)) is not None:
            return _interpolated(signal, table.flatten().to(signal))
        if p.curve == "srgb":
            bent = 1.055 * signal.clamp_min(0.0031308) ** (1 / 2.4) - 0.055
            return torch.where(signal <= 0.0031308, signal * 12.92, bent)
        power = 1 / p.gamma
        least = 1e-6  # a power has no finite slope at 0; below it the curve is a straight line
        bent = signal.clamp_min(least) ** power
        return torch.where(signal < least, signal * least ** (power - 1), bent)

    def moments(self, mean, p, context):
        if p.curve == "srgb" or context.maps.get(self.name) is not None:
            return None
        return mean ** (1 / p.gamma), mean * 0


def _interpolated(signal, table):
    place = signal * (len(table) - 1)
    below = place.detach().floor().long().clamp(0, len(table) - 2)
    return table[below] + (place - below) * (table[below + 1] - table[below])
