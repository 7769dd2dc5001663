"""Robustness curves: scores of any network on images that a measured camera takes under ever worse conditions.

Each curve changes one thing of the camera and leaves the rest: the gain in dB, the share of the light, the temperature, or the
strength of a single effect as a multiple of the camera's own. Every point of all curves has the same random numbers image by
image, so that curves differ by what is changed and not by the draw.
"""

import hashlib
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from visaug.augment import ImageNoise
from visaug.camera import Camera
from visaug.camera.maps import named_maps
from visaug.camera.paths import PARTS
from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import folder_lock, whole_file, write_json, write_text
from visaug.core.progress import Progress
from visaug.effects import catalogue
from visaug_train.convert import identity
from visaug_train.evaluate import evaluate
from visaug_train.geometry import Keypoints
from visaug_train.metrics import Detections
from visaug_train.record import taken_from_files
from visaug_train.reduction import read_image
from visaug_train.speed import PoseSet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Predict = Callable[[PoseSet], list[Detections]]
Scores = dict[str, float | None]

# score -> its place in a summary, and its label
SCORES = {
    "keypoint_ap": (lambda summary: summary["keypoint_ap50_95"]["coco"], "keypoint AP (COCO)"),
    "oks": (lambda summary: summary["oks"]["coco"], "OKS (COCO), mean"),
    "position_error": (lambda summary: summary["position_error"], "position error / distance"),
    "attitude_error_deg": (lambda summary: summary["attitude_error_deg"], "attitude error, deg"),
}
LABELS = {
    "gain_db": "gain, dB",
    "exposure": "exposure, share of saturation",
    "temperature_c": "temperature, C",
}


@dataclass(frozen=True)
class SeverityPoint:
    """One point of a curve: what is changed (`axis`), to which value, and the noise that this means."""

    axis: str
    value: float
    camera: Camera
    exposure: float | None = None


@dataclass(frozen=True)
class Severity:
    """Curves: `clean` are the scores without noise, `rows` one dictionary a point: axis, value and the scores (None: not known)."""

    camera: str
    clean: Scores
    rows: list[dict[str, Any]]

    def to_csv(self) -> str:
        head = ["axis", "value", *SCORES]
        lines = [{"axis": "clean", "value": None, **self.clean}, *self.rows]
        cells = [["" if line[key] is None else str(line[key]) for key in head] for line in lines]
        return "".join(",".join(row) + "\n" for row in [head, *cells])

    def plot(self) -> "Figure":
        """A row of panels for each score that is known, a panel a kind of change; the dashed line is the clean images."""
        from visaug.report.plots.style import blank, plain, styled

        def kind_of(row: dict[str, Any]) -> str:
            return row["axis"] if row["axis"] in LABELS else "effect"

        scores = [name for name in SCORES if self.clean[name] is not None]
        kinds = list(dict.fromkeys(map(kind_of, self.rows)))
        with styled():
            figure = blank(3.0 * len(kinds) + 1.0, 2.2 * len(scores))
            panels = figure.subplots(len(scores), len(kinds), squeeze=False, sharex="col", sharey="row")
            for line, name in zip(panels, scores):
                for axes, kind in zip(line, kinds):
                    axes.axhline(self.clean[name], color="#7a8594", linestyle="--", linewidth=1)
                    rows = [row for row in self.rows if kind_of(row) == kind]
                    for axis in dict.fromkeys(row["axis"] for row in rows):
                        points = [(row["value"], row[name]) for row in rows if row["axis"] == axis]
                        x, y = np.array(points, float).T  # a score that is not known is NaN
                        axes.plot(x, y, marker="o", markersize=3, label=plain(axis))
                    if kind == "exposure":
                        axes.set_xscale("log")
                    if kind == "effect":
                        axes.set_xscale("symlog", linthresh=1)
                line[0].set_ylabel(SCORES[name][1])
            for axes, kind in zip(panels[-1], kinds):
                axes.set_xlabel(LABELS.get(kind, "strength of the effect, times the camera's"))
            if "effect" in kinds:
                panels[0][kinds.index("effect")].legend(fontsize=7)
        return figure


