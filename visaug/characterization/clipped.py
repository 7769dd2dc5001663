"""Bias frames that clip at 0, or whose noise is finer than the converter: read noise, DSNU and dark current."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from visaug.characterization import dark_current, rounded, tukey
from visaug.characterization.dark import found_law
from visaug.characterization.groups import Measured
from visaug.characterization.moments import GroupMoments
from visaug.characterization.photon_transfer import EVEN_DN, rounds_evenly
from visaug.characterization.rounded import BLOCKS, CodeHistograms, RoundedFit, SigmaLikelihood
from visaug.characterization.still import CLIPPED, add_in_electrons, add_profiles, master_bias
from visaug.core.intervals import Interval, mean_error, root, symmetric, t_quantile, variance_combination
from visaug.statistics.findings import Findings

_UNCUT = "a higher black level: too few pixels of dark frames are above 0"
_FINER = "a finer converter or more gain: the noise is below half a DN"


@dataclass(frozen=True)
class LineLocations:
    """Locations of columns or of rows (DN), and the mean variance of their error (DN^2)."""

    places: np.ndarray
    error: float

    @property
    def variance(self) -> float:
        return max(float(self.places.var(ddof=1)) - self.error, 0.0)


@dataclass(frozen=True)
class _Solution:
    """What the likelihood and the means of rows and columns give together, all in DN above the sample's origin."""

    fit: RoundedFit
    rows: LineLocations
    columns: LineLocations
    pixel_variance: float

    def level(self, master: np.ndarray, fit: RoundedFit) -> float:
        """Mean location of the columns where `fit` describes the noise."""
        _, columns, _ = lines(master, fit, self.rows, self.columns, self.pixel_variance)
        return float(columns.places.mean())


def clipped_frames(found: Findings, measured: Measured, still: GroupMoments, seed: int) -> None:
    """Black level, read noise, DSNU and dark current from frames cut at 0, or of noise finer than a DN."""
    master = master_bias(found, measured, still)
    add_profiles(found, master)
    coarse = not rounds_evenly(still)
    sample = rounded.take_sample(measured.frames, still.group.indices, still, seed, coarse)
    master = master - sample.origin
    profile = SigmaLikelihood(sample) if coarse else None
    solution = _of_coarse(sample, master, profile) if profile else _of_fine(sample, master)
    cut = " cut at 0" if still.clipped_low > CLIPPED else ""
    source = f"likelihood of {still.n} {still.group.kind} frames{cut}, rounded"
    _noise_and_pattern(found, still, solution, source)
    _black_level(found, still, solution, master, source, sample.origin)
    _dark(found, measured, still, solution, sample.origin)
    if cut:
        found.withdraw("clipped_at_zero")
        found.warn(
            f"clipped_at_zero: {100 * still.clipped_low:.2g} % of the pixels of the {still.group.kind} frames are 0; "
            "gain, quantum efficiency and PRNU are estimated from flats only, read noise, DSNU and dark current by a "
            "likelihood that includes the clipping; the emva figures do not include it",
            spoils=("emva.*", "emva4.*"),
        )
    if profile:
        _coarse(found, still, solution, profile.bounds(solution.fit), source)


def _of_fine(sample: CodeHistograms, master: np.ndarray) -> _Solution:
    """Noise of several DN: its tails are seen, and rows and columns are located one by one."""
    free = 0, 1, 2, 3
    fit = rounded.fit_locations(sample, np.zeros(len(sample.rows)), None, free)
    rows, columns = (LineLocations(np.zeros(n), 0.0) for n in master.shape)
    pixel_variance = None
    for _ in range(2):
        rows, columns, pixel_variance = lines(master, fit, rows, columns, pixel_variance)
        centre = columns.places[sample.columns] + rows.places[sample.rows] - rows.places.mean()
        fit = rounded.fit_locations(sample, centre, fit, free)
        # Measured rows and columns hold their share of the pixels' own pattern.
        pixel_variance = fit.spread**2 / (1 - 1 / master.shape[0] - 1 / master.shape[1])
    return _Solution(fit, *lines(master, fit, rows, columns, pixel_variance))


def _of_coarse(sample: CodeHistograms, master: np.ndarray, profile: SigmaLikelihood) -> _Solution:
    """Normal noise of less than a DN: the spread of the fit is that of rows, columns and pixels together."""
    fit = rounded.fit_locations(sample, np.zeros(len(sample.rows)), profile.start(), (0, 2, 3))
    rows, columns = (LineLocations(np.zeros(n), 0.0) for n in master.shape)
    return _Solution(fit, *lines(master, fit, rows, columns, None))


def _noise_and_pattern(found: Findings, still: GroupMoments, solution: _Solution, source: str) -> None:
    fit, t = solution.fit, t_quantile(BLOCKS - 1)
    if not math.isnan(fit.shape):
        half = min(t * math.sqrt(fit.covariance[0, 0]), 20.0)  # of a logarithm of which nothing is known
        bounds = fit.sigma * math.exp(-half), fit.sigma * math.exp(half)
        _read_noise(found, (fit.sigma, *bounds), source, _UNCUT)
        shape = symmetric(fit.shape, math.sqrt(fit.covariance[1, 1]), BLOCKS - 1)
        found.add("read_noise.shape", tukey.hold_both_gaussians(shape), "1", source)
    for name, of, n in zip(("row", "column"), (solution.rows, solution.columns), still.shape, strict=True):
        terms = [(1.0, float(of.places.var(ddof=1)), n - 1), (-1.0, of.error, 10 * n)]
        add_in_electrons(found, f"dsnu.{name}", root(variance_combination(terms)), source)
    half = t * 2 * fit.spread**2 * math.sqrt(fit.covariance[3, 3])
    variance = solution.pixel_variance
    add_in_electrons(found, "dsnu.pixel", root((variance, variance - half, variance + half)), source)


