"""Diffraction."""

import math

import torch

from visaug.effects.effect import Spreading, Stage
from visaug.effects.optics.spread import filtered, frequencies
from visaug.effects.parameter import Strength

FIRST_ZERO = 3.8317059702075125 / math.pi  # of the Airy pattern, in wavelengths times the f-number: 1.2197


class Diffraction(Spreading):
    """A circular aperture spreads the image of a point into an Airy pattern, which is integrated over pixels.

    The optical transfer function is zero above the cutoff frequency. Sampling by pixels aliases what lies above half a cycle
    per pixel; with it, the kernel is the integral of the Airy pattern over each pixel, with all its rings. The frame is
    mirrored at its edges, so the total is conserved.
    """

    name = "diffraction"
    stage = Stage.OPTICS
    order = 38
    aliases = ("Airy disc", "blur", "MTF")
    summary = "The aperture spreads a point into an Airy pattern."
    equation = """mu_p convolved with (2 J1(v) / v)^2, v = 3.832 r / radius, integrated over each pixel;
    transfer (2 / pi)(acos u - u sqrt(1 - u^2)), u = f radius / 1.22"""
    source = "J. W. Goodman, Introduction to Fourier Optics (4th ed. 2017), sections 4.4 and 7.4; radius = 1.22 lambda N / pixel"
    separates = """image a bright point: diffraction gives rings and wings that fall with the third power of
    the distance"""
    proposed = False  # a diagnosis reports any blur as point_spread; only bright points distinguish them
    radius_px = Strength(
        1.0,
        unit="px",
        high=100.0,
        trials=(0.8, 2.5),
        source="radius of the first dark ring; 550 nm at f/8 on 3.45 um pixels: 1.6 px",
    )

    def apply(self, signal, p, stream, context):
        spread = filtered(signal, transfer(signal, p.radius_px.to(signal.dtype))).clamp_min(0)
        return torch.where(p.radius_px > 0, spread, signal)


def transfer(signal, radius_px):
    """Of the Airy pattern integrated over pixels and taken at each, (B, 1, H, W)."""
    per_cutoff = radius_px / FIRST_ZERO
    cutoff = float((1 / per_cutoff.detach().clamp_min(1e-9)).max())  # cycles/px
    most_folds = 4  # of the spectrum, by the pixels: all there are for a radius of 0.28 px or more
    folds = min(most_folds, math.ceil(max(cutoff - 0.5, 0)))
    f_rows, f_columns = frequencies(signal)
    total = torch.zeros_like(per_cutoff)
    for m in range(-folds, folds + 1):
        for n in range(-folds, folds + 1):
            a, b = f_rows + m, f_columns + n
            u = ((a**2 + b**2).sqrt() * per_cutoff).clamp(0, 1 - 1e-6)
            aperture = 2 / math.pi * (torch.acos(u) - u * (1 - u**2).sqrt())
            total = total + aperture * torch.sinc(a) * torch.sinc(b)
    return total
