"""Noise whose power falls with the frequency."""

from functools import lru_cache

import torch
from torch import Tensor

STEEPEST = 1.9  # exponent up to which `part_of_coloured` is exact: beyond, no record of twice the length has that covariance
LEAST = 1e-30  # power below which a root has no derivative


def coloured(white: Tensor, exponent: Tensor) -> Tensor:
    """Records of mean 0 and variance 1 with a power spectrum ~ 1 / frequency^exponent.

    Args:
        white: (B, C, N) standard normal numbers, N even.
        exponent: (B or 1, 1, 1, 1).

    Returns:
        (B, C, N), periodic.
    """
    white = _pairs(white)  # one number for each frequency
    # no constant: that is drift
    spectrum = torch.nn.functional.pad(white * _amplitudes(exponent, white.shape[-1]), (1, 0))
    return torch.fft.irfft(spectrum, norm="forward")


def part_of_coloured(white: Tensor, exponent: Tensor, period: int) -> Tensor:
    """Consecutive numbers out of the middle of long records as of `coloured`, which are not made.

    They are the first half of records of twice their length in which the covariance of the long records runs to the last of them
    and back (circulant embedding: C. R. Dietrich and G. N. Newsam, SIAM J. Sci. Comput. 18 (1997) 1088).

    Args:
        white: (B, C, 2 n) standard normal numbers.
        exponent: (B or 1, 1, 1, 1), at most `STEEPEST`.
        period: length of the long records, even, at least 2 n.

    Returns:
        (B, C, n), with the covariance of n consecutive numbers of `coloured`.
    """
    white = _pairs(white)
    count = white.shape[-1]
    if exponent.numel() > 1 or exponent.requires_grad:
        amplitudes = _amplitudes_of_part(exponent, count, period)
    else:
        amplitudes = _known_amplitudes(float(exponent), count, period).to(white.device)
    ends = torch.view_as_real(white[..., -1:]) * torch.stack([amplitudes[..., -1:], amplitudes[..., :1]], -1)
    highest, constant = (torch.complex(end, torch.zeros_like(end)) for end in ends.unbind(-1))
    spectrum = torch.cat([constant, white[..., :-1] * amplitudes[..., 1:-1], highest], -1)
    return torch.fft.irfft(spectrum, norm="forward")[..., :count]


@lru_cache(maxsize=2)
def _known_amplitudes(exponent: float, count: int, period: int) -> Tensor:
    """The same for one exponent: what it takes is as much as several frames."""
    return _amplitudes_of_part(torch.full((1, 1, 1, 1), exponent), count, period)


def _amplitudes_of_part(exponent: Tensor, count: int, period: int) -> Tensor:
    """(B or 1, 1, count + 1) of the frequencies from 0 on of `part_of_coloured`, float32; from double precision, as the highest
    frequencies have little of the power.
    """
    power = 2 * _amplitudes(exponent.double(), period // 2).square()
    power = torch.cat([power[..., :-1], power[..., -1:] / 2], -1)  # the highest frequency has no phase
    there = torch.fft.irfft(torch.nn.functional.pad(power, (1, 0)), norm="forward")[..., : count + 1]
    power = torch.fft.rfft(torch.cat([there, there[..., 1:-1].flip(-1)], -1), norm="forward").real
    # the real and the imaginary part of a frequency with a phase have half of its power each
    half = torch.cat([power[..., :1], power[..., 1:-1] / 2, power[..., -1:]], -1)
    return half.clamp_min(LEAST).sqrt().float()


def _pairs(white: Tensor) -> Tensor:
    """(B, C, N) numbers as N / 2 complex ones."""
    return torch.view_as_complex(white.reshape(*white.shape[:2], -1, 2))


def _amplitudes(exponent: Tensor, count: int) -> Tensor:
    """(B or 1, 1, count) of the frequencies from 1 on with which a record has the variance 1."""
    frequency = torch.arange(1, count + 1, device=exponent.device)
    shape = torch.exp(-exponent / 2 * torch.log(frequency)).flatten(2)
    variance = 4 * shape.square().sum(-1, keepdim=True) - 3 * shape[..., -1:].square()
    return shape / variance.sqrt()
