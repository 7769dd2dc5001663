"""The simpler procedure of bias and dark frames alone: means, standard deviations, regressions.

Master bias by averaging, column and row noise as standard deviations of its column and row means, the
pixel part as what they leave; read noise as the mean standard deviation of the residual frames, its shape by
matching their histogram; dark current as the slope of frame means, the smallest and the largest of each batch
dropped; an exponential through the slopes. Its values have no finite-sample corrections, so few frames bias them; the
intervals know the bias and reach over it. The default method has no such bias.
"""

import math
import warnings
from typing import Any

import numpy as np
from scipy import optimize, stats

from visaug.camera import Camera
from visaug.characterization import dark_current, tukey
from visaug.characterization.dark import miss_law
from visaug.characterization.groups import Measured
from visaug.characterization.light import NEEDS_FLATS, NEEDS_PHOTONS
from visaug.characterization.moments import GroupMoments
from visaug.characterization.still import CLIPPED, NEEDS_STILL, add_in_electrons, master_bias, tells
from visaug.core.intervals import row_blocks, symmetric, t_quantile
from visaug.statistics.findings import Findings, MeasuredGain


def procedure(found: Findings, measured: Measured, camera: Camera | None) -> None:
    """Read noise, DSNU and dark current; the gain comes from the camera, or figures stay in DN."""
    if camera is not None:
        found.gain = MeasuredGain(1 / camera.gain_at(measured.gain_db), 0.0, measured=False)
    found.miss("gain_e_per_dn", NEEDS_FLATS + "; this procedure has none")
    found.miss("quantum_efficiency", NEEDS_PHOTONS + "; this procedure has none")
    if (still := measured.still) is None:
        found.miss("read_noise.sigma_e", NEEDS_STILL)
    else:
        _bias(found, measured, still)
    _dark(found, measured)


def _bias(found: Findings, measured: Measured, still: GroupMoments) -> None:
    master = master_bias(found, measured, still)
    if not tells(still):
        found.withdraw("clipped_at_zero")
        cut = still.clipped_low > CLIPPED
        dark_too = any(m.clipped_low > CLIPPED for m in measured.darks)
        found.warn(
            f"{'clipped_at_zero' if cut else 'coarse_converter'}: the {still.group.kind} frames are "
            f"{'cut at 0' if cut else 'coarser than their noise'}, which this procedure does not know; the default method does",
            spoils=("black_level_dn", "read_noise.*", "dsnu.*", *(["dark_current.*"] if dark_too else [])),
        )
    source = f"standard deviations of the mean of {still.n} {still.group.kind} frames"
    columns, rows = master.mean(0).std(), master.mean(1).std()
    pixel = math.sqrt(max(master.var() - columns**2 - rows**2, 0.0))
    height, width = still.shape
    # What the mean of n frames keeps of their temporal noise, and columns and rows of the pixels.
    kept = [0.0] * 3
    if still.temporal is not None:
        temporal = still.temporal
        kept = [v / still.n for v in (temporal.column / height, temporal.row / width, temporal.pixel)]
    own = max(pixel**2 - kept[2], 0.0)
    for name, value, df, noise in (
        ("column", columns, width - 1, kept[0] + own / height),
        ("row", rows, height - 1, kept[1] + own / width),
        ("pixel", pixel, height * width, kept[2]),
    ):
        low, high = (value * math.sqrt(df / stats.chi2.ppf(q, df)) for q in (0.975, 0.025))
        low = math.sqrt(max(low**2 - noise, 0.0))
        add_in_electrons(found, f"dsnu.{name}", (value, low, high), source)
    error = math.hypot(columns / math.sqrt(width), rows / math.sqrt(height))
    level = symmetric(still.mean, error, min(still.shape) - 1)
    found.add("black_level_dn", level, "DN", "mean of the master bias")
    deviations, edges = [], np.zeros(0)
    keep = row_blocks(height)
    squares, counts = np.zeros(height), np.zeros((len(keep), 160), int)
    for i in still.group.indices:
        residual = measured.frames.read(i) - master
        residual -= residual.mean()
        deviations.append(float(residual.std()))
        squares += (residual**2).mean(1)
        edges = np.linspace(-8, 8, 161) * max(deviations[0], 1e-6)
        counts += [np.histogram(residual[rest == 0], edges)[0] for rest in keep]
    sigma = float(np.mean(deviations))
    error = float(np.std(deviations, ddof=1)) / math.sqrt(still.n) if still.n > 1 else math.nan
    half = t_quantile(still.n - 1) * error
    lost = math.sqrt(still.n / (still.n - 1))  # the frames' own mean takes a share of the noise with it
    source = f"mean standard deviation of {still.n} residual frames"
    add_in_electrons(found, "read_noise.sigma", (sigma, sigma - half, (sigma + half) * lost), source)
    if not sigma > 0:
        found.miss("read_noise.shape", "frames whose noise is larger than a DN")
        return
    shape = _matched(counts.sum(0), edges / sigma, None)
    # The frames' own mean draws residuals nearer to the normal law: the interval reaches over the shape without it.
    alone = _matched(counts.sum(0), edges / sigma, still.n)
    least, most = (float(np.clip(alone + h, *tukey.SHAPE_BOUNDS)) for h in (-0.02, 0.02))
    change = (_shares(most, edges / sigma, still.n) - _shares(least, edges / sigma, still.n)) / (most - least)
    steps = []
    for rest, left_out in zip(keep, counts):
        its_sigma = sigma * math.sqrt(float(rest @ squares / rest.sum() / squares.mean()))
        others = counts.sum(0) - left_out
        off = others / others.sum() - _shares(alone, edges / its_sigma, still.n)
        steps.append(float(change @ off / (change @ change)))
    blocks = len(keep)
    half = t_quantile(blocks - 1) * math.sqrt((blocks - 1) * float(np.var(steps)))
    interval = tukey.hold_both_gaussians((shape, min(shape, alone) - half, max(shape, alone) + half))
    found.add("read_noise.shape", interval, "1", f"histogram of {still.n} residual frames")


