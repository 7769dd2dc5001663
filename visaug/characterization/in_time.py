"""Whether frames of a group differ by noise alone: stale frames, hits of cosmic rays, bands of a lamp."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import ndimage, optimize, stats

from visaug.characterization.defective import donors
from visaug.characterization.facts import Facts
from visaug.characterization.groups import COLLAPSE, Measured
from visaug.characterization.moments import GroupMoments
from visaug.characterization.views import repaired, replaced
from visaug.frames import FrameSet, Group
from visaug.frames.checks import PILED_SHARE
from visaug.statistics.findings import FALSE_ALARM, FROM_NOISE, Findings
from visaug.statistics.kernels import median_of, rank_values


def without_stale(
    frames: FrameSet, facts: list[Facts], groups: Sequence[Group], found: Findings
) -> tuple[FrameSet, list[Facts]]:
    """Without a dark or bias frame whose mean is apart from its group's, by Grubbs's test (F. E. Grubbs, Technometrics 11
    (1969) 1). Flats of another level are a level of their own.
    """
    stale = []
    for group in groups:
        if group.kind == "flat" or len(group.indices) < 4:
            continue
        means = np.array([facts[i].mean for i in group.indices])
        worst = int(np.abs(means - np.median(means)).argmax())
        if _grubbs(means, worst) < 5e-4:  # such an outlier has one group of sound frames
            stale.append(group.indices[worst])
    if not stale:
        return frames, facts
    numbers = ", ".join(str(frames.records[i].sequence) for i in sorted(stale))
    found.warn(
        f"stale_frame: the level of frames {numbers} is not that of the others of their setting (the first "
        "frame after a change may have the old one); they are excluded"
    )
    kept = [i for i in range(len(frames)) if i not in stale]
    return frames.subset(kept), [facts[i] for i in kept]


def _grubbs(values: np.ndarray, worst: int) -> float:
    """Probability of a value as far out among normal ones; two-sided, Bonferroni's bound."""
    n = len(values)
    others = np.delete(values, worst)
    spread = float(others.std(ddof=1))
    apart = abs(float(values[worst] - others.mean()))
    t = apart / max(spread * math.sqrt(n / (n - 1)), 1e-12)
    return min(2 * n * float(stats.t.sf(t, n - 2)), 1.0)


@dataclass
class _Peaks:
    """Greatest and second greatest value of every pixel of a group, and the frame of the greatest."""

    first: np.ndarray
    second: np.ndarray
    frame: np.ndarray
    dip: float  # greatest distance of a pixel's least value from its second least, DN
    noise: float  # of single pixels, DN
    cut: bool  # whether noise is cut at 0, so that only its upper half is seen

    @cached_property
    def level(self) -> float:
        """Median of the second greatest values, DN."""
        return float(median_of(self.second))

    @property
    def full(self) -> bool:
        """Whether pixels pile up at one value, the converter's top: what is left of their noise is not that of the others."""
        return float((self.first == self.first.max()).mean()) > PILED_SHARE


