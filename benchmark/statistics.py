"""About a hundred plain statistics of a frame set, the kind that any sensor textbook computes.

They serve one purpose: to say how strong a hidden effect is. Variances enter as logarithms and counts as 2
sqrt(n + 3/8) (Anscombe), so that eight standard deviations mean much the same everywhere. Means and
variances are taken after outliers were clipped, so that one odd pixel is one count and not a giant
variance. All in DN unless said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import binary_dilation, laplace, uniform_filter1d
from scipy.stats import chi2

from .camera import Sensor, Shot

Stats = dict[str, float]


def measure(
    frames: np.ndarray, plan: Sequence[Shot], targets: Mapping[str, np.ndarray], sensor: Sensor
) -> Stats:
    """All statistics of a set. `sensor` is the stated camera.

    It predicts the scenes and scales thresholds.
    """
    groups: dict[tuple, list[int]] = {}
    after: dict[str, list[int]] = {}
    for i, shot in enumerate(plan):
        if shot.kind == "dark" and i and plan[i - 1].kind == "scene":
            after.setdefault(plan[i - 1].target or "", []).append(i)
        else:
            groups.setdefault((shot.kind, shot.seconds, shot.celsius, shot.photons, shot.target), []).append(
                i
            )
    stacks = {key: frames[index].astype(float) for key, index in groups.items()}

    stats: Stats = {}
    bias_map = np.full(sensor.shape, float(sensor.pedestal_dn))
    for key, stack in stacks.items():
        if key[0] == "bias":
            bias_map = _tame(stack.mean(0), 10)
            stats |= _bias(stack)
    stats |= _darks({k: s for k, s in stacks.items() if k[0] == "dark"}, bias_map)
    stats |= _flats({k: s for k, s in stacks.items() if k[0] == "flat"}, bias_map)
    for key, stack in stacks.items():
        if key[0] == "scene":
            stats |= _scene(str(key[4]), stack.mean(0), targets[str(key[4])], sensor)
    for target, index in after.items():
        stats |= _residue(target, frames[index].mean(0) - bias_map, targets[target])
    return stats | _codes(frames)


def is_count(name: str) -> bool:
    """Counts get a standard deviation of at least one, Anscombe's."""
    return "count" in name


def _count(mask: np.ndarray) -> float:
    return float(2 * np.sqrt(np.count_nonzero(mask) + 3 / 8))


def _log(variance: float) -> float:
    return float(np.log(max(variance, 1e-12)))


def _robust(x: np.ndarray) -> float:
    low, high = np.percentile(x, [25, 75])
    return max(float(high - low) / 1.349, 1e-3)


def _tame(x: np.ndarray, limit: float = 7) -> np.ndarray:
    """Clip at so many robust standard deviations from the median."""
    reach = limit * _robust(x)
    middle = np.median(x)
    return np.clip(x, middle - reach, middle + reach)


def _lag(x: np.ndarray, axis: int, step: int = 1) -> float:
    """Correlation with the neighbour along an axis; x has no mean."""
    near = [slice(None)] * x.ndim
    far = [slice(None)] * x.ndim
    near[axis], far[axis] = slice(None, -step), slice(step, None)
    return float((x[tuple(near)] * x[tuple(far)]).mean() / max((x * x).mean(), 1e-12))


def _peak(series: np.ndarray) -> float:
    """Logarithm of the largest line in the mean periodogram over its median; series is (..., length)."""
    power = (np.abs(np.fft.rfft(series - series.mean(-1, keepdims=True), axis=-1)) ** 2).reshape(
        -1, series.shape[-1] // 2 + 1
    )
    power = power.mean(0)[1:]
    return _log(power.max() / max(np.median(power), 1e-12))


