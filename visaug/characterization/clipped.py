"""Bias frames that clip at 0, or whose noise is finer than the converter: read noise, DSNU and dark current.

Every pixel's value is its location plus noise, rounded and cut at 0. The likelihood of a pixel's values is
known for any location; integrated over a normal law of locations it tells read noise and pattern together,
with nothing lost to the cut and to rounding but what they hide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from visaug.characterization import dark_current, tukey
from visaug.characterization.dark import found_law
from visaug.characterization.findings import Findings
from visaug.characterization.groups import Measured
from visaug.characterization.intervals import mean_error, root, symmetric, t_quantile, variance_combination
from visaug.characterization.moments import GroupMoments, mean_map
from visaug.characterization.photon_transfer import EVEN_DN, rounds_evenly
from visaug.characterization.still import CLIPPED, add_in_electrons, add_profiles
from visaug.frames import FrameSet

_PIXELS = 3000
_BINS_PER_SIGMA = 6
_ROUNDS = 2
_ITERATIONS = 12
_BLIND = 3.0  # upper over lower bound of the read noise from which on it counts as not determined
_OPEN = 20.0  # half width of a logarithm of which nothing is known
_FAINTEST = 0.02  # DN
_RISE = 3.0  # of minus the log-likelihood: 1.92 for 95 %, and what pixels of a column have in common
_DITHER_DN = 0.3  # spread of values below which the mean of many pixels keeps the steps of the converter
_GAIN = 0.02  # log-likelihood that a further step would gain: a seventh of a standard error


@dataclass(frozen=True)
class Sample:
    """Counts (P, bins) of chosen pixels, edges between bins (DN above `origin`; bin 0 may be the cut), places of
    the pixels.
    """

    counts: np.ndarray
    edges: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    frames: int
    origin: int


@dataclass(frozen=True)
class Fit:
    """Log sigma (DN), shape, shift of the locations (DN), log of their spread (DN), and their covariance."""

    log_sigma: float
    shape: float
    shift: float
    log_spread: float
    covariance: np.ndarray

    @property
    def sigma(self) -> float:
        return math.exp(self.log_sigma)

    @property
    def spread(self) -> float:
        return math.exp(self.log_spread)


@dataclass(frozen=True)
class Lines:
    """Locations of columns or of rows (DN), and the mean variance of their error (DN^2)."""

    places: np.ndarray
    error: float

    @property
    def variance(self) -> float:
        return max(float(self.places.var(ddof=1)) - self.error, 0.0)


def clipped_frames(found: Findings, measured: Measured, still: GroupMoments, seed: int) -> None:
    """Black level, read noise, DSNU and dark current from frames cut at 0, or of noise finer than a DN."""
    indices = still.group.indices
    master = mean_map(measured.frames, indices)
    found.maps["master_bias"] = master.astype("float32")
    add_profiles(found, master)
    sample = _sample(measured.frames, indices, still, seed)
    coarse = not rounds_evenly(still)
    master = master - sample.origin
    free = (0, 2, 3) if coarse else (0, 1, 2, 3)  # tails within a DN cannot be seen: normal noise
    start, bounds = _profile(sample) if coarse else (None, None)
    fit = _fit(sample, np.zeros(len(sample.rows)), start, free)
    rows, columns = Lines(np.zeros(still.shape[0]), 0.0), Lines(np.zeros(still.shape[1]), 0.0)
    pixel_var = None
    for _ in range(0 if coarse else _ROUNDS):  # a coarse fit's spread is that of rows and columns too
        columns, rows, pixel_var = _lines(master, fit, columns, rows, pixel_var)
        centre = columns.places[sample.columns] + rows.places[sample.rows] - rows.places.mean()
        fit = _fit(sample, centre, fit, free)
        # Measured rows and columns hold their share of the pixels' own pattern.
        pixel_var = fit.spread**2 / (1 - 1 / still.shape[0] - 1 / still.shape[1])
    columns, rows, pixel_var = _lines(master, fit, columns, rows, pixel_var)
    if coarse:
        fit = replace(fit, log_spread=0.5 * math.log(max(pixel_var, 1e-12)))
    cut = " cut at 0" if still.clipped_low > CLIPPED else ""
    source = f"likelihood of {still.n} {still.group.kind} frames{cut}, rounded"
    _add(found, still, fit, rows, columns, source, sample.origin)
    _dark(found, measured, fit, columns.places, pixel_var + rows.variance, sample.origin)
    if cut:
        found.warn(
            f"clipped_at_zero: {still.clipped_low:.0%} of the pixels of the {still.group.kind} frames are 0; "
            "gain, quantum efficiency and PRNU are estimated from flats only, read noise, DSNU and dark current by a "
            "likelihood that includes the clipping; the emva figures do not include it",
            spoils=("emva.*", "emva4.*"),
        )
    if bounds:
        _coarse(found, fit, bounds, source)


def _coarse(found: Findings, fit: Fit, bounds: tuple[float, float, bool], source: str) -> None:
    """What a converter coarser than the noise leaves open; `bounds` of the read noise in DN, see `_profile`."""
    finer = "a finer converter or more gain: the noise is below half a DN"
    found.drop("read_noise.shape", finer)
    found.warn(
        f"coarse_converter: the noise of the dark frames is below {EVEN_DN} DN; read noise and DSNU are estimated by "
        "a likelihood that includes the rounding, for normal noise; the emva figures do not include it",
        spoils=("emva.*", "emva4.*", "temporal.*"),
    )
    low, high, flat = bounds
    told = high < _BLIND * low
    unit = "e" if found.gain is not None else "dn"
    if not told:
        most = f"{high / found.gain.dn_per_e:.3g} e-" if found.gain is not None else f"{high:.3g} DN"
        found.drop(f"read_noise.sigma_{unit}", f"{finer}; it is at most {most} (95 %)")
    elif flat:  # the curvature at its top does not tell how far a flat likelihood reaches
        sigma = found.parameters[f"read_noise.sigma_{unit}"]
        scale = sigma.value / fit.sigma
        sigma = replace(sigma, low=min(sigma.low, low * scale), high=max(sigma.high, high * scale))
        found.parameters[f"read_noise.sigma_{unit}"] = sigma
    if math.hypot(fit.sigma, fit.spread) < _DITHER_DN or not told:
        for name in [n for n in found.parameters if n.startswith(("dsnu.", "dark_current."))]:
            found.drop(name, finer)
        value = found.parameters["black_level_dn"].value
        found.add("black_level_dn", (value, value - 0.5, value + 0.5), "DN", source + ", known to half a DN")


def _profile(sample: Sample) -> tuple[Fit, tuple[float, float, bool]]:
    """Where to start a fit of normal noise finer than a DN, the read noise's 95 % bounds in DN, and whether the
    likelihood is flat over several steps between them.

    The likelihood may be flat down to no noise at all, and may have several tops: it is mapped.
    """
    patterns, times = np.unique(sample.counts, axis=0, return_counts=True)
    few = replace(sample, counts=patterns)
    centre = np.zeros(len(patterns))
    mids = np.concatenate([[0.0], 0.5 * (sample.edges[:-1] + sample.edges[1:]), sample.edges[-1:] + 0.5])
    mean = sample.counts @ mids / sample.frames
    start = np.array([float(mean.mean()), math.log(max(float(mean.std()), 0.05))])
    grid = np.geomspace(_FAINTEST, 1.2, 25)
    tops = []
    for sigma in grid:

        def loss(q: np.ndarray, sigma: float = float(sigma)) -> float:
            p = np.array([math.log(sigma), tukey.GAUSSIAN_SHAPE, q[0], np.clip(q[1], -6, 3)])
            return -float(times @ _log_likelihood(p, few, centre))

        tops.append(optimize.minimize(loss, start, method="Nelder-Mead", options={"xatol": 2e-3, "fatol": 0.01,
            "initial_simplex": start + np.array([[0.0, 0.0], [0.2, 0.0], [0.0, -1.5]])}))  # fmt: skip
    values = np.array([t.fun for t in tops])
    best = int(values.argmin())
    inside = np.flatnonzero(values - values[best] < _RISE)
    first, last = max(int(inside[0]) - 1, 0), min(int(inside[-1]) + 1, len(grid) - 1)
    fit = Fit(math.log(grid[best]), tukey.GAUSSIAN_SHAPE, tops[best].x[0], tops[best].x[1], np.zeros((4, 4)))
    low = 0.0 if inside[0] == 0 else float(grid[first])
    return fit, (low, float(grid[last]), len(inside) > 1)


def _lines(
    master: np.ndarray, fit: Fit, columns: Lines, rows: Lines, pixel_var: float | None
) -> tuple[Lines, Lines, float]:
    """Locations of columns and rows, by turns, and the pixels' variance (DN^2): as given, or what the two leave.

    Without a value the fit's spread is that of all three together.
    """
    column_errors = master.std(0, ddof=1) / math.sqrt(len(master))
    row_errors = _row_errors(master)
    share = 0.5 * fit.spread**2 if pixel_var is None else pixel_var
    for _ in range(6 if pixel_var is None else 2):  # each depends on the others
        columns = _locations(master.mean(0), column_errors, fit, share, rows.places)
        rows = _locations(master.mean(1), row_errors, fit, share, columns.places)
        if pixel_var is None:
            share = fit.spread**2 - min(columns.variance + rows.variance, 0.98 * fit.spread**2)
    return columns, rows, share


def _add(
    found: Findings,
    still: GroupMoments,
    fit: Fit,
    rows: Lines,
    columns: Lines,
    source: str,
    origin: int,
) -> None:
    half = min(t_quantile(19) * math.sqrt(fit.covariance[0, 0]), _OPEN)
    sigma = (fit.sigma, fit.sigma * math.exp(-half), fit.sigma * math.exp(half))
    add_in_electrons(found, "read_noise.sigma", sigma, source)
    found.add("read_noise.shape", symmetric(fit.shape, math.sqrt(fit.covariance[1, 1]), 19), "1", source)
    height, width = still.shape
    variances = {}
    for name, lines, n in (("row", rows, height), ("column", columns, width)):
        terms = [(1.0, float(lines.places.var(ddof=1)), n - 1), (-1.0, lines.error, 10 * n)]
        variances[name] = variance_combination(terms)
        add_in_electrons(found, f"dsnu.{name}", root(variances[name]), source)
    half = min(t_quantile(19) * math.sqrt(fit.covariance[3, 3]), _OPEN)
    spread = fit.spread / math.sqrt(1 - 1 / height - 1 / width)
    pixel = (spread, spread * math.exp(-half), spread * math.exp(half))
    add_in_electrons(found, "dsnu.pixel", pixel, source)
    error, df = mean_error(
        [
            (max(variances["row"][0], 0) / height, height - 1),
            (max(variances["column"][0], 0) / width, width - 1),
            (fit.covariance[2, 2], 19),
            (still.frame_variance / still.n, still.n - 1),
        ]
    )
    found.add("black_level_dn", symmetric(origin + float(columns.places.mean()), error, df), "DN", source)


def _row_errors(master: np.ndarray) -> np.ndarray:
    """Standard error of each row's mean: columns are common to all rows and do not count."""
    return (master - master.mean(0)).std(1, ddof=1) / math.sqrt(master.shape[1])