def _read_noise(found: Findings, interval: Interval, source: str, needs: str) -> bool:
    """Read noise from its value and bounds in DN; False, and an upper bound, where they are a factor of three apart."""
    if interval[2] < 3.0 * interval[1]:
        add_in_electrons(found, "read_noise.sigma", interval, source)
        return True
    unit, scale = ("DN", 1.0) if found.gain is None else ("e-", 1 / found.gain.dn_per_e)
    most = f"; it is at most {interval[2] * scale:.3g} {unit} (95 %)" if math.isfinite(interval[2]) else ""
    found.miss(f"read_noise.sigma_{'dn' if found.gain is None else 'e'}", needs + most)
    return False


def _black_level(
    found: Findings, still: GroupMoments, solution: _Solution, master: np.ndarray, source: str, origin: int
) -> None:
    """Mean location of the columns. Its error: rows, columns and pixels are a draw of the sensor's; frames differ; and
    the location of a cut mean depends on the noise that was fitted.
    """
    (height, width), fit = still.shape, solution.fit
    slopes = []
    for name, k in (("log_sigma", 0), ("shape", 1)):
        step = min(max(math.sqrt(fit.covariance[k, k]), 1e-4), 0.1)
        up, down = (replace(fit, **{name: getattr(fit, name) + s}) for s in (step, -step))
        known = fit.covariance[k, k] == 0
        rise = 0.0 if known else solution.level(master, up) - solution.level(master, down)
        slopes.append(rise / (2 * step))
    model = float(np.array(slopes) @ fit.covariance[:2, :2] @ slopes)
    parts = [
        (solution.rows.variance / height, height - 1),
        (solution.columns.variance / width, width - 1),
        (solution.columns.error / width, width),
        (model, BLOCKS - 1),
        (still.frame_variance / still.n, still.n - 1),
    ]
    error, df = mean_error(parts)
    interval = symmetric(origin + float(solution.columns.places.mean()), error, df)
    found.add("black_level_dn", interval, "DN", source)
    if interval[2] < 0:
        said = "black_level_below_zero: the black level is below 0 DN; a camera file cannot hold it and has 0"
        found.warn(said)


def _coarse(
    found: Findings, still: GroupMoments, solution: _Solution, bounds: tuple[float, float], source: str
) -> None:
    """What a converter coarser than the noise leaves open; `bounds` of the read noise in DN."""
    found.miss("read_noise.shape", _FINER)
    found.warn(
        f"coarse_converter: the noise of the dark frames is below {EVEN_DN} DN; read noise and DSNU are estimated by "
        "a likelihood that includes the rounding, for normal noise; the emva figures do not include it",
        spoils=("emva.*", "emva4.*", "temporal.*"),
    )
    noise = (solution.fit.sigma, *bounds)
    told = _read_noise(found, noise, f"{source}, normal noise, interval by likelihood ratio", _FINER)
    # Below, the mean of many pixels keeps the steps of the converter.
    if told and math.hypot(solution.fit.sigma, math.sqrt(solution.pixel_variance)) >= 0.3:
        return
    for name in [n for n in found.parameters if n.startswith(("dsnu.", "dark_current."))]:
        found.drop(name, _FINER)
    if still.clipped_low > 0.5:
        found.drop("black_level_dn", "a higher black level: dark frames are 0, so it is at most 0.5 DN")
        return
    value = found.parameters["black_level_dn"].value
    found.add("black_level_dn", (value, value - 0.5, value + 0.5), "DN", source + ", known to half a DN")


def _dark(found: Findings, measured: Measured, still: GroupMoments, solution: _Solution, origin: int) -> None:
    """Dark signal of every group as the shift of all columns that explains its cut mean."""
    fit, columns = solution.fit, solution.columns.places
    within = solution.pixel_variance + solution.rows.variance
    points = []
    dn_per_e = 0.0 if found.gain is None else found.gain.dn_per_e
    per_dn = 0.0 if found.gain is None else 1 / found.gain.dn_per_e
    for m in (*measured.darks, *measured.biases):
        if m.place != still.place:
            continue

        def mean_at(shift: float, target: float = 0.0) -> float:
            x, cut = cut_mean(fit, within, max(shift, 0.0) * per_dn, dn_per_e)
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
        at = m.group.temperature_c, m.group.exposure_s, m.n
        scatter = m.frame_variance / max(slope, 0.02) ** 2
        points.append(dark_current.DarkPoint(*at, shift, scatter, m.n - 1))
    found_law(found, dark_current.slopes(points))


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
    `means`, `errors`: mean of each column and its standard error, DN.
    `pixel_var`: variance of the pixels' own locations, DN^2.
    `across`: locations of the rows, over which a column's mean runs: as they are, for few follow no law.
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
    exponent = -0.5 * within / fit.sigma**2 * t**2 + electrons * (np.exp(jump) - 1 - jump)
    spectrum = law.phi(t) * np.exp(exponent)
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