def _map(label: str, image: np.ndarray) -> Stats:
    """A fixed pattern: rows, columns, pixels, parity, seams, coarse shape."""
    image = image - image.mean()
    rows = np.median(image, axis=1, keepdims=True)
    columns = np.median(image - rows, axis=0, keepdims=True)
    white = image - rows - columns
    high, low = white > 6 * _robust(white), white < -6 * _robust(white)
    image = rows + columns + _tame(white, 6)
    image = image - image.mean()
    rows, columns = image.mean(1), image.mean(0)
    white = image - rows[:, None] - columns[None, :]
    height, width = image.shape
    blocks = image[: height // 4 * 4, : width // 4 * 4].reshape(4, height // 4, 4, width // 4).mean((1, 3))
    stats = {
        f"{label} row variance": _log(rows.var()),
        f"{label} column variance": _log(columns.var()),
        f"{label} pixel variance": _log(white.var()),
        f"{label} high count": _count(high),
        f"{label} low count": _count(low),
        f"{label} row peak": _peak(rows),
        f"{label} column peak": _peak(columns),
        f"{label} parity": float(rows[1::2].mean() - rows[: height // 2 * 2 : 2].mean()),
        f"{label} coarse largest": float(np.abs(blocks).max()),
        f"{label} coarse variance": _log(blocks.var()),
        f"{label} corner over middle": float(blocks[::3, ::3].mean() - blocks[1:3, 1:3].mean()),
        f"{label} lag across": _lag(white, 1),
        f"{label} lag down": _lag(white, 0),
    }
    for name, line in (("row", rows), ("column", columns)):
        n = line.size
        steps = [abs(line[k:].mean() - line[:k].mean()) for k in range(int(0.35 * n), int(0.65 * n))]
        stats[f"{label} {name} seam"] = float(max(steps))
        stats[f"{label} {name} slope"] = float(np.polyfit(np.linspace(-1, 1, n), line, 1)[0])
    return stats


def _bias(stack: np.ndarray) -> Stats:
    n = stack.shape[0]
    fixed = stack.mean(0)
    noise = (stack - fixed) * np.sqrt(n / (n - 1))
    frame = noise.mean((1, 2))
    inside = noise - frame[:, None, None]
    spread = _robust(inside)
    wild = np.abs(inside) > 8 * spread
    per_pixel = inside.var(0) / np.median(inside.var(0)) * chi2.median(n - 1)
    inside = _tame(inside)
    rows, columns = inside.mean(2), inside.mean(1)
    low, high = np.percentile(inside, [0.05, 99.95])
    shoulder = np.percentile(inside, [2.5, 97.5])
    return {
        "bias mean": float(_tame(fixed).mean()),
        "bias variance": _log(inside.var()),
        "bias frame variance": _log(frame.var()),
        "bias frame walk": float((frame[1:] * frame[:-1]).mean() / max(frame.var(), 1e-12)),
        "bias row-noise variance": _log(rows.var()),
        "bias column-noise variance": _log(columns.var()),
        "bias row-noise peak": _peak(rows),
        "bias row-noise slow": _log(uniform_filter1d(rows, 8, axis=1)[:, 4:-4].var()),
        "bias lag across": _lag(inside, 2),
        "bias lag down": _lag(inside, 1),
        "bias lag across 8": _lag(inside, 2, 8),
        "bias skewness": float((inside**3).mean() / inside.std() ** 3),
        "bias tails": float(np.log((high - low) / spread)),
        "bias shoulder": float(np.log((shoulder[1] - shoulder[0]) / spread)),
        "bias far count": _count(wild),
        "bias jumpy pixel count": _count(per_pixel > chi2.isf(1e-5, n - 1)),
    } | _map("bias map", fixed)


def _darks(stacks: dict[tuple, np.ndarray], bias_map: np.ndarray) -> Stats:
    stats: Stats = {}
    longest: dict[float, tuple] = {}
    for key in sorted(stacks):
        stack = stacks[key]
        stats[f"dark {key[1]:g} s {key[2]:g} C mean"] = float(_tame(stack.mean(0)).mean())
        stats[f"dark {key[1]:g} s {key[2]:g} C variance"] = _log(_tame(stack - stack.mean(0)).var())
        longest[key[2]] = key
    single = 0
    for stack in stacks.values():
        usual = np.sort(stack, axis=0)[: stack.shape[0] // 2 + 1].mean(0)
        rise = stack - usual
        single += np.count_nonzero(rise > 9 * _robust(rise) + 3)
    stats["dark single-frame count"] = float(2 * np.sqrt(single + 3 / 8))
    for celsius, key in longest.items():
        image = stacks[key].mean(0) - bias_map
        white = image - np.median(image)
        label = f"dark map {celsius:g} C"
        stats |= _map(label, image)
        stats[f"{label} hot count"] = _count(white > 25 * _robust(white))
        stats[f"{label} quantile"] = float(np.log((np.percentile(white, 99.5) + 1e-3) / _robust(white)))
    return stats


def _flats(stacks: dict[tuple, np.ndarray], bias_map: np.ndarray) -> Stats:
    stats: Stats = {}
    keys = sorted(stacks, key=lambda key: key[3])
    wander, first, lags = [], [], []
    top = max(stack.mean() for stack in stacks.values()) if stacks else 0.0
    for place, key in enumerate(keys):
        stack = stacks[key]
        defect = np.abs(_tame(stack.mean(0), 10) - stack.mean(0)) > 0
        if place == len(keys) - 2:
            stats["flat defect count"] = _count(defect)
        stack = np.where(defect, np.median(stack), stack)
        signal = stack.mean() - bias_map.mean()
        stats[f"flat {place} mean"] = _log(signal)
        frame = stack.mean((1, 2)) - bias_map.mean()
        noise = stack - stack.mean(0)
        noise = _tame(noise - noise.mean((1, 2), keepdims=True))
        stats[f"flat {place} variance"] = _log(noise.var())
        if signal > 0.97 * top and np.median(stack) >= stack.max():
            continue  # clipped
        wander.append(frame / frame.mean() - 1)
        first.append(frame[0] / frame[1:].mean() - 1)
        lags.append((_lag(noise, 2), _lag(noise, 1), _lag(noise, 2, 2), _lag(noise, 1, 2)))
        if place in (len(keys) // 2, len(keys) - 2):
            stats |= _map(f"flat {place} map", (stack.mean(0) - bias_map) / signal)
    if wander:
        steady = wander[len(wander) // 2 :]
        stats["flat frame wander"] = _log(np.square(steady).sum() / (len(steady) * 2))
        stats["flat wander across levels"] = _log(np.square(wander).mean())
        stats["flat first frame"] = float(np.median(first))
        for name, column in zip(("across", "down", "across 2", "down 2"), np.transpose(lags), strict=True):
            stats[f"flat lag {name}, low"] = float(column[:3].mean())
            stats[f"flat lag {name}, high"] = float(column[-3:].mean())
    return stats


def _shifted(mask: np.ndarray, dy: int, dx: int) -> np.ndarray:
    out = np.zeros_like(mask)
    h, w = mask.shape
    if abs(dy) >= h or abs(dx) >= w:
        return out
    out[max(dy, 0) : h + min(dy, 0), max(dx, 0) : w + min(dx, 0)] = mask[
        max(-dy, 0) : h + min(-dy, 0), max(-dx, 0) : w + min(-dx, 0)
    ]
    return out


def _scene(target: str, image: np.ndarray, clean: np.ndarray, sensor: Sensor) -> Stats:
    """Measured minus predicted, around bright structure."""
    electrons = np.minimum(sensor.efficiency * clean, sensor.well_e)
    rest = image - electrons / sensor.e_per_dn - sensor.pedestal_dn
    noise = np.sqrt(electrons + sensor.read_e**2 + (sensor.prnu[2] * electrons) ** 2) / sensor.e_per_dn
    rest = _tame(rest / noise, 15) * noise
    full = sensor.well_e / sensor.efficiency
    bright = clean > (0.25 if target != "spot" else 1.0) * full
    dark = clean < 0.05 * full
    height, width = rest.shape
    blocks = rest[: height // 4 * 4, : width // 4 * 4].reshape(4, height // 4, 4, width // 4).mean((1, 3))
    stats = {
        f"{target} mean": float(rest.mean()),
        f"{target} coarse largest": float(np.abs(blocks - blocks.mean()).max()),
        f"{target} residual spread": float(np.log(_robust(rest))),
        f"{target} coarse variance": _log(blocks.var()),
    }
    if target == "scene":
        edge = laplace(clean)
        inner = clean < 0.85 * full
        slope = np.polyfit(clean[inner], rest[inner], 1)[0]
        stats[f"{target} slope"] = float(slope * full)
        stats[f"{target} on the Laplacian"] = float(
            (rest * edge)[inner].sum() / (edge**2)[inner].sum() * full
        )
        return stats
    steps = {"above": (-1, 0), "below": (1, 0), "left": (0, -1), "right": (0, 1)}
    for name, (dy, dx) in steps.items():
        seen = bright.copy()
        for distances in ((1,), (2, 3), (4, 5, 6, 7, 8)):
            ring = np.zeros_like(bright)
            for d in distances:
                ring |= _shifted(bright, dy * d, dx * d)
            ring &= dark & ~seen
            seen |= ring
            if ring.any():
                stats[f"{target} {distances[0]} {name}"] = float(rest[ring].mean())
        if target == "chart":
            rim = bright & _shifted(dark, -dy, -dx)
            stats[f"{target} rim {name}"] = float(rest[rim].mean())
        else:
            trail = np.zeros_like(bright)
            for d in range(9, max(height, width)):
                trail |= _shifted(bright, dy * d, dx * d)
            stats[f"{target} trail {name}"] = float(rest[trail & dark].mean())
    if target == "spot":
        stats["spot top"] = float(np.median(image[bright]))
    inside: np.ndarray = bright
    for reach in (4, 9, 18, 36):
        wider = np.array(binary_dilation(bright, iterations=reach), dtype=bool)
        ring = wider & ~inside & dark
        if ring.any():
            stats[f"{target} ring {reach}"] = float(rest[ring].mean())
        inside = wider
    if (dark & ~inside).any():
        stats[f"{target} far"] = float(rest[dark & ~inside].mean())
    mirror = np.array(binary_dilation(bright[::-1, ::-1], iterations=3), dtype=bool) & dark
    if mirror.any():
        stats[f"{target} mirror"] = float(rest[mirror].mean() - np.median(rest[dark]))
    return stats


def _residue(target: str, image: np.ndarray, clean: np.ndarray) -> Stats:
    """What a dark frame remembers of the scene before it."""
    bright = clean > np.percentile(clean, 99)
    x = clean - clean.mean()
    image = _tame(image, 12)
    return {
        f"after {target} slope": float((image * x).sum() / (x * x).sum() * clean.max()),
        f"after {target} bright": float(image[bright].mean() - np.median(image)) if bright.any() else 0.0,
        f"after {target} mean": float(image.mean()),
    }


def _codes(frames: np.ndarray) -> Stats:
    histogram = np.bincount(frames.ravel()).astype(float)
    local = uniform_filter1d(histogram, 9, mode="constant")
    used = local > 20
    odd = np.arange(histogram.size) % 2 == 1
    return {
        "codes empty count": _count((histogram == 0) & used),
        "codes doubled count": _count((histogram > 1.7 * local) & used & (local > 60)),
        "codes odd over even": float(np.log((histogram[odd].sum() + 1) / (histogram[~odd].sum() + 1))),
    }
