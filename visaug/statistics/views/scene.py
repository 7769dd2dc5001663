"""How a frame of a known scene differs from the scene: edges, halos, trails, ghosts, spills."""

import hashlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter

from visaug.statistics.view import Curve, View, ViewPlot
from visaug.statistics.views.drawn import direction

USABLE = 0.9  # of the highest level: pixels above may be saturated


def _shift(image: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """The image moved down and right, its rim repeated."""
    height, width = image.shape
    r = np.clip(np.arange(height) - rows, 0, height - 1)
    c = np.clip(np.arange(width) - columns, 0, width - 1)
    return image[r[:, None], c[None, :]]


def templates(clean: np.ndarray, weight: np.ndarray) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Shapes with which the residual of a scene is correlated: axes and image of each. They are geometric, not effects.

    Args:
        weight: of each pixel, 0 for those that are not used.
    """
    rows = np.linspace(0, 1, clean.shape[0], dtype=np.float32)[:, None]
    columns = np.linspace(0, 1, clean.shape[1], dtype=np.float32)[None, :]
    shapes: dict[str, tuple[tuple[str, ...], np.ndarray]] = {}
    for axis, (dr, dc) in (("row", (0, 1)), ("column", (1, 0))):
        forward, back = _shift(clean, dr, dc), _shift(clean, -dr, -dc)
        shapes[f"curvature along {axis}s"] = ((axis, "pixel"), forward + back - 2 * clean)
        shapes[f"trail along {axis}s"] = ((axis, "pixel"), forward - back)
        far = _shift(clean, 4 * dr, 4 * dc) - _shift(clean, -4 * dr, -4 * dc)
        shapes[f"long trail along {axis}s"] = ((axis,), far)
        place = columns if axis == "row" else rows
        shapes[f"trail along {axis}s growing with the place"] = ((axis,), (forward - back) * (place - 0.5))
    shapes["curvature growing with the level"] = (("pixel", "level"), _growing_curvature(clean, weight))
    diagonal = (
        _shift(clean, 1, 1) + _shift(clean, -1, -1) + _shift(clean, 1, -1) + _shift(clean, -1, 1) - 4 * clean
    )
    shapes["curvature along diagonals"] = (("pixel",), diagonal)
    for width in (3, 10, 30):
        shapes[f"halo of {width} px"] = (("smooth",), gaussian_filter(clean, width, mode="constant") - clean)
    shapes["mean of the column"] = (
        ("column",),
        np.broadcast_to(clean.mean(0, keepdims=True), clean.shape) - clean.mean(),
    )
    shapes["mean of the row"] = (
        ("row",),
        np.broadcast_to(clean.mean(1, keepdims=True), clean.shape) - clean.mean(),
    )
    shapes["mirror image"] = (("smooth",), clean[::-1, ::-1] - clean.mean())
    small = gaussian_filter(clean[::-1, ::-1], 4)
    shapes["blurred mirror image"] = (("smooth",), small - small.mean())
    shapes["square"] = (("level",), clean**2 / max(float(clean.max()), 1.0) - clean)
    return shapes


def _growing_curvature(clean: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """What a spread that grows with the level does beside one that does not; nothing where all edges are of one height.

    Left out are the pixels of the top level, which may be saturated: they are not used, see `Scene`.
    """
    kept = np.where(clean < USABLE * float(clean.max()), weight, 0)
    linear, growing = _curvature(clean), _curvature(clean**2 / max(float(clean.max()), 1.0))
    share = float(np.vdot(kept * growing, linear)) / max(float(np.vdot(kept * linear, linear)), 1e-9)
    return np.where(kept > 0, growing - np.float32(share) * linear, 0)


def _curvature(clean: np.ndarray) -> np.ndarray:
    return sum(_shift(clean, *step) for step in ((0, 1), (0, -1), (1, 0), (-1, 0))) - 4 * clean


@dataclass(frozen=True)
class Target:
    """What is prepared once for a noiseless target.

    Attributes:
        bright: spots far above the rest.
        usable: pixels away from them.
        weight: of a pixel, about the inverse of its variance: what spills into the dark is not lost in the noise of the bright.
        shapes: axes, shape times weight, and norm of each.
        rings: axis, and the pixels before and after bright spots. Those that a spot reaches along either axis, its shoulders,
            are a ring of their own: they would give a spill along columns the look of one along rows.
    """

    clean: np.ndarray
    bright: np.ndarray
    usable: np.ndarray
    weight: np.ndarray
    shapes: dict[str, tuple[tuple[str, ...], np.ndarray, float]]
    rings: dict[str, tuple[str, np.ndarray, np.ndarray]]


class _Key:
    """A target as a key of the cache: by the content of every pixel, so that two star fields are never taken for one."""

    def __init__(self, clean: np.ndarray):
        self.clean = clean
        pixels = hashlib.blake2b(np.ascontiguousarray(clean).data, digest_size=16).digest()
        self.identity = (clean.shape, clean.dtype.str, pixels)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.identity == other.identity

    def __hash__(self) -> int:
        return hash(self.identity)


@lru_cache(maxsize=12)
def _target(key: _Key) -> Target:
    clean = key.clean
    peak, middle = float(clean.max()), float(np.median(clean))
    bright = clean > 0.9 * peak if peak > 20 * max(middle, 1.0) else np.zeros(clean.shape, bool)
    dark_photons = 20.0  # of which the shot noise is about the read noise
    response = 0.007  # typical relative difference of pixels
    weight = (1 / (clean + dark_photons + (response * clean) ** 2)).astype(np.float32)
    weight /= weight.max()
    usable = np.logical_not(binary_dilation(bright, iterations=2))
    shapes = {}
    for label, (axes, shape) in templates(clean, np.where(usable, weight, 0)).items():
        shape = np.where(bright, 0, shape).astype(np.float64)
        norm = float((weight * shape**2).sum())
        if (shape**2).sum() > 1e-9 * peak**2:
            shapes[label] = (axes, (weight * shape).astype(np.float32), norm)
    steps, rings = {"column": (1, 0), "row": (0, 1)}, {}
    for name, near, far in (("1 to 2", 1, 2), ("3 to 8", 3, 8), ("9 to 30", 9, 30)):
        for axis, other in (("column", "row"), ("row", "column")):
            before, after = _sides(bright, steps[axis], near, far)
            across = np.logical_or(*_sides(bright, steps[other], 1, far))
            rings[f"{name} px from bright spots along the {axis}"] = (axis, before & ~across, after & ~across)
            if (near, axis) == (1, "column"):
                rings["bright spots' shoulders"] = ("pixel", before & across, after & across)
    rings = {name: ring for name, ring in rings.items() if ring[1].any() and ring[2].any()}
    return Target(clean, bright, usable, weight, shapes, rings)


def _sides(bright: np.ndarray, step: tuple[int, int], near: int, far: int) -> tuple[np.ndarray, np.ndarray]:
    """The pixels so far before and behind bright spots along a step."""
    before, after = (
        _reach(bright, way, far) & ~_reach(bright, way, near - 1) & ~bright
        for way in ((-step[0], -step[1]), step)
    )
    return before, after


def _reach(mask: np.ndarray, step: tuple[int, int], distance: int) -> np.ndarray:
    """The mask, extended by a number of steps to one side."""
    reached = mask.copy()
    rows, columns = step
    for d in range(1, distance + 1):
        reached |= _shift(mask, rows * d, columns * d)
    return reached


class Scene(View):
    """The mean frame of each known scene minus its linear fit, correlated with simple shapes."""

    name = "scene"
    title = "Known scenes: measured less expected"

    def measure(self, data):
        for g in data.of("scene"):
            target = _target(_Key(data.frames.clean(g.group.indices[0])))
            residual, slope, usable = self._residual(g, target)
            yield g.statistic(self.name, "slope", ["level"], "DN/photon"), slope
            kept = np.where(usable, residual, 0)
            used = target.clean[usable]
            # of one level the line takes all: what is left of its square, or of an offset, is rounding, and no residual
            several_levels = used.size > 0 and float(np.ptp(used)) > 1e-6 * float(used.max())
            for name, (axes, shape, norm) in target.shapes.items():
                told = several_levels or name != "square"
                value = float(np.vdot(shape, kept)) / norm / max(slope, 1e-9) if told else 0.0
                yield g.statistic(self.name, name, axes, "fraction"), value
            weight = np.where(usable, target.weight, 0)
            offset = float(np.vdot(weight, kept)) / max(float(weight.sum(dtype=np.float64)), 1e-9)
            offset = offset if several_levels else 0.0
            yield g.statistic(self.name, "offset", ["smooth", "level"], "DN"), offset
            if target.bright.any():  # far above the full well, so this is its level
                top = float(g.pattern[target.bright].mean()) + g.signal
                yield g.statistic(self.name, "top of bright spots", ["level"], "DN"), top
            for name, (axis, before, after) in target.rings.items():
                sides = residual[before].mean(), residual[after].mean()
                yield g.statistic(self.name, name, [axis], "DN"), float(sum(sides) / 2)
                further = f"{name}, beyond less before"
                yield g.statistic(self.name, further, [axis], "DN"), float(sides[1] - sides[0])

    @staticmethod
    def _residual(g, target):
        """Mean frame less the target times a slope that is fitted below saturation; the slope; the pixels of the fit."""
        frame = g.pattern + np.float32(g.signal)
        usable = target.usable & (frame < USABLE * float(frame.max()))
        x = np.where(usable, target.clean * target.weight, 0)
        slope = float(np.vdot(x, frame)) / max(float(np.vdot(x, target.clean)), 1e-9)
        return frame - np.float32(slope) * target.clean, slope, usable

    def draw(self, data, name, group):
        g = group if group is not None and group.kind == "scene" else next(iter(data.of("scene")), None)
        if g is None:
            return None
        target = _target(_Key(data.frames.clean(g.group.indices[0])))
        residual, slope, _ = self._residual(g, target)
        if name.startswith("slope") or name in ("square", "offset"):
            return self._response(g, target, name, slope)
        if name.startswith("top") and target.bright.any():
            level = np.sort(g.pattern[target.bright]) + g.signal
            rank = np.unique(np.linspace(0, len(level) - 1, 60).astype(int))
            curve = Curve(100 * (rank + 0.5) / len(level), level[rank], g.label)
            return ViewPlot(
                self.title,
                "share of the pixels of bright spots, %",
                "their level above bias, DN, or less",
                (curve,),
            )
        if "bright spots" in name and target.bright.any():
            return self._around(g, target, name, residual)
        limit = np.quantile(np.abs(residual), 0.98)
        maps = ((f"{g.label}: measured less expected, DN", np.clip(residual, -limit, limit)),)
        return ViewPlot(self.title, maps=maps)

    def _response(self, g, target, name, slope) -> ViewPlot | None:
        """Mean level of the pixels of equal light, over that light."""
        frame, light = g.pattern + np.float32(g.signal), target.clean
        used = target.usable & (light > 0.02 * float(np.quantile(light, 0.99)))
        if not used.any():
            return None
        cuts = np.unique(np.quantile(light[used], np.linspace(0, 1, 13)))
        place = np.digitize(light[used], cuts[1:-1])
        steps = np.unique(place)
        x = np.array([light[used][place == k].mean() for k in steps])
        y = np.array([frame[used][place == k].mean() for k in steps]) / x
        if len(x) < 2:
            return None
        curve = Curve(x, y, g.label)
        return ViewPlot(
            self.title, "photons per pixel of the scene", "mean above bias per photon, DN", (curve,)
        )

    def _around(self, g, target, name, residual) -> ViewPlot:
        """Mean residual of the pixels so far before or after bright spots, along one axis."""
        lines = direction(name)
        step = (1, 0) if lines == "column" else (0, 1)
        around = 32  # px on either side of bright spots, in the picture
        x, y = np.arange(-around, around + 1), []
        for distance in x.tolist():
            reached = _shift(target.bright, step[0] * distance, step[1] * distance) & ~target.bright
            y.append(float(residual[reached].mean()) if reached.any() else np.nan)
        ends = [int(w) for w in name.split() if w.isdigit()][:2]
        marks = ((-ends[1], -ends[0]), (ends[0], ends[1])) if len(ends) == 2 else ()
        return ViewPlot(
            self.title,
            f"distance from bright spots along the {lines}, px",
            "measured less expected, DN",
            (Curve(x, np.array(y), g.label),),
            marks=marks,
        )
