"""The spectrum of line means: a white level, a rise towards low frequencies, and single lines above both."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from visaug.inspection.finding import needed


@dataclass(frozen=True)
class Continuum:
    """S(j) = floor(j) + white + rise j^-exponent at j cycles per frame, DN^2 of one line mean."""

    floors: np.ndarray  # (L/2,) expected at 1, 2, ... cycles: pixels' noise in a line mean, and known parts
    white: float  # further variance of the lines
    rise: float
    exponent: float  # of the part that falls with the frequency
    gain_white: float  # twice the log likelihood ratio of either part
    gain_rise: float
    bins: int  # number of frequencies that were used
    shape: float  # of the gamma law of a bin

    def at(self, frequency: np.ndarray | float) -> np.ndarray:
        """At frequencies in cycles per frame."""
        floor = np.interp(frequency, np.arange(1, len(self.floors) + 1), self.floors)
        return floor + self.beyond(frequency)

    def beyond(self, frequency: np.ndarray | float) -> np.ndarray:
        """What is above the floor."""
        return self.white + self.rise * np.maximum(frequency, 0.5) ** -self.exponent

    @property
    def floor(self) -> float:
        """Mean of the floors."""
        return float(self.floors.mean())

    @property
    def level(self) -> float:
        return self.floor + self.white


def continuum(power: np.ndarray, shape: float, floors: np.ndarray, first: int = 1) -> Continuum:
    """Fit a continuum to a power spectrum by likelihood (P. Whittle, 1953); lines are left out.

    Args:
        power: (L/2,) mean power at 1, 2, ... cycles per frame, 1 for white noise of variance 1.
        shape: frames that were averaged: the gamma shape of a bin.
        floors: (L/2,) least levels.
        first: lowest frequency that is used.
    """
    j = np.arange(1, len(power) + 1)
    use = j >= first
    middle = float(np.median(power[use])) * shape / float(stats.gamma.median(shape))
    flat = np.maximum(middle, np.maximum(floors, 1e-12))
    risen = _fit(j[use], power[use], shape, floors, floors[use]).at(j)
    # A rise hides from a start without one, and a line from a start with one.
    fits = [_settled(start, j, power, shape, floors, use) for start in (flat, risen)]
    return max(fits, key=lambda fit: fit[0])[1]


def _settled(
    level: np.ndarray, j: np.ndarray, power: np.ndarray, shape: float, floors: np.ndarray, use: np.ndarray
) -> tuple[float, Continuum]:
    """The fit to the bins that are no lines above it, and its log likelihood, in which lines may have any power."""
    outlying = 2e-3  # probability of a bin from which it is taken for a line and left out of the continuum
    for _ in range(3):
        usual = use & (stats.gamma.sf(power * shape / np.maximum(level, 1e-12), shape) > outlying)
        found = _fit(j[usual], power[usual], shape, floors, floors[usual])
        level = np.maximum(found.at(j), 1e-12)
    told = stats.gamma.logpdf(power, shape, scale=level / shape)
    decades = 4  # of power, over which that of a line is spread evenly by its logarithm
    rare = 0.01  # share of the frequencies that are lines, beforehand
    lines = -np.log(np.maximum(power, 1e-12)) + math.log(rare / (decades * math.log(10)))
    return float(np.where(usual, told, lines)[use].sum()), found


def _fit(j: np.ndarray, power: np.ndarray, shape: float, floors: np.ndarray, floor: np.ndarray) -> Continuum:
    ones = np.ones(len(j))
    none = _fitted(power, np.zeros((len(j), 0)), floor, shape)[0]
    white, level = _fitted(power, ones[:, None], floor, shape)
    # of the rise: 1 for flicker noise, 2 for a random walk or the tail of a bump
    exponents = (0.7, 1.0, 1.4, 2.0, 3.0)
    risen = [(_fitted(power, np.stack([ones, j**-a], 1), floor, shape), a) for a in exponents]
    (best, coefficients), exponent = max(risen, key=lambda fit: fit[0][0])
    alone = _fitted(power, (j**-exponent)[:, None], floor, shape)[0]
    gain_rise = 2 * (best - white)
    if gain_rise < needed(len(exponents), 2):  # a white spectrum is enough
        return Continuum(floors, float(level[0]), 0.0, 1.0, 2 * (white - none), gain_rise, len(j), shape)
    level, rise = map(float, coefficients)
    return Continuum(floors, level, rise, exponent, 2 * (best - alone), gain_rise, len(j), shape)


def _fitted(
    power: np.ndarray, design: np.ndarray, floor: np.ndarray, shape: float
) -> tuple[float, np.ndarray]:
    """Log likelihood and coefficients (not negative) of floor + design x, by reweighted least squares."""
    least = np.maximum(floor, 1e-9 * float(power.mean()) + 1e-12)
    level = np.maximum(float(power.mean()), least) if design.shape[1] else least
    x = np.zeros(design.shape[1])
    rounds = 12
    for _ in range(rounds if design.shape[1] else 0):
        weight = 1 / level
        x, _ = optimize.nnls(design * weight[:, None], (power - floor) * weight)
        level = np.maximum(floor + design @ x, least)
    return float(-shape * (np.log(level) + power / level).sum()), x


WINDOWED = 18 / 35  # share of the information about a level that a Hann window leaves


def tapered(lines: np.ndarray) -> np.ndarray:
    """Profiles (n, L) under a Hann window of mean square 1: a sine between two frequencies stays a narrow line."""
    window = np.hanning(lines.shape[-1] + 2)[1:-1]
    return (lines - lines.mean(-1, keepdims=True)) * (window / math.sqrt(np.mean(window**2)))


# frequencies looked at for each that a frame resolves: an oscillation between two bins loses little
FINER = 2


def fine_spectrum(lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (cycles per frame) and mean power of profiles (n, L) on a grid FINER than its bins."""
    length = lines.shape[-1]
    about = lines - lines.mean(-1, keepdims=True)
    power = (np.abs(np.fft.rfft(about, FINER * length, axis=-1)) ** 2).mean(0) / length
    return np.arange(len(power)) / FINER, power