def _sample(frames: FrameSet, indices: tuple[int, ...], still: GroupMoments, seed: int) -> Sample:
    height, width = still.shape
    chosen = np.random.default_rng(seed).permutation(height * width)[:_PIXELS]
    rows, columns = np.divmod(np.sort(chosen), width)
    values = np.stack([frames.read(i)[rows, columns] for i in indices])
    sigma = 1.4826 * np.median(np.abs(values - values.mean(0)))
    step = max(1, round(max(sigma, 1.0) / _BINS_PER_SIGMA))
    origin = max(int(values.min()) - 1, 0)
    values = values - origin
    edges = _edges(float(np.median(values)) + 5 * max(sigma, 1.0), float(values.max()), step)
    bins = np.searchsorted(edges, values)
    n = len(edges) + 1
    flat = (np.arange(len(rows))[None] * n + bins).ravel()
    counts = np.bincount(flat, minlength=len(rows) * n).reshape(len(rows), n).astype(np.float64)
    return Sample(counts, edges, rows, columns, len(indices), origin)


def _edges(dense: float, top: float, step: int) -> np.ndarray:
    """Edges between bins, half-way between DN: at the cut, every `step` DN up to `dense`, then ever wider."""
    edges = [0.5]
    while edges[-1] < top:
        wide = step if edges[-1] < dense else max(step, int(0.15 * (edges[-1] - dense)) + step)
        edges.append(edges[-1] + wide)
    return np.array(edges)


