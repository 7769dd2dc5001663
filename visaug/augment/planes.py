"""How one monochrome sensor serves an image of several channels."""

from collections.abc import Callable

import torch
from torch import Tensor

LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear red, green and blue: ITU-R BT.709, the primaries of sRGB


def luminance(light: Tensor) -> Tensor:
    """The plane that a monochrome sensor sees, (B, 1, H, W), of linear light (B, C, H, W).

    Y = 0.2126 R + 0.7152 G + 0.0722 B for three channels, else their mean; exactly the image where all are equal.
    """
    first = light[:, :1]
    if light.shape[1] == 3:
        red, green, blue = light.split(1, 1)
        return green + LUMINANCE[0] * (red - green) + LUMINANCE[2] * (blue - green)
    return first + (light - first).mean(1, keepdim=True)


def through_luminance(light: Tensor, take: Callable[[Tensor], Tensor]) -> Tensor:
    """One exposure of the luminance, whose noise is added to every channel: out_c = cut(take(Y) + (c - Y)).

    Equal channels stay equal; differences between channels are kept and get no noise.

    Args:
        light: (B, C, H, W), linear.
        take: noisy planes (B, 1, H, W) in [0, 1] from clean ones.
    """
    if light.shape[1] == 1:
        return take(light)
    if not torch.compiler.is_compiling() and torch.equal(light, light[:, :1].expand_as(light)):
        return take(light[:, :1]).expand(light.shape).clone()  # the same result, sooner
    seen = luminance(light)
    return (take(seen) + (light - seen)).clamp(0, 1)