def without_hits(frames: FrameSet, groups: Sequence[Group], found: Findings) -> FrameSet:
    """The frames with a neighbour's value where a pixel is far brighter in one frame than in the others of its group.
    A hit is one pixel, or two or three in a line in one frame, whose greatest value is farther from the second greatest than
    noise of the group's law would have it anywhere in the set (once in 1000 sets). Noise has tails on both sides, but hits
    brighten: where pixels of dark frames fall below their other values by more than normal noise, hits must exceed that by
    far. Flats whose noise is less than that of their light are saturated: most pixels stay at one value there, and what a few
    have in one frame is no hit. A pixel that is hit in more groups than chance allows jumps by itself.
    """
    several = [g for g in groups if len(g.indices) > 1]
    peaks = [_peaks(frames, g) for g in several]
    whole = [(p, len(g.indices)) for g, p in zip(several, peaks) if g.kind != "flat" and not p.cut]
    dips = [(p, n) for p, n in whole if n > 2]
    tail = _tail(dips)
    darks = [p for g, p in zip(several, peaks) if g.kind != "flat"]
    quiet, floor = (min(map(of, darks), default=0.0) for of in (lambda p: p.noise, lambda p: p.level))
    gain = _rough_gain([p for g, p in zip(several, peaks) if g.kind == "flat"], quiet, floor)
    hits: list[tuple[int, np.ndarray, np.ndarray]] = []
    seen: dict[tuple[int, int], np.ndarray] = {}
    edge = 3.0  # standard deviations above which a pixel beside a hit belongs to it
    for group, p in zip(several, peaks):
        light = max(p.noise**2 - quiet**2, 0.0)
        is_saturated = p.full or (group.kind == "flat" and light < COLLAPSE * gain * (p.level - floor))
        if is_saturated or p.cut or (group.kind != "flat" and not dips):
            continue
        shot = np.maximum(p.second - p.level, 0.0) * gain  # bright pixels have more of it
        noise = np.sqrt(p.noise**2 + shot)
        apart = np.maximum(p.first - p.second - found.step_dn, 0.0)  # rounding adds up to one step
        excess = np.where(apart > tail, apart / noise, 0.0)
        hit = _hits(excess, p.frame, len(group.indices), len(several), gain * light / p.noise**3)
        if not hit.any():
            continue
        before = seen.setdefault(hit.shape, np.zeros(hit.shape, np.uint8))
        before += hit
        for n, i in enumerate(group.indices):
            mine = p.frame == n
            if (hit & mine).any():
                hits.append((i, hit & mine, (excess > edge) & mine))
    most = {shape: _most_often(counts, len(several)) for shape, counts in seen.items()}
    chosen = {}
    for i, hit, bright in hits:
        if (hit := hit & (seen[hit.shape] <= most[hit.shape])).any():
            chosen[i] = hit | (ndimage.binary_dilation(hit, np.ones((3, 3), bool)) & bright)
    if not chosen:
        return frames
    pixels = sum(int(m.sum()) for m in chosen.values())
    values = sum(p.first.size * len(g.indices) for g, p in zip(several, peaks))
    # As many faint ends of tracks at six standard deviations add 2 % to the variance.
    is_dense = pixels > 5e-4 * values
    found.warn(
        f"cosmic_rays: {pixels} values in {len(chosen)} frames are far brighter than the same pixels of the "
        "other frames of their setting and are excluded"
        + ("; so many leave faint ends that add to the noise and that neighbours share" if is_dense else ""),
        spoils=FROM_NOISE if is_dense else (),
    )
    sources = {i: (np.nonzero(m), donors(m)) for i, m in chosen.items()}

    def change(frame: np.ndarray, i: int) -> np.ndarray:
        return replaced(frame, *sources[i]) if i in sources else frame

    return repaired(frames, change)


def _tail(dips: Sequence[tuple[_Peaks, int]]) -> float:
    """Least gap of a hit, DN, by the tails of the read noise in all quiet groups of dark frames (with the number of
    their frames), as few values show less of them; 0 where these are normal.
    """
    least = min((p.noise for p, _ in dips), default=0.0)
    quiet = [(p, n) for p, n in dips if p.noise <= 1.1 * least]
    size = sum(p.first.size for p, _ in quiet)
    # Dips of normal noise count as heavy tails in one set of ten. With tails of a power of 6.7 (Tukey-lambda of -0.15) as many
    # values exceed three times their greatest dip once in 1000.
    heavy = [p.dip for p, n in quiet if p.dip > _normal_gap(float(f"{0.1 / size:.2e}"), n) * p.noise + 1]
    return 3.0 * max(heavy, default=0.0)


