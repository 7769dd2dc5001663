"""A contact sheet of the picture that a report shows first for each effect of the catalogue, with and without the effect.

    python scripts/evidence_sheet.py -o evidence.png
    python scripts/evidence_sheet.py -o evidence.png --effects column_noise,row_noise

Frame sets of a small camera are simulated without and with each effect; the statistic that differs most, in standard deviations
of the sets without it, names the view and the frames of the picture. The number on each picture is the distance of the curves.
"""

import argparse
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from visaug import Camera, FrameSet, simulate
from visaug.effects import Stage, catalogue
from visaug.statistics import VIEWS, Fingerprint, FrameData, View
from visaug.statistics.view import ViewPlot

ROWS, COLUMNS = 64, 80
SETS = 10  # without an effect, from which the scatter of statistics and of curves is estimated
LEAST = (
    0.3  # of the median scatter along a curve, below which the scatter at a place is an accident of few sets
)
CLIPPED_Z = (
    30.0  # standard deviations, beyond which statistics are ordered by their views: all are seen at a glance
)
CAMERA = {
    "name": "small",
    "resolution": [ROWS, COLUMNS],
    "bit_depth": 12,
    "quantum_efficiency": 0.6,
    "gain_e_per_dn": 3.0,
    "black_level_dn": 100,
    "full_well_e": 9000,
    "read_noise": {"sigma_e": 4.0},
    "dark_current": {"a_e_per_s": 3.0},
    "prnu": {"pixel": 0.006},
    "dsnu": {"pixel_e": 1.0},
}


@dataclass(frozen=True)
class Evidence:
    """The first picture of an effect: of frame sets without it (several) and with it."""

    effect: str
    view: View
    worst: str
    z: float
    without: list[ViewPlot]
    given: ViewPlot
    again: ViewPlot  # of a further set without the effect

    @property
    def distance(self) -> float:
        """Root mean square of the difference in units of the scatter, over the tenth of the places where it is largest."""
        return self._from_without(self.given)

    @property
    def by_chance(self) -> float:
        """The same of a further set without the effect."""
        return self._from_without(self.again)

    def _from_without(self, picture: ViewPlot) -> float:
        drawn = [_drawn(p) for p in (picture, *self.without)]
        return max(_distance(*curves) for curves in zip(*drawn, strict=True))