def points_of(camera: Camera, axes: Sequence[str] | None = None) -> list[SeverityPoint]:
    """The points of all curves of a camera, or of some.

    Args:
        camera: whose conditions are changed.
        axes: gain_db, exposure, temperature_c, and names of effects that the camera has; all where left out. Effects of a
            measured map, and those that do not vanish at any value, have no curve.
    """
    own, maps = camera.values(), named_maps(camera.spec)
    strengths = {
        effect: {f"{effect}.{n}": own.get(f"{effect}.{n}", 0.0) for n in catalogue()[effect].strengths()}
        for effect in (*PARTS, *camera.effect_names)
    }
    strengths = {e: values for e, values in strengths.items() if any(values.values()) and e not in maps}
    known = [*LABELS, *strengths]
    for axis in axes or ():
        if axis not in known:
            raise InputError(f"{axis} has no curve", field="--curve", expected=f"one of {', '.join(known)}")
    values = {
        # above the camera's own: factors of two up to 64
        "gain_db": [camera.spec.gain_db + step for step in (0.0, 6.0, 12.0, 18.0, 24.0, 30.0, 36.0)],
        "exposure": (1.0, 0.3, 0.1, 0.03, 0.01),  # shares of the saturating light, about half a decade each
        "temperature_c": (-20.0, 0.0, 20.0, 40.0, 60.0),  # the industrial range of cameras
    }
    factors = (0.0, 1.0, 3.0, 10.0, 30.0)  # on an effect's own strength; 0 is the camera without it
    found = []
    for axis in axes or known:
        for value in values.get(axis, factors):
            if axis == "exposure":
                found.append(SeverityPoint(axis, value, camera, value))
            elif axis in LABELS:
                found.append(SeverityPoint(axis, value, camera.replace({axis: value})))
            else:
                with suppress(InputError):  # beyond what a camera can have
                    scaled = {path: value * strength for path, strength in strengths[axis].items()}
                    found.append(SeverityPoint(axis, value, camera.replace(scaled)))
    return found


def severity(
    poses: PoseSet,
    keypoints: Keypoints,
    predict: Predict,
    camera: Camera,
    folder: str | Path,
    axes: Sequence[str] | None = None,
    network: str = "",
    seed: int = 0,
    progress: Progress | None = None,
) -> Severity:
    """Scores of a network under the conditions of `points_of`; an interrupted call goes on in `folder`.

    Args:
        poses: labelled images. What noise they carry comes in addition, so noiseless ones tell most.
        predict: gives the detections of a set's images, in their pixels; it reads `poses.files`.
        camera: the measured camera; its `randomize` is not used.
        folder: of severity.json, severity.csv and severity.png.
        axes: see `points_of`.
        network: what tells this network from another one, such as a digest of its weights; it decides whether points that
            are there already are taken over.
    """
    folder = Path(folder)
    file, images = folder / "severity.json", folder / "images.partial"
    if not poses.labelled:
        raise InputError(f"{poses.name} has no labels, so there is nothing to score")
    content = {k: v for k, v in camera.to_dict().items() if k not in ("randomize", "correlated")}
    fixed = camera.with_content(content)
    described = {"set": poses.name, **identity(poses), "network": network, "seed": seed}
    described |= {"camera": fixed.to_dict(), **taken_from_files(fixed)}
    digest = hashlib.sha256(repr(described).encode()).hexdigest()
    jobs: dict[str, SeverityPoint | None] = {"clean": None}
    jobs |= {f"{point.axis}={point.value:g}": point for point in points_of(fixed, axes)}
    say = progress or (lambda *_: None)
    with folder_lock(folder):
        state = read_json(file) if file.is_file() else {"of": digest, "points": {}}
        if not isinstance(state, dict) or state.get("of") != digest:
            raise InputError("is of another network, set, camera or seed", file=file, expected="a new folder")
        points: dict[str, Scores] = state["points"]
        for done, (key, point) in enumerate(jobs.items()):
            say("severity", done, len(jobs))
            if key not in points:
                taken = poses if point is None else _taken(poses, point, images, seed)
                summary = evaluate(poses.domain, taken, keypoints, predict(taken)).summary()
                found = {name: of(summary) for name, (of, _) in SCORES.items()}
                points[key] = {n: v if v is not None and np.isfinite(v) else None for n, v in found.items()}
                write_json(file, state)
        shutil.rmtree(images, ignore_errors=True)
        rows = [{"axis": p.axis, "value": float(p.value), **points[key]} for key, p in jobs.items() if p]
        curves = Severity(camera.name, points["clean"], rows)
        write_text(folder / "severity.csv", curves.to_csv())
        with whole_file(folder / "severity.png") as temporary:
            curves.plot().savefig(temporary, dpi=120)
    say("severity", len(jobs), len(jobs))
    return curves


def _taken(poses: PoseSet, point: SeverityPoint, folder: Path, seed: int) -> PoseSet:
    """The images as the camera takes them, as PNG."""
    import torch

    shutil.rmtree(folder, ignore_errors=True)
    noise = ImageNoise(point.camera, exposure=point.exposure, transfer="linear", order="BGR")
    files = []
    for number, (file, name) in enumerate(zip(poses.files, poses.ids)):
        image = read_image(file, poses.camera)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(2**20 * seed + number)
            noisy = noise(image)
        target = folder / f"{name}.png"  # with its suffix: two images may differ in that alone
        target.parent.mkdir(parents=True, exist_ok=True)
        if not cv2.imwrite(str(target), noisy):
            raise InputError("cannot be written", file=target)
        files.append(target)
    return replace(poses, files=tuple(files))