def _most_often(counts: np.ndarray, groups: int) -> int:
    """In how many groups a pixel may be hit: where hits fall by chance, more happens in one set of ten; 0 for no hits at all.
    Where more pixels than by chance (once in 1000 sets) are hit again, pixels jump by themselves; where they are a tenth of
    those that were hit, the others may be such pixels too.
    """
    share = float(counts.sum()) / counts.size / groups
    again = int((counts > 1).sum())
    jumping = 0.1  # share of the pixels with a hit that have another
    if stats.poisson.sf(again - 1, counts.size * stats.binom.sf(1, groups, share)) < FALSE_ALARM:
        return 0 if again > jumping * (counts > 0).sum() else 1
    return next(k for k in range(1, groups + 1) if counts.size * stats.binom.sf(k, groups, share) < 0.1)


def _hits(excess: np.ndarray, frame: np.ndarray, n: int, groups: int, skewness: float) -> np.ndarray:
    """(H, W) pixels whose gap to the second greatest of n values, in noises, is no noise's: alone, or two or three in a line."""
    allowed = FALSE_ALARM / groups / excess.size / 3  # of a pixel, for each length
    hit = excess > _gap(allowed, n, skewness)
    lines = ((0, 1), (1, 0), (1, 1), (1, -1))  # directions in which pixels of a track adjoin
    for length in (2, 3):
        # Pixels in a line, all brightest in one frame: four directions, n frames.
        chance = (allowed / len(lines) * n ** (length - 1)) ** (1 / length)
        bright = excess > _gap(chance, n, skewness)
        for down, across in lines:
            line = bright.copy()
            for k in range(1, length):
                line &= _moved(bright, k * down, k * across) & (_moved(frame, k * down, k * across) == frame)
            for k in range(length):
                hit |= _moved(line, -k * down, -k * across)
    return hit


def _moved(values: np.ndarray, down: int, across: int) -> np.ndarray:
    """At each pixel the value of the one `down` and `across` of it; 0 beyond the edge."""
    padded = np.pad(values, [(abs(down),) * 2, (abs(across),) * 2])
    height, width = values.shape
    r, c = abs(down) + down, abs(across) + across
    return padded[r : r + height, c : c + width]


@lru_cache(maxsize=256)
def _normal_gap(chance: float, n: int) -> float:
    """Gap between the greatest and the second greatest of n normal values that is exceeded with probability `chance`."""
    x = np.linspace(-4, 14, 4001)
    log_density = stats.norm.logpdf(x) + math.log(n)

    def excess(gap: float) -> float:
        logs = log_density + (n - 1) * stats.norm.logcdf(x - gap)
        return float(np.logaddexp.reduce(logs)) + math.log(x[1] - x[0]) - math.log(chance)

    return float(optimize.root_scalar(excess, bracket=(0.0, 14.0)).root)


def _gap(chance: float, n: int, skewness: float) -> float:
    """The same of a law with the skewness of few electrons, by the first term of Cornish and Fisher's expansion."""
    gap = _normal_gap(float(f"{chance:.2e}"), n)
    return gap + skewness * gap**2 / 6


def _peaks(frames: FrameSet, group: Group) -> _Peaks:
    """In one pass; the change of whole frames, of the rows of flats too (a lamp that flickers), is taken out."""
    one = frames.read(group.indices[0])
    wide = 48  # columns, of which the median has less than a fifth of a pixel's noise
    by_rows = group.kind == "flat" and one.shape[1] >= wide
    level = _levels(one, by_rows)
    first, least, before = one.copy(), one.copy(), one
    second, next_least = np.full_like(one, -np.inf), np.full_like(one, np.inf)
    which = np.zeros(one.shape, np.uint16)
    steps = []
    for n, i in enumerate(group.indices[1:], start=1):
        frame = frames.read(i)
        frame = frame + (level - _levels(frame, by_rows)).astype(np.float32)
        steps.append(rank_values(frame, before, n, first, second, which, least, next_least) / one.size)
        before = frame
    # of normal noise, from the mean absolute difference
    noise = max(0.5 * math.sqrt(math.pi) * float(np.median(steps)), 0.5)
    dip, is_cut = float((next_least - least).max()), float((one == 0).mean()) > PILED_SHARE
    return _Peaks(first, second, which, dip, noise, is_cut)


