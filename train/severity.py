"""Robustness curves: scores of any network on images that a measured camera takes under ever worse conditions.

Each curve changes one thing of the camera and leaves the rest: the gain in dB, the share of the light, the temperature, or the
strength of a single effect as a multiple of the camera's own. Every point of all curves has the same random numbers image by
image, so that curves differ by what is changed and not by the draw.
"""

import hashlib
import shutil
from collections.abc import Callable, Sequence
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
from visaug_train.reduction import read_image
from visaug_train.speed import PoseSet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Predict = Callable[[PoseSet], list[Detections]]

GAIN_STEPS_DB = (0.0, 6.0, 12.0, 18.0, 24.0, 30.0, 36.0)  # above the camera's own: factors of two up to 64
LABELS = {
    "keypoint_ap": "keypoint AP (COCO)",
    "oks": "OKS (COCO), mean",
    "position_error": "position error / distance",
    "attitude_error_deg": "attitude error, deg",
}
SCORES = tuple(LABELS)
UNITS = {
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
    clean: dict[str, float | None]
    rows: list[dict[str, Any]]

    def to_csv(self) -> str:
        """A line a point; the first are the clean images."""
        lines = [{"axis": "clean", "value": None, **self.clean}, *self.rows]
        cells = [
            ["" if line[key] is None else str(line[key]) for key in ("axis", "value", *SCORES)]
            for line in lines
        ]
        return "\n".join(",".join(row) for row in [["axis", "value", *SCORES], *cells]) + "\n"

    def plot(self) -> "Figure":
        """A row of panels for each score that is known, a panel a kind of change; the dashed line is the clean images."""
        from visaug.report.plots.style import blank, plain, styled

        scores = [name for name in SCORES if self.clean[name] is not None]
        kinds = list(dict.fromkeys(_kind(row["axis"]) for row in self.rows))
        with styled():
            figure = blank(3.0 * len(kinds) + 1.0, 2.2 * len(scores))
            panels = figure.subplots(len(scores), len(kinds), squeeze=False, sharex="col", sharey="row")
            for line, name in zip(panels, scores):
                for axes, kind in zip(line, kinds):
                    axes.axhline(self.clean[name], color="#7a8594", linestyle="--", linewidth=1)
                    for axis in dict.fromkeys(r["axis"] for r in self.rows if _kind(r["axis"]) == kind):
                        points = [(r["value"], r[name]) for r in self.rows if r["axis"] == axis]
                        x, y = zip(*((x, np.nan if y is None else y) for x, y in points))
                        axes.plot(x, y, marker="o", markersize=3, label=plain(axis))
                    if kind == "exposure":
                        axes.set_xscale("log")
                    if kind == "effect":
                        axes.set_xscale("symlog", linthresh=1)
                line[0].set_ylabel(LABELS[name])
            for axes, kind in zip(panels[-1], kinds):
                axes.set_xlabel(UNITS.get(kind, "strength of the effect, times the camera's"))
            if "effect" in kinds:
                panels[0][kinds.index("effect")].legend(fontsize=7)
        return figure

    def write(self, folder: Path) -> None:
        """severity.csv and severity.png."""
        write_text(folder / "severity.csv", self.to_csv())
        with whole_file(folder / "severity.png") as temporary:
            self.plot().savefig(temporary, dpi=120)


def _kind(axis: str) -> str:
    return axis if axis in UNITS else "effect"


def points_of(camera: Camera, axes: Sequence[str] | None = None) -> list[SeverityPoint]:
    """The points of all curves of a camera, or of some.

    Args:
        camera: whose conditions are changed.
        axes: gain_db, exposure, temperature_c, and names of effects that the camera has; all where left out. Effects of a
            measured map, and those that do not vanish at any value, have no curve.
    """
    strengths = _strengths(camera)
    known = [*UNITS, *strengths]
    for axis in axes or ():
        if axis not in known:
            raise InputError(f"{axis} has no curve", field="--curve", expected=f"one of {', '.join(known)}")
    values = {
        "gain_db": [camera.spec.gain_db + step for step in GAIN_STEPS_DB],
        "exposure": (1.0, 0.3, 0.1, 0.03, 0.01),  # shares of the saturating light, about half a decade each
        "temperature_c": (-20.0, 0.0, 20.0, 40.0, 60.0),  # the industrial range of cameras
    }
    factors = (0.0, 1.0, 3.0, 10.0, 30.0)  # on an effect's own strength; 0 is the camera without it
    found = []
    for axis in axes or known:
        for value in values.get(axis, factors):
            if axis == "exposure":
                found.append(SeverityPoint(axis, value, camera, value))
            elif axis in UNITS:
                found.append(SeverityPoint(axis, value, camera.replace({axis: value})))
            elif changed := _scaled(camera, strengths[axis], value):
                found.append(SeverityPoint(axis, value, changed))
    return found


def _strengths(camera: Camera) -> dict[str, dict[str, float]]:
    """Values of each effect by path that vanish with it, where they are not all 0."""
    values, maps = camera.values(), named_maps(camera.spec)
    found = {}
    for effect in (*PARTS, *camera.effect_names):
        own = {
            f"{effect}.{name}": values.get(f"{effect}.{name}", 0.0)
            for name in catalogue()[effect].strengths()
        }
        if any(own.values()) and effect not in maps:
            found[effect] = own
    return found


def _scaled(camera: Camera, values: dict[str, float], factor: float) -> Camera | None:
    """The camera at `factor` times these values; None beyond what a camera can have."""
    try:
        return camera.replace({path: factor * value for path, value in values.items()})
    except InputError:
        return None


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
        keypoints: the points that the network finds.
        predict: gives the detections of a set's images, in their pixels; it reads `poses.files`.
        camera: the measured camera; its `randomize` is not used.
        folder: of severity.json, severity.csv and severity.png.
        axes: see `points_of`.
        network: what tells this network from another one, such as a digest of its weights; it decides whether points that
            are there already are taken over.
        seed: of the noise.
        progress: called with (description, done, total).
    """
    folder = Path(folder)
    if not poses.labelled:
        raise InputError(f"{poses.name} has no labels, so there is nothing to score")
    fixed = Camera.load({k: v for k, v in camera.to_dict().items() if k not in ("randomize", "correlated")})
    fixed = Camera(fixed.spec, camera.folder, camera.maps)
    points = points_of(fixed, axes)
    described = {
        "set": poses.name,
        **identity(poses),
        "network": network,
        "seed": seed,
        "camera": fixed.to_dict(),
    }
    digest = hashlib.sha256(repr(described).encode()).hexdigest()
    with folder_lock(folder):
        state = _state(folder / "severity.json", digest)
        jobs: list[tuple[str, SeverityPoint | None]] = [("clean", None)]
        jobs += [(f"{point.axis}={point.value:g}", point) for point in points]
        for done, (key, point) in enumerate(jobs):
            if progress:
                progress("severity", done, len(jobs))
            if key not in state["points"]:
                taken = poses if point is None else _taken(poses, point, folder / "images.partial", seed)
                state["points"][key] = _scores(
                    evaluate(poses.domain, taken, keypoints, predict(taken)).summary()
                )
                write_json(folder / "severity.json", state)
        shutil.rmtree(folder / "images.partial", ignore_errors=True)
        rows = [
            {"axis": p.axis, "value": float(p.value), **state["points"][key]}
            for key, p in jobs
            if p is not None
        ]
        found = Severity(camera.name, state["points"]["clean"], rows)
        found.write(folder)
    if progress:
        progress("severity", len(jobs), len(jobs))
    return found


def _state(file: Path, digest: str) -> dict[str, Any]:
    """The points that are there, of this network, set and camera."""
    if not file.is_file():
        return {"of": digest, "points": {}}
    state = read_json(file)
    if not isinstance(state, dict) or state.get("of") != digest:
        raise InputError("is of another network, set, camera or seed", file=file, expected="a new folder")
    return state


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
        target = (folder / name).with_suffix(".png")
        target.parent.mkdir(parents=True, exist_ok=True)
        if not cv2.imwrite(str(target), noisy):
            raise InputError("cannot be written", file=target)
        files.append(target)
    return replace(poses, files=tuple(files))


def _scores(summary: dict[str, Any]) -> dict[str, float | None]:
    found = {
        "keypoint_ap": summary["keypoint_ap50_95"]["coco"],
        "oks": summary["oks"]["coco"],
        "position_error": summary["position_error"],
        "attitude_error_deg": summary["attitude_error_deg"],
    }
    return {
        name: None if value is None or not np.isfinite(value) else float(value)
        for name, value in found.items()
    }
