"""Accurate fixed patterns: learn one sensor's rows and columns, make others like it.

Gaussian row, column and pixel parts have the right size but no structure. A real CMOS sensor has levels (the
columns of the paper's lie near 11, 6 and 1 e-), trends across the sensor and periods. A profile, the mean of
each column or each row, is described by

    y(x) = Q(Phi(g(x))),    g(x) = polynomial(u) + n(x),    u from -1 to 1 across the sensor,

Q the quantile function of a Gaussian mixture, n stationary Gaussian noise with a measured power spectrum. The
mixture gives the levels, the polynomial the trend, the spectrum the spatial frequencies: levels stay levels
where the trend bends. That is a Gaussian copula. The paper names mixtures and polynomials, and the spatial
frequencies as the part to keep (section 4.1.1). The rest is pixel noise.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from visaug.core.errors import InputError


@dataclass(frozen=True)
class Mixture:
    """A Gaussian mixture: weights (sum 1), means and standard deviations of its components, in e-."""

    weights: np.ndarray
    means: np.ndarray
    deviations: np.ndarray

    @property
    def mean(self) -> float:
        return float(self.weights @ self.means)

    @property
    def variance(self) -> float:
        return float(self.weights @ (self.deviations**2 + (self.means - self.mean) ** 2))

    def cdf(self, x: np.ndarray) -> np.ndarray:
        """Probability of a value up to x."""
        return ndtr((np.asarray(x)[..., None] - self.means) / self.deviations) @ self.weights

    def quantile(self, probability: np.ndarray) -> np.ndarray:
        """The inverse of `cdf`, by interpolation between 4096 nodes."""
        low, high = (self.means - 7 * self.deviations).min(), (self.means + 7 * self.deviations).max()
        spread = np.linspace(-7, 7, 512)
        nodes = np.concatenate(
            [np.linspace(low, high, 2048), *(m + s * spread for m, s in zip(self.means, self.deviations))]
        )
        nodes.sort()
        levels, first = np.unique(self.cdf(nodes), return_index=True)
        return np.interp(probability, levels, nodes[first])


@dataclass(frozen=True)
class LineLaw:
    """The law of a sensor's columns or rows.

    Attributes:
        mixture: law of the single lines' offsets, e-.
        trend: coefficients of the polynomial in u, lowest first, in standard deviations of g.
        spectrum: power of n at the frequencies 0 to 1/2 per line, equally spaced; its mean is n's variance.
    """

    mixture: Mixture
    trend: np.ndarray
    spectrum: np.ndarray

    def draw(self, length: int, rng: np.random.Generator) -> np.ndarray:
        """The offsets of one new sensor's lines, (length,) in e-."""
        return self.mixture.quantile(ndtr(_trend(self.trend, length) + self._noise(length, rng)))

    def _noise(self, length: int, rng: np.random.Generator) -> np.ndarray:
        frequency = np.fft.rfftfreq(length)
        known = np.linspace(0, 0.5, len(self.spectrum))
        power = np.interp(frequency, known, self.spectrum)
        power *= self.spectrum.mean() / max(_full_mean(power, length), 1e-300)
        white = np.fft.rfft(rng.standard_normal(length))
        return np.fft.irfft(white * np.sqrt(power), length)


@dataclass(frozen=True)
class FixedPatternLaw:
    """The law of a sensor's offsets, columns + rows + pixels: what `fit_pattern` finds in a master bias.

    The columns hold the frame's mean. `pixel_e` is the deviation of what columns and rows leave over, e-.
    """

    columns: LineLaw
    rows: LineLaw
    pixel_e: float

    def draw(self, resolution: tuple[int, int], seed: int) -> np.ndarray:
        """The offsets of one new sensor, (rows, columns) float32 in e-: np.save it and name it as dsnu.map.

        Args:
            resolution: rows and columns; may differ from those of the sensor that was measured.
            seed: another seed, another sensor of the kind.
        """
        rng = np.random.default_rng(seed)
        columns, rows = self.columns.draw(resolution[1], rng), self.rows.draw(resolution[0], rng)
        pattern = columns[None, :] + rows[:, None] + self.pixel_e * rng.standard_normal(resolution)
        return pattern.astype(np.float32)


