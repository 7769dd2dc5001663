"""Film grain."""

import torch
import torch.nn.functional as F

from visaug.effects.effect import Effect, Stage
from visaug.effects.parameter import Parameter, Strength

REACH_PX = 20  # four standard deviations of the coarsest grain


class FilmGrain(Effect):
    """Grains of finite size cover the film at random: noise that is correlated over neighbours and depends on the level.

    In the random-disc model a region of level y is covered with probability y, so the variance is that of a coin,
    y (1 - y): none in black and white, most in mid-grey. What is left after the processing in a camera looks alike.
    """

    name = "film_grain"
    stage = Stage.PICTURE
    order = 14
    aliases = ("grain", "correlated noise")
    summary = "Spatially correlated noise that is strongest in mid-grey."
    equation = """y <- clip(y + 2 sigma sqrt(y (1 - y)) g, 0, 1), g white noise convolved with a Gaussian of
    standard deviation size, of variance 1"""
    source = "A. Newson et al., Computer Graphics Forum 36 (2017) 684"
    separates = """compute the covariance of neighbours in a flat region: read and shot noise of a raw frame
    have none"""
    sigma = Strength(
        0.03, "fraction", 0.0, 0.5, "of full scale at mid-grey; ISO 100 to 800", trials=(0.02, 0.06)
    )
    size_px = Parameter(0.8, "px", 0.3, 5.0, "of a grain as scanned; standard deviation")

    def apply(self, signal, p, stream, context):
        around = (range(side.start, side.stop + 2 * REACH_PX) for side in context.window)
        white = stream.over(*around).normal()
        away = torch.arange(-REACH_PX, REACH_PX + 1, device=signal.device, dtype=signal.dtype)
        kernel = torch.exp(-((away / p.size_px) ** 2) / 2)
        kernel = kernel / kernel.square().sum(-1, keepdim=True).sqrt()
        turned = _along_rows(white.to(signal.dtype), kernel).transpose(-1, -2)
        grain = _along_rows(turned, kernel).transpose(-1, -2)
        held = signal.clamp(0, 1)
        depth = 2 * (held * (1 - held)).clamp_min(1e-8).sqrt()
        return (signal + p.sigma * depth * grain).clamp(0, 1)

    def moments(self, mean, p, context):
        return mean, 4 * p.sigma**2 * mean * (1 - mean)


def _along_rows(white, kernel):
    batch, channels = white.shape[:2]
    own = kernel.expand(batch, channels, 1, -1).reshape(batch * channels, 1, 1, -1)
    flat = white.reshape(1, batch * channels, *white.shape[2:])
    return F.conv2d(flat, own, groups=batch * channels).unflatten(1, (batch, channels)).squeeze(0)
