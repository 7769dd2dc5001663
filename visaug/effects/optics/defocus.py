"""Defocus."""

import math

import torch

from visaug.effects.effect import Spreading, Stage
from visaug.effects.optics.spread import convolve, pixels_around
from visaug.effects.parameter import Strength

STRIPS = 16  # of the disc's part of a pixel, whose area is then right to 1e-3


class Defocus(Spreading):
    """The sensor is in front of or behind the image: a point becomes a uniform disc, the shadow of the aperture.

    A pixel collects the part of the disc that falls on it. The whole scene is equally out of focus.
    """

    name = "defocus"
    stage = Stage.OPTICS
    order = 34
    aliases = ("blur", "bokeh")
    summary = "The image of a point is a uniform disc."
    equation = "mu_p convolved with a disc of the radius, integrated over each pixel"
    source = "J. W. Goodman, Introduction to Fourier Optics (4th ed. 2017), section 7.4; geometrical limit"
    separates = (
        """image a bright point: defocus gives a uniform disc with a sharp edge, point_spread a Gaussian"""
    )
    proposed = False  # a diagnosis reports any blur as point_spread; only bright points distinguish them
    radius_px = Strength(
        2.0,
        unit="px",
        high=100.0,
        trials=(1.0, 3.0),
        source="defocus / (2 x f-number) / pixel; 20 um at f/2.8 on 3.45 um: 1 px",
    )

    def apply(self, signal, p, stream, context):
        return torch.where(p.radius_px > 0, convolve(signal, disc(p.radius_px.to(signal.dtype))), signal)


def disc(radius_px):
    """Kernels (B, 1, K, K): the share of the disc's area in each pixel, by strips at even angles x = radius sin(angle)."""
    least_px = 0.25  # a disc within the middle of a pixel is a point
    radius = radius_px.clamp_min(least_px)
    reach = math.ceil(float(radius.detach().max()) - 0.5)
    x, y = (place.unsqueeze(-1) for place in pixels_around(reach, radius_px))
    radius = radius.unsqueeze(-1)
    first, last = (torch.asin((edge / radius).clamp(-1 + 1e-6, 1 - 1e-6)) for edge in (x - 0.5, x + 0.5))
    share = (torch.arange(STRIPS, dtype=x.dtype, device=x.device) + 0.5) / STRIPS
    half_chord = radius * torch.cos(first + (last - first) * share)
    inside = torch.minimum(y + 0.5, half_chord) - torch.maximum(y - 0.5, -half_chord)
    area = (inside.clamp_min(0) * half_chord * (last - first)).mean(-1)
    return area / area.sum((2, 3), keepdim=True)