def _distance(*curves: tuple[np.ndarray, np.ndarray]) -> float:
    """Of the first curve from the others, at its own places as far as all reach."""
    low, high = max(x[0] for x, _ in curves), min(x[-1] for x, _ in curves)
    places = curves[0][0]
    places = places[(places >= low) & (places <= high)]
    if not len(places):
        return 0.0
    given, *others = (np.interp(places, x, y) for x, y in curves)
    sets = np.array(others)
    scatter = sets.std(0, ddof=1)
    least = LEAST * float(np.median(scatter[scatter > 0])) if (scatter > 0).any() else 1e-9
    far = np.sort(((given - sets.mean(0)) / np.maximum(scatter, least)) ** 2)
    return float(np.sqrt(far[-max(len(far) // 10, 1) :].mean()))


def _drawn(picture: ViewPlot) -> list[tuple[np.ndarray, np.ndarray]]:
    """Heights of the curves, or values of the maps, over places, as they are drawn: of a logarithmic axis their logarithms."""
    curves = [(np.asarray(c.x, float), np.asarray(c.y, float)) for c in picture.curves]
    curves = curves or [(np.arange(m.size, dtype=float), m.ravel()) for _, m in picture.maps]
    found = []
    for x, y in curves:
        y = np.nan_to_num(np.log(np.maximum(y, 1e-9)) if picture.log_y else y)
        found.append((x, y))
    return found


@cache
def plan() -> FrameSet:
    """The plan of the frames that come with the package, and the middle of their scenes."""
    records = FrameSet.load(Path(__file__).parents[1] / "visaug" / "data" / "hidden_effect" / "frames.csv")
    cleans = {}
    for i, record in enumerate(records.records):
        if record.clean and record.clean not in cleans:
            clean = records.clean(i)
            r, c = (clean.shape[0] - ROWS) // 2, (clean.shape[1] - COLUMNS) // 2
            cleans[record.clean] = np.ascontiguousarray(clean[r : r + ROWS, c : c + COLUMNS])
    blank = np.zeros((len(records), ROWS, COLUMNS), np.uint16)
    return FrameSet.from_arrays(records.records, blank, cleans, bit_depth=12)


def taken(camera: Camera, seed: int) -> FrameData:
    return FrameData(simulate(camera, plan(), seed))


def measured(data: FrameData) -> Fingerprint:
    return Fingerprint.of(pair for view in VIEWS for pair in view.measure(data))


@cache
def without() -> list[tuple[FrameData, Fingerprint]]:
    sets = [taken(Camera.load(CAMERA), seed) for seed in range(SETS)]
    return [(data, measured(data)) for data in sets]


@cache
def again() -> FrameData:
    return taken(Camera.load(CAMERA), SETS)


def effects() -> list[str]:
    """Those beyond the base chain that change what the converter gives."""
    return [name for name, e in catalogue().items() if not e.base and e.stage < Stage.PICTURE]


def evidence(effect: str) -> Evidence:
    """The picture of the statistic that an effect, at the larger of its trial strengths, changes most."""
    data = taken(Camera.load(CAMERA).with_effect(effect, **strengths(effect)), SETS + 1)
    found, sets = measured(data), without()
    values = np.array([f.values for _, f in sets])
    least = np.array([s.least_spread for s in found.statistics])
    scatter = np.maximum(values.std(0, ddof=1), np.maximum(least, 1e-9))
    z = np.abs(found.values - values.mean(0)) / scatter
    order = np.argsort(-z)
    for place in order:
        statistic = found.statistics[place]
        view = next(v for v in VIEWS if v.name == statistic.view)
        worst = f"{statistic.name}, {statistic.frames}"
        given, chance = view.picture(data, worst), view.picture(again(), worst)
        pictures = [p for p in (view.picture(d, worst) for d, _ in sets) if p is not None]
        if given is not None and chance is not None and len(pictures) == len(sets):
            return Evidence(effect, view, worst, float(z[place]), pictures, given, chance)
    raise ValueError(f"no picture of {effect}")


def strengths(effect: str) -> dict[str, float]:
    """The strengths of an effect at the largest of the values that a diagnosis tries."""
    known = catalogue()[effect]
    return {  # pyrefly: ignore[bad-return]
        key: max(known.parameters[key].trials, key=abs)
        for key in known.strengths()
        if known.parameters[key].trials
    }


def draw(found: list[Evidence], path: Path) -> None:
    """All of them on one sheet: with the effect in vermilion, one set without it in blue."""
    from visaug.report.plots.style import MEASURED, MODELLED, SOFT, blank, styled
    from visaug.report.plots.view import plain_decades

    columns = 5
    with styled():
        figure = blank(columns * 3.6, -(-len(found) // columns) * 2.7)
        grid = figure.subplots(-(-len(found) // columns), columns, squeeze=False)
        for axes in grid.ravel():
            axes.set_visible(False)
        for axes, e in zip(grid.ravel(), found, strict=False):
            axes.set_visible(True)
            axes.set_title(f"{e.effect}: {e.distance:.1f}\n{e.view.name}: {e.worst}", fontsize=7)
            if e.given.maps:
                both = np.concatenate([e.without[0].maps[0][1], e.given.maps[0][1]], 1)
                axes.imshow(both, cmap="cividis")
                axes.set(xticks=[], yticks=[])
                continue
            for low, high in e.given.marks:
                axes.axvspan(low, high, color=SOFT, alpha=0.2)
            for picture, colour in ((e.without[0], MODELLED), (e.given, MEASURED)):
                for curve in picture.curves:
                    axes.plot(curve.x, curve.y, color=colour, linewidth=1)
            if e.given.log_x and min(c.x.min() for c in e.given.curves) > 0:
                axes.set_xscale("log")
            if e.given.log_y:
                axes.set_yscale("log")
            for axis in (axes.xaxis, axes.yaxis):
                if axis.get_scale() == "log":
                    plain_decades(axis)
            axes.tick_params(labelsize=6)
            axes.set_xlabel(e.given.x_label, fontsize=6)
            axes.set_ylabel(e.given.y_label, fontsize=6)
        figure.savefig(path, dpi=75)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--effects", help="only these, separated by commas")
    options = parser.parse_args()
    found = []
    for name in options.effects.split(",") if options.effects else effects():
        found.append(evidence(name))
        e = found[-1]
        print(
            f"{name:32} {e.distance:8.1f} (chance {e.by_chance:.1f})  z {e.z:8.1f}  {e.view.name}: {e.worst}",
            flush=True,
        )
    draw(found, options.output)
    print(
        f"{sum(e.distance >= 3 for e in found)} of {len(found)} differ by 3 or more; wrote {options.output}"
    )


if __name__ == "__main__":
    main()
