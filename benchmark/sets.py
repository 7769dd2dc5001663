"""Frame sets on disk, as a user would bring them, with the answers kept elsewhere."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from . import cameras, effects, foreign, further, local
from .camera import Sensor, Shot, take

COLUMNS = ("sequence", "file", "kind", "exposure_s", "temperature_c", "gain_db", "photons", "clean")


@dataclass(frozen=True)
class Recipe:
    """One set of the benchmark. `hidden` holds (name, strength, form).

    `stated` changes what camera.yaml says. `mistake` holds the key and the kind of a mistake in camera.yaml.
    """

    identity: str
    kind: str
    strength: str
    seed: int
    camera: int
    hidden: tuple[tuple[str, float, str], ...] = ()
    stated: dict[str, float] = field(default_factory=dict)
    actual: dict[str, float] = field(default_factory=dict)
    expect: tuple[str, ...] = ()
    without: str | None = None
    axis: tuple[str, ...] = ()
    grows: tuple[str, ...] = ()
    may_grow: tuple[str, ...] = ()
    mistake: tuple[str, str] | None = None


def with_changes(sensor: Sensor, changes: dict[str, float]) -> Sensor:
    """Return the sensor with entries set; a triple is scaled as a whole where its name is given a factor."""
    for name, value in changes.items():
        old = getattr(sensor, name)
        new = tuple(value * part for part in old) if isinstance(old, tuple) else value
        sensor = replace(sensor, **{name: new})  # pyrefly: ignore[bad-argument-type]
    return sensor


def camera_yaml(sensor: Sensor) -> str:
    """The maker's description of a sensor. Parts that are zero are left out, as makers do."""
    lines = [
        "name: hidden camera",
        f"resolution: [{sensor.rows}, {sensor.columns}]",
        f"bit_depth: {sensor.bits}",
        f"quantum_efficiency: {sensor.efficiency:.5g}",
        f"gain_e_per_dn: {sensor.e_per_dn:.6g}",
        "gain_db: 0",
        f"black_level_dn: {sensor.pedestal_dn:g}",
        f"full_well_e: {sensor.well_e:g}",
        f"exposure_s: {sensor.integration_s:g}",
        f"temperature_c: {sensor.celsius:g}",
        f"read_noise: {{sigma_e: {sensor.read_e:.5g}, shape: {sensor.tail:g}}}",
    ]
    if sensor.dark_e_per_s:
        lines.append(
            f"dark_current: {{a_e_per_s: {sensor.dark_e_per_s:.5g}, b_per_c: {sensor.dark_per_c:g}}}"
        )
    if any(sensor.prnu):
        lines.append("prnu: {{column: {:.5g}, row: {:.5g}, pixel: {:.5g}}}".format(*sensor.prnu))
    if any(sensor.dsnu_e):
        lines.append("dsnu: {{column_e: {:.5g}, row_e: {:.5g}, pixel_e: {:.5g}}}".format(*sensor.dsnu_e))
    return "\n".join(lines) + "\n"


def write_frames(
    folder: Path, frames: np.ndarray, plan: Sequence[Shot], targets: dict[str, np.ndarray], stated: Sensor
) -> None:
    """Write frames.npz, frames.csv, the clean targets that the plan uses, and camera.yaml."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / "frames.npz", frames=frames)
    for name in sorted({shot.target for shot in plan if shot.target}):
        np.save(folder / f"{name}_clean.npy", targets[name].astype(np.float32))
    with open(folder / "frames.csv", "w", newline="") as handle:
        table = csv.writer(handle, lineterminator="\n")
        table.writerow(COLUMNS)
        for i, shot in enumerate(plan):
            photons = "" if shot.photons is None else f"{shot.photons:g}"
            clean = f"{shot.target}_clean.npy" if shot.target else ""
            row = [
                i,
                f"frames.npz#frames[{i}]",
                shot.kind,
                f"{shot.seconds:g}",
                f"{shot.celsius:g}",
                0,
                photons,
                clean,
            ]
            table.writerow(row)
    (folder / "camera.yaml").write_text(camera_yaml(stated))


def plan_of(recipe: Recipe) -> tuple[Shot, ...]:
    """The camera's plan; a small set keeps only its bias, dark or flat frames."""
    plan = cameras.plan(recipe.camera)
    if recipe.kind.startswith("small_"):
        wanted = recipe.kind.removeprefix("small_").split("_")[0]
        return tuple(shot for shot in plan if shot.kind == wanted)
    return plan


def write_set(recipe: Recipe, folder: Path, answers: Path) -> None:
    """Simulate a recipe and write its set; the answer goes to another folder."""
    nominal = cameras.sensor(recipe.camera)
    sensor = with_changes(nominal, recipe.actual)
    targets = cameras.targets(recipe.camera)
    known = effects.BY_NAME | {kind.name: kind for kind in (*further.KINDS, *foreign.KINDS, *local.KINDS)}
    hidden = effects.in_order([known[n].at(s, f) for n, s, f in recipe.hidden])
    plan = plan_of(recipe)
    frames = take(sensor, plan, targets, recipe.seed, hidden)
    write_taken(recipe, frames, plan, targets, with_changes(sensor, recipe.stated), folder, answers)


def write_taken(
    recipe: Recipe,
    frames: np.ndarray,
    plan: Sequence[Shot],
    targets: dict[str, np.ndarray],
    stated: Sensor,
    folder: Path,
    answers: Path,
) -> None:
    """Write frames that were taken for a recipe, and the answer."""
    write_frames(folder / recipe.identity, frames, plan, targets, stated)
    answers.mkdir(parents=True, exist_ok=True)
    (answers / f"{recipe.identity}.json").write_text(json.dumps(asdict(recipe), indent=1) + "\n")