def _fit(sample: Sample, centre: np.ndarray, start: Fit | None, free: tuple[int, ...]) -> Fit:
    """Maximum likelihood, the location of pixel p being N(centre_p + shift, spread); `free` parameters only."""
    if start is None:
        mids = np.concatenate([[0.0], 0.5 * (sample.edges[:-1] + sample.edges[1:]), sample.edges[-1:]])
        mean = sample.counts @ mids / sample.frames
        level, noise = (
            float(np.median(mean)),
            float(np.sqrt(np.median((sample.counts @ mids**2) / sample.frames - mean**2))),
        )
        first = np.array(
            [
                math.log(max(noise, 0.3) * 1.1),
                0.0 if 1 in free else tukey.GAUSSIAN_SHAPE,
                level - 0.3 * noise if 1 in free else level,
                math.log(max(mean.std(), 0.3)),
            ]
        )
    else:
        first = np.array(
            [start.log_sigma, start.shape, 0.0, start.log_spread]
            if centre.any()
            else [start.log_sigma, start.shape, start.shift, start.log_spread]
        )

    p = first
    value = _log_likelihood(p, sample, centre).sum()
    for _ in range(_ITERATIONS):  # Fisher scoring: the information is the scores' outer product
        scores = _scores(p, sample, centre)[list(free)]
        gradient = scores.sum(1)
        step = np.zeros(4)
        step[list(free)] = np.linalg.solve(scores @ scores.T + 1e-6 * np.eye(len(free)), gradient)
        if gradient @ step[list(free)] < _GAIN:
            break
        step *= min(
            1.0, *(most / max(abs(s), 1e-12) for s, most in zip(step, (0.3, 0.1, math.exp(p[0]), 0.5)))
        )
        for _ in range(6):
            trial = p + step
            trial[1] = np.clip(trial[1], *tukey.SHAPE_BOUNDS)
            trial[3] = max(trial[3], p[0] - 6)
            new = _log_likelihood(trial, sample, centre).sum()
            if new > value:
                p, value = trial, new
                break
            step *= 0.4
        else:
            break
    covariance = np.zeros((4, 4))
    covariance[np.ix_(free, free)] = _sandwich(_scores(p, sample, centre)[list(free)], sample)
    return Fit(*map(float, p), covariance=covariance)