def fit_pattern(master_bias_e: np.ndarray, noise_e: float = 0.0) -> FixedPatternLaw:
    """The law of a sensor's fixed pattern from the mean of many bias frames.

    Args:
        master_bias_e: (rows, columns) in e-, black level off: (mean frame - black level) * gain_e_per_dn.
        noise_e: what is left of the read noise in it, its deviation / sqrt(number of frames): taken off the pixels' part.

    Raises:
        InputError: fewer than 32 rows or columns, or values that are not finite.
    """
    frame = np.asarray(master_bias_e, np.float64)
    if frame.ndim != 2 or min(frame.shape) < 32 or not np.isfinite(frame).all():
        raise InputError(
            "is not a master bias", field="master_bias_e", expected="32 x 32 or more finite values"
        )
    columns = frame.mean(0)
    rows = frame.mean(1) - frame.mean()
    left = frame - columns[None, :] - rows[:, None]
    freedom = (frame.shape[0] - 1) * (frame.shape[1] - 1)
    variance = (left**2).sum() / freedom
    return FixedPatternLaw(
        fit_profile(columns), fit_profile(rows), float(np.sqrt(max(variance - noise_e**2, 0.0)))
    )


def fit_profile(offsets_e: np.ndarray) -> LineLaw:
    """The law of a profile, (n,) in e-: mixture by likelihood, trend by least squares, spectrum of the rest."""
    offsets = np.asarray(offsets_e, np.float64)
    mixture = fit_mixture(offsets)
    scores = ndtri(mixture.cdf(offsets).clip(1e-6, 1 - 1e-6))
    degree = 7  # of the trend: enough for a glow at one edge, too little for a band
    trend = np.polynomial.polynomial.polyfit(_places(len(offsets)), scores, degree)
    rest = scores - _trend(trend, len(offsets))
    return LineLaw(mixture, trend, _smooth(np.abs(np.fft.rfft(rest)) ** 2 / len(rest)))


def fit_mixture(values: np.ndarray) -> Mixture:
    """The Gaussian mixture with the least BIC of at most four parts, by expectation and maximisation."""
    spread = values.std()
    if spread < 1e-9:
        return Mixture(np.ones(1), np.array([values.mean()]), np.array([1e-9]))
    best, least = None, np.inf
    for count in range(1, 5):
        mixture, likelihood = _maximise(values, count, 0.02 * spread)
        criterion = (3 * count - 1) * np.log(len(values)) - 2 * likelihood
        if criterion < least:
            best, least = mixture, criterion
    assert best is not None
    return best


def _maximise(values: np.ndarray, count: int, narrowest: float) -> tuple[Mixture, float]:
    """Starts at equal steps of the range, so that a rare, distant level gets its own component."""
    weights = np.full(count, 1 / count)
    low, high = np.quantile(values, [0.005, 0.995])
    means = low + (high - low) * (np.arange(count) + 0.5) / count
    deviations = np.full(count, max(values.std() / count, narrowest))
    likelihood = -np.inf
    for _ in range(500):
        distance = (values[:, None] - means) / deviations
        logs = np.log(weights) - 0.5 * distance**2 - np.log(deviations) - 0.5 * np.log(2 * np.pi)
        total = np.logaddexp.reduce(logs, axis=1)
        share = np.exp(logs - total[:, None])
        mass = share.sum(0) + 1e-12
        weights, means = mass / mass.sum(), values @ share / mass
        deviations = np.sqrt(((values[:, None] - means) ** 2 * share).sum(0) / mass + narrowest**2)
        if total.sum() - likelihood < 1e-7 * len(values):
            break
        likelihood = total.sum()
    return Mixture(weights, means, deviations), float(total.sum())


def _places(length: int) -> np.ndarray:
    return (2 * np.arange(length) + 1) / length - 1


def _trend(coefficients: np.ndarray, length: int) -> np.ndarray:
    return np.polynomial.polynomial.polyval(_places(length), coefficients)


def _full_mean(power: np.ndarray, length: int) -> float:
    """Mean over all frequencies, of which `rfft` gives half."""
    twice = np.full(len(power), 2.0)
    twice[0] = 1
    if length % 2 == 0:
        twice[-1] = 1
    return float(twice @ power / length)


def _smooth(power: np.ndarray) -> np.ndarray:
    """A running mean; lines stay. The zero frequency, which the polynomial took, is its neighbour's."""
    power = power.copy()
    power[0] = power[1]
    smoothing = 5  # bins of the periodogram that are averaged; single peaks are kept
    padded = np.pad(power, smoothing // 2, mode="reflect")
    window = np.lib.stride_tricks.sliding_window_view(padded, smoothing)
    beside = np.median(window, axis=1)
    line = power > 8.0 * beside / np.log(2)  # a period, no chance
    calm = np.where(line, beside / np.log(2), power)
    mean = np.convolve(
        np.pad(calm, smoothing // 2, mode="reflect"), np.full(smoothing, 1 / smoothing), "valid"
    )
    smooth = np.where(line, power, mean)
    return smooth * power.mean() / max(smooth.mean(), 1e-300)
