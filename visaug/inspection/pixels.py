"""Single pixels and lines that stand out: hot, dead, unstable; and the fixed pattern of all pixels."""

import math
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import stats

from visaug.core.constants import MAD
from visaug.core.wording import counted, number
from visaug.inspection.finding import ALPHA, Finding, Size, deviation, some
from visaug.inspection.material import FAR, FrameGroup


def line_defects(look: FrameGroup, axis: str) -> tuple[Finding | None, np.ndarray]:
    """Rows far from their neighbours in the mean frame, or without noise of their own; and which they are."""
    # without single pixels
    middle = np.asarray(stats.trim_mean(look.frames.mean(0, dtype=np.float64), 0.1, axis=1))
    off = _apart(middle)
    height, width = look.shape
    scale = max(MAD * float(np.median(np.abs(off))), look.noise_dn / math.sqrt(look.count * width), 0.02)
    # A wave or a bump has tops above both sides, but no higher than lines elsewhere, or next to them, differ.
    change = np.abs(np.diff(middle))
    aside = np.maximum(np.pad(change, (2, 0))[:-1], np.pad(change, (0, 2))[1:])  # of two lines on either side
    bad = np.abs(off) > np.maximum(max(FAR * scale, 3 * float(np.quantile(change, 0.9))), 3 * aside)
    quiet = 0.05  # of the usual variance: a line with less follows no signal
    if look.count > 1:
        own = (look.frames - look.frames.mean(0)).var((0, 2), dtype=np.float64)
        bad |= own < quiet * np.median(own)
    if not 0 < bad.sum() <= height // 10:
        return None, np.zeros(height, bool)
    which = np.flatnonzero(bad)
    heights = off[which]
    lines = f"{counted(len(which), axis)} ({some(which.tolist(), 5)})"
    typical = float(np.median(np.abs(heights)))
    places = [(int(k), -1) if axis == "row" else (-1, int(k)) for k in which]
    finding = Finding(
        "line_defects",
        look.fixed,
        f"{lines} stand{'' if len(which) > 1 else 's'} out from the neighbours by {number(typical)} DN.",
        f"{len(which)} defective {lines.partition(' ')[2]}",
        look.count * width * float(np.log1p((heights / max(look.noise_dn, 0.3)) ** 2).sum()) + 50,
        **_about(typical, scale / math.sqrt(len(which))),
        share=len(which) / height,
        axis=axis,
        places=tuple((*place, "line", float(h)) for place, h in zip(places, heights)),
        shown={"image": look.frames.mean(0)},
    )
    return finding, bad


def _about(value: float, error: float) -> Size:
    """The typical size of defects, within two standard errors."""
    return {"amplitude_dn": value, "low": max(value - 2 * error, 0.0), "high": value + 2 * error}


def _apart(profile: np.ndarray) -> np.ndarray:
    """How far each line lies from those on both sides, by the nearer side; 0 where it lies between them.

    A step or a slope moves lines from one side only. Beyond the ends lines go on in a straight line.
    """
    x = np.arange(1, 5)
    ends = [np.polyval(np.polyfit(x, part[1:5], 1), [-1, 0]) for part in (profile, profile[::-1])]
    ahead = [float(np.polyval(np.polyfit(x, part[1:5], 1), 0)) for part in (profile, profile[::-1])]
    padded = np.concatenate([ends[0], profile, ends[1][::-1]])
    before = (padded[1:-3] + padded[:-4]) / 2
    after = (padded[3:-1] + padded[4:]) / 2
    before[0], after[-1] = ahead
    low, high = profile - before, profile - after
    return np.where(low * high > 0, np.where(np.abs(low) < np.abs(high), low, high), 0.0)


def pixel_findings(look: FrameGroup) -> list[Finding]:
    """Hot, dead and unstable pixels, and the fixed pattern of all of them where it is strong."""
    if not look.is_uniform:
        return []
    hot, dead = _standing_out(look)
    jumps = _jumps(look, _unstable(look) & ~hot & ~dead)
    found = _defects(look, "hot", hot), _defects(look, "dead", dead), jumps, _pattern(look)
    return [f for f in found if f is not None]


def _standing_out(look: FrameGroup) -> tuple[np.ndarray, np.ndarray]:
    """Pixels above, and below, all others in every frame.

    Far from the robust scatter of the mean frame, and in each frame farther than temporal noise, with the tails that it
    has, brings any pixel in all of them.
    """
    pattern = look.raw.pattern_pixels
    scale = max(MAD * float(np.median(np.abs(pattern))), 0.3)
    far = np.abs(pattern) > FAR * scale
    if far.any():
        far[far] = _lone(look.raw.mean, far, FAR / 2 * scale)
    if look.count > 1 and far.any():
        limit = _reach(look)
        each = look.frames[:, far] - (look.raw.mean - pattern)[far]
        least = (each * np.sign(pattern[far])).min(0)
        far[far] = least > np.maximum(limit, 0.5 * np.abs(pattern[far]))
    still = np.zeros(look.shape, bool)
    stuck = 4  # frames in which a pixel has one value while the others have noise
    if look.count > 1 and look.noise_variance > 0.5:
        still = np.ptp(look.frames, axis=0) == 0 if look.count >= stuck else still
        still &= pattern < -4 * math.sqrt(look.pattern_variance)
    return far & (pattern > 0), (far & (pattern < 0)) | still


def _lone(image: np.ndarray, where: np.ndarray, least: float) -> np.ndarray:
    """Which of the chosen pixels are far from the pixels around them, which change less: a steep slope is no defect."""
    reach = 3  # px on either side, that a defect is compared with
    padded = np.pad(image, reach, mode="reflect", reflect_type="odd")  # beyond an edge as steep as before it
    around = sliding_window_view(padded, (2 * reach + 1, 2 * reach + 1))[where].reshape(int(where.sum()), -1)
    low, middle, high = np.quantile(around, [0.25, 0.5, 0.75], axis=1)
    return np.abs(image[where] - middle) > np.maximum(least, 3 * (high - low))