def sharpened(lines: np.ndarray, frequency: float, least: float, degree: int) -> float:
    """The frequency near the given one, `least` cycles per frame or more, at which sines explain most of profiles (n, L)."""
    length = lines.shape[-1]

    def lost(f: float) -> float:
        design = _design(f, length, degree)
        return float(((lines.T - design @ np.linalg.lstsq(design, lines.T, rcond=None)[0]) ** 2).sum())

    low, high = max(frequency - 0.8, least), min(frequency + 0.8, length / 2)
    coarse = np.linspace(low, high, 41)
    start = coarse[int(np.argmin([lost(f) for f in coarse]))]
    best = optimize.fminbound(lost, max(start - 0.05, low), min(start + 0.05, high), xtol=1e-5)
    return float(np.asarray(best).flat[0])


def phasors(lines: np.ndarray, frequency: float, degree: int) -> np.ndarray:
    """(n,) complex amplitudes of a sine of `frequency` cycles per frame in profiles (n, L), by least squares with a polynomial."""
    c, s, *_ = np.linalg.lstsq(_design(frequency, lines.shape[-1], degree), lines.T, rcond=None)[0]
    return c - 1j * s


def _design(frequency: float, length: int, degree: int) -> np.ndarray:
    angle = 2 * math.pi * frequency * np.arange(length) / length
    return np.column_stack([np.cos(angle), np.sin(angle), np.vander(np.linspace(-1, 1, length), degree + 1)])


def sines(amplitudes: np.ndarray, frequency: float, length: int) -> np.ndarray:
    """(n, L) the sines of complex amplitudes, whose mean is not removed."""
    angle = 2 * math.pi * frequency * np.arange(length) / length
    return np.real(amplitudes[:, None] * np.exp(1j * angle))