def _matched(histogram: np.ndarray, edges: np.ndarray, frames: int | None) -> float:
    """Shape whose shares are nearest to those of a histogram."""
    shares = histogram / histogram.sum()
    best: Any = optimize.minimize_scalar(
        lambda shape: float(((shares - _shares(shape, edges, frames)) ** 2).sum()),
        bounds=tukey.SHAPE_BOUNDS,
        method="bounded",
        options={"xatol": 1e-4},
    )
    return float(best.x)


def _shares(shape: float, edges: np.ndarray, frames: int | None) -> np.ndarray:
    """Shares of a Tukey-lambda law between edges in its standard deviations.
    `frames`: number of frames whose mean was taken out of each; None for the law itself.
    """
    law = tukey.standard(round(float(shape), 5))
    if frames is None:
        distribution = np.interp(edges, law.x, law.distribution)
    else:  # (1 - 1/n) x less 1/n of the others, by the characteristic function
        step = 0.02
        t = step * (np.arange(2000) + 0.5)
        others = law.phi(t / math.sqrt(frames * (frames - 1))) ** (frames - 1)
        phi = law.phi(t * math.sqrt(1 - 1 / frames)) * others
        distribution = 0.5 + step / math.pi * np.sin(np.outer(edges, t)) @ (phi / t)
    model = np.diff(distribution)
    return model / model.sum()


def _dark(found: Findings, measured: Measured) -> None:
    scale = 1.0 if found.gain is None else 1 / found.gain.dn_per_e
    unit, suffix = ("DN/s", "dn") if found.gain is None else ("e-/s", "e")
    by_temperature: dict[float, list[tuple[float, float]]] = {}
    for m in measured.darks:
        if m.group.temperature_c is None:
            continue
        means = np.sort(m.frame_means)
        kept = means[1:-1] if len(means) >= 4 else means  # fewer frames keep their smallest and largest mean
        point = (m.group.exposure_s, float(kept.mean()) * scale)
        by_temperature.setdefault(m.group.temperature_c, []).append(point)
    ladders = {t: np.array(p).T for t, p in by_temperature.items() if len({e for e, _ in p}) > 1}
    lines: dict[float, Any] = {t: stats.linregress(*points) for t, points in ladders.items()}
    if len(lines) < 2:
        miss_law(found)
        return
    temperatures, rates = np.array(list(lines)), np.array([line.slope for line in lines.values()])
    if (rates > 0).sum() < 2:
        found.miss("dark_current.a_e_per_s", "longer exposures or warmer dark frames")
        return
    start = np.polyfit(temperatures[rates > 0], np.log(rates[rates > 0]), 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optimize.OptimizeWarning)  # two points leave no covariance
        start = math.exp(start[1]), start[0]
        # pyrefly: ignore[bad-unpacking]
        (a, b), covariance = optimize.curve_fit(
            lambda t, a, b: a * np.exp(b * t), temperatures, rates, p0=start, maxfev=9999
        )
    errors = np.zeros(2)
    if len(lines) > 2 and np.isfinite(covariance).all():
        errors = t_quantile(len(lines) - 2) * np.sqrt(np.diag(covariance))
    # Few temperatures fit any exponential; how frames scatter then tells the error.
    law = dark_current.law(dark_current.slopes(dark_current.mean_points(measured.darks)))
    if law is not None:
        frame_errors = t_quantile(law.df) * np.sqrt(np.diag(law.covariance)) * np.array([a, 1.0])
        errors = np.maximum(errors, frame_errors)
    elif not errors.any():
        errors[:] = math.nan
    source = f"exponential through the slopes at {len(lines)} temperatures"
    found.add(f"dark_current.a_{suffix}_per_s", (a, max(a - errors[0], 0.0), a + errors[0]), unit, source)
    found.add("dark_current.b_per_c", (b, b - errors[1], b + errors[1]), "1/degC", source)
    found.curves["dark_current"] = {
        "temperature_c": temperatures,
        "slope": rates,
        "error": np.array([line.stderr for line in lines.values()]),
        "law": np.array([a, b]),
        "in_electrons": np.array(found.gain is not None),
    }