def _log_likelihood(p: np.ndarray, sample: Sample, centre: np.ndarray) -> np.ndarray:
    """(P,) logarithm of each pixel's likelihood, its location integrated out on a grid."""
    sigma, shape, shift, spread = math.exp(p[0]), p[1], p[2], math.exp(p[3])
    law = tukey.standard(round(float(shape), 5))
    step = min(0.8 * sigma / math.sqrt(sample.frames), 0.5 * spread)
    low, high = centre.min() + shift - 5 * spread, centre.max() + shift + 5 * spread
    nodes = np.linspace(low, high, int(np.clip((high - low) / step, 24, 500)))
    inner = np.interp((sample.edges[:, None] - nodes[None]) / sigma, law.x, law.distribution)
    cumulative = np.concatenate([np.zeros((1, nodes.size)), inner, np.ones((1, nodes.size))])
    logs = np.log(np.maximum(np.diff(cumulative, axis=0), 1e-12))
    joint = sample.counts @ logs - 0.5 * ((nodes[None] - (centre + shift)[:, None]) / spread) ** 2
    top = joint.max(1, keepdims=True)
    scale = (nodes[1] - nodes[0]) / (spread * math.sqrt(2 * math.pi))
    return top[:, 0] + np.log(np.exp(joint - top).sum(1) * scale)


def _scores(p: np.ndarray, sample: Sample, centre: np.ndarray) -> np.ndarray:
    """(4, P) derivatives of each pixel's log-likelihood."""
    steps = np.array([2e-3, 4e-3, 0.02 * math.exp(p[0]), 4e-3])
    return np.stack(
        [(_log_likelihood(p + s, sample, centre) - _log_likelihood(p - s, sample, centre)) / (2 * s.sum())
         for s in np.diag(steps)]
    )  # fmt: skip


