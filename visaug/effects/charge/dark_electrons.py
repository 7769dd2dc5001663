"""Electrons that join those of the light."""

from torch import Tensor

from visaug.core.sampling import Stream
from visaug.effects.effect import Context

REFERENCE_C = 20.0  # degrees Celsius, at which a camera file states the rates of dark electrons


def add_dark_electrons(signal: Tensor, mean_e: Tensor, stream: Stream, context: Context) -> Tensor:
    """The signal with `mean_e` dark electrons a pixel, broadcast against (B, C, H, W).

    They join the mean, before the one draw of shot noise. In the paper's reading that draw has struck the
    photons, so dark electrons have their own (eq. 11).
    """
    if context.reading == "paper":
        return signal + stream.poisson(mean_e.expand(signal.shape))
    return signal + mean_e