def _reach(look: FrameGroup) -> float:
    """DN from which temporal noise alone is not found at one pixel in all frames."""
    size = np.sort(np.abs(look.raw.noise_pixels.ravel()[:: max(1, look.frames.size // 2_000_000)]))
    share = (ALPHA / (look.shape[0] * look.shape[1])) ** (1 / look.count)
    return float(size[int((1 - share) * (len(size) - 1))])


def _unstable(look: FrameGroup) -> np.ndarray:
    """Pixels whose frames part into levels: the range of their values without the extremes is wider than chance makes it.

    Chance: the frames of other pixels, dealt anew, so that the tails of the noise are its own.
    """
    none = np.zeros(look.shape, bool)
    n = look.count
    least_frames = 6  # that tell a pixel of two levels from noise
    if n < least_frames:
        return none
    noise = look.raw.noise_pixels.reshape(n, -1)
    cut = max(1, n // 8)
    spread = _inner_range(noise, cut)
    usual = np.flatnonzero(spread <= np.quantile(spread, 0.995))
    pool = noise[:, usual[:: max(1, len(usual) // 200_000)]]  # tells the law of what noise does
    rng = np.random.default_rng(0)
    draws = 8  # times that the frames are dealt anew to the pixels
    chance = np.concatenate([_inner_range(rng.permuted(pool, axis=1), cut) for _ in range(draws)])
    edge, top = np.quantile(chance, [0.999, 0.9999])
    decay = max((top - edge) / math.log(10), 1e-6)  # exponential beyond
    limit = edge + decay * math.log(1e-3 * spread.size / ALPHA)
    return (spread > 1.1 * limit).reshape(look.shape)


def _inner_range(noise: np.ndarray, cut: int) -> np.ndarray:
    ordered = np.partition(noise, (cut, noise.shape[0] - 1 - cut), axis=0)
    return ordered[noise.shape[0] - 1 - cut] - ordered[cut]


def _defects(look: FrameGroup, word: str, where: np.ndarray) -> Finding | None:
    if not where.any():
        return None
    heights = look.raw.pattern_pixels[where].astype(np.float64)
    typical = float(np.median(np.abs(heights)))
    error = look.noise_dn / math.sqrt(look.count) / math.sqrt(len(heights))
    pixels = counted(len(heights), f"{word} pixel")
    places = some([f"({row}, {column})" for row, column in np.argwhere(where)[:5]], 4)
    side = "above" if word == "hot" else "below"
    return Finding(
        f"{word}_pixels",
        look.fixed,
        f"{pixels} at (row, column) {places}: {number(typical)} DN {side} the neighbours{' in every frame' if look.fixed else ''}.",
        pixels,
        look.count * float(np.log1p((heights / max(look.noise_dn, 0.3)) ** 2).sum()),
        **_pixels(where, word, heights, typical, error),
        shown={"image": look.raw.mean, "where": where},
    )


def _pixels(where: np.ndarray, word: str, heights: np.ndarray, usual: float, error: float) -> dict[str, Any]:
    """What findings of single pixels have in common: size, share and places."""
    places = list(zip(*np.nonzero(where), heights))[:20_000]  # defects listed at most
    return {
        **_about(usual, error),
        "share": len(heights) / where.size,
        "details": {"pixels": len(heights)},
        "places": tuple((int(r), int(c), word, float(h)) for r, c, h in places),
    }


def _jumps(look: FrameGroup, where: np.ndarray) -> Finding | None:
    if not where.any():
        return None
    noise = look.raw.noise_pixels[:, where]
    size = _inner_range(noise, max(1, look.count // 8))
    typical, count = float(np.median(size)), len(size)
    error = 1.25 * float(np.std(size)) / math.sqrt(count) + look.noise_dn / math.sqrt(count)
    pixels, jump = counted(count, "unstable pixel"), "they jump" if count > 1 else "it jumps"
    return Finding(
        "unstable_pixels",
        "per_frame",
        f"{pixels}: {jump} between levels about {number(typical)} DN apart from frame to frame.",
        pixels,
        float(np.log1p((noise / max(look.noise_dn, 0.3)) ** 2).sum()),
        **_pixels(where, "unstable", size, typical, error),
        shown={"frames": look.frames, "where": where},
    )


def pixel_pattern(look: FrameGroup) -> Size:
    """Standard deviation of the fixed pattern of the pixels, DN, with its interval; nothing for one frame."""
    freedom = look.shape[0] * look.shape[1] / 1.5
    return deviation(look.pattern_variance, freedom, look.noise_variance / look.count)


def _pattern(look: FrameGroup) -> Finding | None:
    if look.count < 2:
        return None
    size = pixel_pattern(look)
    strong = 0.5  # of the variance of the temporal noise: more has the fixed pattern of no ordinary sensor in the dark
    strong_lit = 0.03  # of the level: photo response non-uniformity is below one or two per cent
    if size["low"] ** 2 <= strong * look.noise_variance:
        return None
    if look.is_lit and size["low"] < strong_lit * float(look.data.level):
        return None
    value = size["amplitude_dn"]
    return Finding(
        "pixel_pattern",
        "fixed",
        f"Each pixel has its own offset with a standard deviation of {number(value)} DN, the same in every frame; the temporal "
        f"noise is {number(look.noise_dn)} DN.",
        f"pixel offsets of {value:.2g} DN, fixed",
        look.shape[0] * look.shape[1] * math.log1p(look.count * value**2 / look.noise_variance),
        **size,
        shown={"image": look.data.mean},
    )
