"""Whether all pixels have one gain: their excess variance over their signal, by parts of the frame and places of a 2 x 2."""

import math

import numpy as np
from scipy import stats

from visaug.characterization.additivity import FROM_GAIN
from visaug.characterization.groups import FlatLevel, Measured
from visaug.characterization.moments import GroupMoments, largest_place, mean_map
from visaug.characterization.photon_transfer import PhotonTransferResult
from visaug.frames import FrameSet
from visaug.statistics.findings import FALSE_ALARM, Findings

_PARTS = 4  # along each side


def check(measured: Measured, transfer: PhotonTransferResult, found: Findings) -> None:
    """Warns of gains that differ between parts of the frame or between neighbouring pixels."""
    levels = [transfer.levels[i] for i in transfer.safe]
    place = largest_place(v.flat for v in levels)
    if place is None or min(place[0]) < 8 * _PARTS:
        return
    levels = [v for v in levels if v.flat.place == place and v.signal > 0][-4:]  # which tell the gain best
    ratio, error = relative_gains(measured.frames, levels, transfer)
    weights = 1 / error**2
    ratio, error = (values / float((ratio * weights).sum() / weights.sum()) for values in (ratio, error))
    square = float((((ratio - 1) / error) ** 2).sum())
    spread = math.sqrt(max(float(((ratio - 1) ** 2).mean() - (error**2).mean()), 0.0))
    # With the approximations of the errors, false alarms have the probability 0.002 in small sets.
    matters = 0.02  # root mean square deviation of the gain
    if stats.chi2.sf(square, ratio.size - 1) > FALSE_ALARM or spread < matters:
        return
    places, parts = ratio.mean((0, 1)), ratio.mean((2, 3))
    beside = float(np.var(places)) > float(np.var(parts))
    low, high = (float(f(places if beside else parts)) for f in (np.min, np.max))
    where = "over the frame (amplifiers of different gain, or shading that the camera corrected)"
    if beside:
        where = "at the places of a 2 x 2 (a digital gain of colours or columns)"
    found.warn(
        f"gain_uneven: variance over signal is {low:.2f} to {high:.2f} of its mean {where}: one gain_e_per_dn does not hold for "
        "all pixels",
        spoils=FROM_GAIN,
    )


def relative_gains(
    frames: FrameSet, levels: list[FlatLevel], transfer: PhotonTransferResult
) -> tuple[np.ndarray, np.ndarray]:
    """Excess variance over the signal in units of their means and its standard error, (parts, parts, 2, 2) each."""
    bend = transfer.curvature_per_dn[0] if transfer.curvature_per_dn else 0.0
    top, bottom, noise = (np.zeros((_PARTS, _PARTS, 2, 2)) for _ in range(3))
    for dark in {id(v.dark): v.dark for v in levels}.values():  # whose error all their flats share
        master = mean_map(frames, _chosen(dark))
        quiet, quiet_share = _variances(frames, dark, master, None)
        total = np.zeros_like(top)
        for v in (v for v in levels if v.dark is dark):
            mean = mean_map(frames, _chosen(v.flat))
            bright, share = _variances(frames, v.flat, mean, mean - master)
            signal = _by_cell(_cells(mean - master))
            expected = signal * (1 + bend * signal)
            expected *= (bright - quiet).mean() / expected.mean()
            # Errors by what is expected: by what is measured, cells of little variance would weigh more.
            error = (quiet.mean() + expected) * share
            weight = expected / (error**2 + (quiet.mean() * quiet_share) ** 2)
            top += weight * (bright - quiet)
            bottom += weight * expected
            noise += (weight * error) ** 2
            total += weight
        noise += (total * quiet.mean() * quiet_share) ** 2
    return top / bottom, np.sqrt(noise) / bottom


def _variances(
    frames: FrameSet, moments: GroupMoments, mean: np.ndarray, light: np.ndarray | None
) -> tuple[np.ndarray, float]:
    """Temporal variance of each cell, and its relative standard error; what whole rows, parts or all the light do is out."""
    square = np.zeros_like(_cells(mean))
    indices = _chosen(moments)
    for i in indices:
        r = frames.read(i) - mean
        if light is not None:
            r -= float((r * light).sum() / (light * light).sum()) * light
        r -= r.mean(1, keepdims=True)
        cells = _cells(r)
        square += (cells - cells.mean((1, 2, 4, 5), keepdims=True)) ** 2
    square /= len(indices) - 1
    variance = _by_cell(square)
    if not variance.any():
        return variance, 0.0
    # Of one law, the variances of the pixels scatter by the same share in every cell.
    share = (_by_cell(square**2).mean() / (variance**2).mean() - 1) / (square.shape[1] * square.shape[4])
    return variance, math.sqrt(float(share))


def _chosen(moments: GroupMoments) -> tuple[int, ...]:
    return moments.group.indices[:12]  # enough frames of a level


def _cells(values: np.ndarray) -> np.ndarray:
    """(parts, pairs, 2, parts, pairs, 2) of rows and columns; what is left over at the edges is cut off."""
    rows, columns = (n // (2 * _PARTS) for n in values.shape)
    cut = values[: 2 * _PARTS * rows, : 2 * _PARTS * columns]
    return cut.reshape(_PARTS, rows, 2, _PARTS, columns, 2)


def _by_cell(cells: np.ndarray) -> np.ndarray:
    return cells.mean((1, 4)).transpose(0, 2, 1, 3)