def _levels(frame: np.ndarray, by_rows: bool) -> np.ndarray:
    """Median of each row, (H, 1), or of the frame, (1, 1)."""
    return np.median(frame, 1, keepdims=True) if by_rows else np.full((1, 1), median_of(frame))


def _rough_gain(flats: Sequence[_Peaks], quiet: float, floor: float) -> float:
    """DN per electron from the noise of the brightest flats, without any care.

    Args:
        quiet: least noise of dark frames, DN.
        floor: level of the darkest of them, DN.
    """
    bright = max(flats, key=lambda p: p.noise, default=None)
    if bright is None or bright.level <= floor:
        return 0.0
    return max(bright.noise**2 - quiet**2, 0.0) / (bright.level - floor)


def without_bands(measured: Measured, found: Findings) -> Measured:
    """Levels that know what rows share in flats and not in dark frames, which light that changes within a frame adds."""
    tested = [v for v in measured.levels if v.flat.n > 1 and v.dark.n > 1 and v.signal > 0]
    banded = [v for v in tested if _excess_p(v.flat, v.dark) < FALSE_ALARM / len(tested)]
    if not banded:
        return measured
    if any(_rolls(measured.frames, v.flat, v.dark) for v in banded):
        records = measured.frames.records
        found.banded = frozenset(records[i].sequence for v in measured.levels for i in v.flat.group.indices)
    share = max(math.sqrt(band_variance(v.flat, v.dark)) / v.signal for v in banded)
    found.warn(
        f"lamp_band: in flats whole rows change together from frame to frame by {share:.2%} of the light, "
        "more than in dark frames (a lamp that flickers while rows are exposed one after the other); what "
        "it adds to the variance is taken out of gain_e_per_dn, not of the emva figures",
        spoils=("emva.system_gain_dn_per_e", "emva.quantum_efficiency", "emva.saturation_e", "emva.dark_noise_e",
                "emva.dsnu_e", "emva4.*_e", "emva4.prnu_row", "emva4.snr_*"),
    )  # fmt: skip
    levels = tuple(replace(v, band_variance=band_variance(v.flat, v.dark)) for v in measured.levels)
    return replace(measured, levels=levels)


def _rolls(frames: FrameSet, flat: GroupMoments, dark: GroupMoments) -> bool:
    """Whether rows still change together where a change of the whole light, which moves each by its own signal, is taken out."""
    rows = np.array([frames.read(i).mean(1, dtype=np.float64) for i in flat.group.indices])
    change = rows - rows.mean(0)
    basis = np.stack([np.ones(rows.shape[1]), flat.row_means], 1)
    change = change - (basis @ np.linalg.lstsq(basis, change.T, rcond=None)[0]).T
    df = (len(rows) - 1) * (rows.shape[1] - 2)
    expected = _expected_rows(flat, dark) / flat.shape[1]
    rolling = 1.5  # variance of row means over what noise gives them
    return expected > 0 and float((change**2).sum()) / df > rolling * expected


def _expected_rows(flat: GroupMoments, dark: GroupMoments) -> float:
    """Mean square of the rows of flats by the noise of their pixels and what rows share in dark frames."""
    f, d = flat.temporal, dark.temporal
    return 0.0 if f is None or d is None else f.pixel + max(d.row - d.pixel, 0.0)


def _excess_p(flat: GroupMoments, dark: GroupMoments) -> float:
    """Probability of the mean square of the rows of flats."""
    f, d, expected = flat.temporal, dark.temporal, _expected_rows(flat, dark)
    return float(stats.f.sf(f.row / expected, f.row_df, d.row_df)) if f and d and expected > 0 else 1.0


def band_variance(flat: GroupMoments, dark: GroupMoments) -> float:
    """Variance of what rows share in flats above that in dark frames, DN^2."""
    f, d = flat.temporal, dark.temporal
    if f is None or d is None:
        return 0.0
    return max((f.row - f.pixel) - max(d.row - d.pixel, 0.0), 0.0) / flat.shape[1]
