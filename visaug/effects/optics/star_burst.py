"""Diffraction spikes of the aperture."""

import math

import torch

from visaug.effects.effect import Spreading, Stage
from visaug.effects.optics.spread import convolve, pixels_around
from visaug.effects.parameter import Parameter, Strength

REACH = 3.0  # decay lengths at which a spike is cut


class StarBurst(Spreading):
    """The straight edges of an iris diffract light into spikes perpendicular to each blade, on both sides of the source.

    An even number of blades gives as many spikes, an odd number twice as many. The intensity along a spike falls as the
    inverse square of the distance and is cut off by the finite size of the source and the bandwidth of the light. A rotation
    of the camera turns the spikes with it.
    """

    name = "star_burst"
    stage = Stage.OPTICS
    order = 39
    aliases = ("sun star", "diffraction spikes", "glare")
    summary = "The blades of the aperture produce spikes around bright sources."
    equation = """mu_p <- (1 - share) mu_p + share (mu_p * k), k ~ sum over blades of exp(-u / length) / (1 +
    (u / 3)^2), u along the spike in px, a pixel wide"""
    source = """after J. W. Goodman, Introduction to Fourier Optics, Fraunhofer diffraction of a rectangular
    aperture: perpendicular to a straight edge the envelope of sinc^2 falls as 1 / u^2"""
    separates = """image a bright point at two apertures: spikes turn with the camera and disappear at full aperture"""
    proposed = False  # frames of a laboratory contain no bright points on black
    share = Strength(
        0.01, "fraction", 0.0, 0.5, "grows as the aperture is closed; 0.1 to 5 %", trials=(0.01, 0.1)
    )
    blades = Parameter(6.0, "blades", 3.0, 20.0, "5 to 9 in most lenses", integer=True)
    length_px = Parameter(15.0, "px", 1.0, 100.0, "decay length; assumed")
    angle_deg = Parameter(15.0, "deg", -180.0, 180.0, "of the first spike, from the rows")

    def apply(self, signal, p, stream, context):
        return signal + p.share * (convolve(signal, _spikes(p, signal.dtype)) - signal)


def _spikes(p, dtype):
    """Kernels (B, 1, K, K) of sum 1."""
    length, angle = p.length_px.to(dtype), torch.deg2rad(p.angle_deg.to(dtype))
    reach = (REACH * length.detach()).ceil()
    x, y = pixels_around(int(reach.max()), length)
    total = torch.zeros_like(length)
    core_px = 3.0  # within it, the finite size of the source hides the fall-off
    for blade in range(int(p.blades.detach().round().max())):
        turned = angle + 2 * math.pi * blade / p.blades.round()
        along = x * torch.cos(turned) - y * torch.sin(turned)  # rows are counted downwards
        across = x * torch.sin(turned) + y * torch.cos(turned)
        fall = torch.exp(-along.abs() / length) / (1 + (along / core_px) ** 2)
        total = total + fall * (1 - across.abs()).clamp_min(0) * (blade < p.blades.round())
    total = total * (torch.maximum(x.abs(), y.abs()) <= reach)
    return total / total.sum((2, 3), keepdim=True)
