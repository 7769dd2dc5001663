"""Locations of rows and columns whose means are cut at 0 and rounded."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from visaug.characterization import tukey
from visaug.characterization.photon_transfer import EVEN_DN
from visaug.characterization.rounded import RoundedFit


@dataclass(frozen=True)
class LineLocations:
    """Locations of columns or of rows (DN), and the mean variance of their error (DN^2)."""

    places: np.ndarray
    error: float

    @property
    def variance(self) -> float:
        return max(float(self.places.var(ddof=1)) - self.error, 0.0)


def lines(
    master: np.ndarray, fit: RoundedFit, rows: LineLocations, columns: LineLocations, pixel_var: float | None
) -> tuple[LineLocations, LineLocations, float]:
    """Locations of rows and columns, by turns, and the pixels' variance (DN^2): as given, or what the two leave.

    Without a value the fit's spread is that of all three together.
    """
    column_errors = master.std(0, ddof=1) / math.sqrt(len(master))
    # columns are common to all rows and do not count
    row_errors = (master - master.mean(0)).std(1, ddof=1) / math.sqrt(master.shape[1])
    share = 0.5 * fit.spread**2 if pixel_var is None else pixel_var
    for _ in range(6 if pixel_var is None else 2):  # each depends on the others
        columns = locations(master.mean(0), column_errors, fit, share, rows.places)
        rows = locations(master.mean(1), row_errors, fit, share, columns.places)
        if pixel_var is None:
            share = fit.spread**2 - min(columns.variance + rows.variance, 0.98 * fit.spread**2)
    return rows, columns, share


def locations(
    means: np.ndarray, errors: np.ndarray, fit: RoundedFit, pixel_var: float, across: np.ndarray
) -> LineLocations:
    """Locations of columns (rows) whose cut mean is as measured.

    Args:
        means, errors: mean of each column and its standard error, DN.
        pixel_var: variance of the pixels' own locations, DN^2.
        across: locations of the rows, over which a column's mean runs: as they are, for few follow no law.
    """
    x, cut = cut_mean(fit, pixel_var)
    offsets = across - across.mean()
    reach = 12 * fit.sigma + np.abs(offsets).max()
    grid = np.linspace(-reach, means.max() + reach, 800)
    levels = grid[:, None] + offsets
    curve = np.where(levels > x[-1], levels, np.interp(levels, x, cut)).mean(1)
    floor = curve[min(np.searchsorted(curve, 1e-5 * fit.sigma), len(curve) - 1)]
    places = np.interp(np.maximum(means, floor), curve, grid)
    slope = np.interp(places, grid, np.gradient(curve, grid))
    return LineLocations(places, float(np.mean((errors / np.maximum(slope, 0.02)) ** 2)))


def cut_mean(fit: RoundedFit, within: float, electrons: float = 0.0, dn_per_e: float = 0.0):
    """Grid of mean levels (DN) and the mean of max(0, level + noise), rounded, there.

    The noise: read noise, N(0, within) of locations, and the Poisson spread (its skewness too) of `electrons`.
    """
    law = tukey.law(fit.shape)
    step = law.x[1] - law.x[0]
    t = 2 * np.pi * np.fft.rfftfreq(law.x.size, d=step)
    jump = 1j * t * dn_per_e / fit.sigma
    spectrum = law.phi(t) * np.exp(
        -0.5 * within / fit.sigma**2 * t**2 + electrons * (np.exp(jump) - 1 - jump)
    )
    density = np.fft.fftshift(np.fft.irfft(spectrum, law.x.size)) / step  # of the noise with its sign turned
    below = (np.cumsum(density) - 0.5 * density) * step
    x = law.x * fit.sigma
    if math.hypot(fit.sigma, math.sqrt(within)) < EVEN_DN:
        codes = np.arange(math.ceil(max(x[-1], 1.0)) + 1)
        cut = np.interp(x[:, None] - codes - 0.5, x, below, left=0.0, right=1.0).sum(1)
    else:
        cut = (np.cumsum(below) - 0.5 * below) * step * fit.sigma  # the mean of max(0, x + noise), by parts
        # of codes, whose cut is at half a DN: Euler and Maclaurin's first term
        cut -= density / fit.sigma / 24
    keep = np.concatenate([[True], np.diff(cut) > 0]) & (np.abs(x) < 60 * fit.sigma)
    return x[keep], np.maximum.accumulate(cut[keep])
