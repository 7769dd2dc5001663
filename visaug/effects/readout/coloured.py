"""Noise whose power falls with the frequency."""

import torch
from torch import Tensor


def coloured(white: Tensor, exponent: Tensor) -> Tensor:
    """Records of mean 0 and variance 1 with a power spectrum ~ 1 / frequency^exponent.

    Args:
        white: (B, C, N) standard normal numbers, N even.
        exponent: (B or 1, 1, 1, 1).

    Returns:
        (B, C, N), periodic.
    """
    white = torch.view_as_complex(white.reshape(*white.shape[:2], -1, 2))  # one number for each frequency
    frequency = torch.arange(1, white.shape[-1] + 1, device=white.device)
    shape = torch.exp(-exponent / 2 * torch.log(frequency)).flatten(2)  # (B or 1, 1, frequencies)
    variance = 4 * shape.square().sum(-1, keepdim=True) - 3 * shape[..., -1:].square()
    # no constant: that is drift
    spectrum = torch.nn.functional.pad(white * (shape / variance.sqrt()), (1, 0))
    return torch.fft.irfft(spectrum, norm="forward")
