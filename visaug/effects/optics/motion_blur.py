"""Motion blur."""

import math

import torch

from visaug.effects.effect import Spreading, Stage
from visaug.effects.optics.spread import convolve, pixels_around
from visaug.effects.parameter import Parameter, Strength


class MotionBlur(Spreading):
    """The image moves uniformly along a straight line while the shutter is open.

    The image of a point is a line of `length_px` centred on the point; a pixel collects the part of the line that crosses
    it, so motion shorter than a pixel has no effect. Shot noise is added afterwards, so noise stays white. The whole scene
    moves equally: a rotating camera, or a target that crosses the field.
    """

    name = "motion_blur"
    stage = Stage.OPTICS
    order = 36
    aliases = ("smear", "motion smear", "camera shake")
    summary = "The image moves along a straight line during the exposure."
    equation = """mu_p <- integral of mu_p(x - v t, y - w t) dt / T: a line of length L at the angle,
    counter-clockwise from the rows, its share in each pixel"""
    source = "A. N. Rajagopalan and R. Chellappa, Motion Deblurring (Cambridge 2014), chapter 1"
    separates = (
        """image a bright point: motion blur gives a line and not a disc, half as long at half the exposure"""
    )
    proposed = False  # frames under test are taken with camera and target at rest
    length_px = Strength(
        5.0,
        unit="px",
        high=200.0,
        trials=(2.0, 7.0),
        source="angular rate x exposure / angle of a pixel; 1 deg/s, 20 ms, 0.005 deg: 4 px",
    )
    angle_deg = Parameter(
        0.0, "deg", -180.0, 180.0, "counter-clockwise from the direction of the rows", trials=(30.0,)
    )

    def apply(self, signal, p, stream, context):
        moved = convolve(signal, line(p.length_px.to(signal.dtype), p.angle_deg.to(signal.dtype)))
        return torch.where(p.length_px > 0, moved, signal)


def line(length_px, angle_deg):
    """Kernels (B, 1, K, K): the share of the line that lies in each pixel."""
    least_px = 1e-3  # a shorter way is one
    half = length_px.clamp_min(least_px) / 2
    x, y = pixels_around(math.ceil(float(half.detach().max())), length_px)
    angle = torch.deg2rad(angle_deg)
    first, last = -half, half
    for place, rate in ((x, torch.cos(angle)), (y, -torch.sin(angle))):  # rows are counted downwards
        rate = torch.where(rate.abs() < 1e-6, 1e-6, rate)
        enters, leaves = (place - 0.5) / rate, (place + 0.5) / rate
        first = torch.maximum(first, torch.minimum(enters, leaves))
        last = torch.minimum(last, torch.maximum(enters, leaves))
    inside = (last - first).clamp_min(0)
    return inside / inside.sum((2, 3), keepdim=True)