def _sandwich(scores: np.ndarray, sample: Sample, blocks: int = 20) -> np.ndarray:
    """Covariance from scores summed over blocks of rows and over columns.

    Pixels of a column share the error of its centre, which near the cut moves the spread at first order. Sums
    over rows and over columns, less what both count, hold either dependence (A. C. Cameron, J. B. Gelbach and
    D. L. Miller, J. Bus. Econ. Stat. 29 (2011) 238).
    """
    information = scores @ scores.T
    inverse = np.linalg.inv(information + 1e-6 * np.eye(len(scores)))  # of what is not told: no information
    by_row = _clustered(scores, np.minimum(sample.rows * blocks // (sample.rows.max() + 1), blocks - 1))
    by_both = by_row + _clustered(scores, sample.columns) - information
    rows_alone, both = (inverse @ spread @ inverse for spread in (by_row, by_both))
    return (
        both
        if (np.diag(both) > np.diag(rows_alone)).all()
        else np.maximum(both, rows_alone) * np.eye(len(both))
    )


def _clustered(scores: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """Spread of the sum of scores (4, P), from sums over clusters, each independent of the others."""
    _, cluster = np.unique(cluster, return_inverse=True)
    sums = np.stack([np.bincount(cluster, s) for s in scores])
    sums -= sums.mean(1, keepdims=True)
    return sums @ sums.T * sums.shape[1] / (sums.shape[1] - 1)


def _locations(
    means: np.ndarray, errors: np.ndarray, fit: Fit, pixel_var: float, across: np.ndarray
) -> Lines:
    """Locations of columns (rows) whose cut mean is as measured.

    Args:
        means, errors: mean of each column and its standard error, DN.
        pixel_var: variance of the pixels' own locations, DN^2.
        across: locations of the rows, over which a column's mean runs: as they are, for few follow no law.
    """
    x, cut = _cut_mean(fit, pixel_var)
    offsets = across - across.mean()
    reach = 12 * fit.sigma + np.abs(offsets).max()
    grid = np.linspace(-reach, means.max() + reach, 800)
    levels = grid[:, None] + offsets
    curve = np.where(levels > x[-1], levels, np.interp(levels, x, cut)).mean(1)
    floor = curve[min(np.searchsorted(curve, 1e-5 * fit.sigma), len(curve) - 1)]
    places = np.interp(np.maximum(means, floor), curve, grid)
    slope = np.interp(places, grid, np.gradient(curve, grid))
    return Lines(places, float(np.mean((errors / np.maximum(slope, 0.02)) ** 2)))


def _cut_mean(fit: Fit, within: float, electrons: float = 0.0, dn_per_e: float = 0.0):
    """Grid of mean levels (DN) and the mean of max(0, level + noise), rounded, there.

    The noise: read noise, N(0, within) of locations, and the Poisson spread (its skewness too) of `electrons`.
    """
    law = tukey.standard(round(fit.shape, 5))
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


def _dark(
    found: Findings, measured: Measured, fit: Fit, columns: np.ndarray, within: float, origin: int
) -> None:
    """Dark signal of every group as the shift of all columns that explains its cut mean."""
    points = []
    dn_per_e = 0.0 if found.gain is None else found.gain.dn_per_e
    per_dn = 0.0 if found.gain is None else 1 / found.gain.dn_per_e
    for m in (*measured.darks, *measured.biases):
        if m.shape[1] != columns.size:
            continue

        def mean_at(shift: float, target: float = 0.0) -> float:
            x, cut = _cut_mean(fit, within, max(shift, 0.0) * per_dn, dn_per_e)
            places = columns + shift
            return float(np.where(places > x[-1], places, np.interp(places, x, cut)).mean()) - target

        level = m.mean - origin
        reach = 10 * fit.sigma + 2 * level + float(np.ptp(columns))
        if mean_at(-reach, level) > 0 or mean_at(reach, level) < 0:
            continue
        found_root = optimize.root_scalar(mean_at, (level,), bracket=(-reach, reach), xtol=1e-4 * fit.sigma)
        shift = float(found_root.root)
        h = 0.05 * fit.sigma
        slope = (mean_at(shift + h) - mean_at(shift - h)) / (2 * h)
        scatter = m.frame_variance / max(slope, 0.02) ** 2
        group = m.group
        points.append(dark_current.Point(group.temperature_c, group.exposure_s, m.n, shift, scatter, m.n - 1))
    found_law(found, dark_current.slopes(points))
