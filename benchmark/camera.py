"""The base chain: photons in, DN out, after the EMVA 1288 linear model and Janesick's Photon Transfer.

    photons -> detection (a Bernoulli selection, so electrons are Poisson of mean QE * photons, with PRNU in
    the mean)
            -> + thermal electrons, Poisson of mean a exp(bT) t -> full well -> + DSNU + read noise
            -> / (e-/DN) + pedestal -> rounding -> clipping to the converter's range.

Hidden effects hook in at six places, named for what the array holds there:
    light    photons per pixel, expected          yield     electrons per pixel, expected (light and dark)
    charge   electrons in the well, after chance  voltage   electrons, a real number on the way to the
    converter converter  real DN before the rounding           code     whole DN
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .randomness import stream, tukey_lambda

STAGES = ("light", "yield", "charge", "voltage", "converter", "code")


@dataclass(frozen=True)
class Sensor:
    """One camera type. Triples are (column, row, pixel) standard deviations; dark current is at 0 C."""

    name: str
    rows: int
    columns: int
    bits: int
    efficiency: float
    e_per_dn: float
    pedestal_dn: float
    well_e: float
    integration_s: float
    celsius: float
    read_e: float
    tail: float
    dark_e_per_s: float
    dark_per_c: float
    prnu: tuple[float, float, float]
    dsnu_e: tuple[float, float, float]

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows, self.columns

    def thermal_e(self, seconds: float, celsius: float) -> float:
        """Mean thermal electrons of one exposure."""
        return self.dark_e_per_s * np.exp(self.dark_per_c * celsius) * seconds


@dataclass(frozen=True)
class Shot:
    """One frame of a plan. `photons` for a flat, `target` (a key into the targets) for a scene."""

    kind: str
    seconds: float
    celsius: float
    photons: float | None = None
    target: str | None = None


@dataclass
class Moment:
    """What a hidden effect may know while one frame is taken."""

    sensor: Sensor
    shot: Shot
    index: int
    form: str
    seed: int
    name: str
    memory: dict[str, Any]
    thermal_e: float

    def die(self, label: str = "") -> np.random.Generator:
        """Randomness of the specimen: the same in every frame."""
        return stream(self.seed, self.name, "die", label)

    def now(self, label: str = "") -> np.random.Generator:
        """Randomness of this frame."""
        return stream(self.seed, self.name, "frame", self.index, label)

    def once(self, key: str, make: Callable[[], Any]) -> Any:
        """Make something in the first frame and keep it."""
        if key not in self.memory:
            self.memory[key] = make()
        return self.memory[key]


@dataclass(frozen=True)
class Hidden:
    """An effect put into a camera: what it does, where, and how strongly."""

    name: str
    stage: str
    act: Callable[[np.ndarray, float, Moment], np.ndarray]
    strength: float
    form: str = "default"


@dataclass(frozen=True)
class Specimen:
    """The fixed maps of one individual camera: relative response and dark offset in electrons."""

    response: np.ndarray = field(repr=False)
    offset_e: np.ndarray = field(repr=False)

    @classmethod
    def draw(cls, sensor: Sensor, seed: int) -> Specimen:
        def pattern(label: str, sizes: tuple[float, float, float]) -> np.ndarray:
            rng = stream(seed, "specimen", label)
            column, row = rng.standard_normal((1, sensor.columns)), rng.standard_normal((sensor.rows, 1))
            return sizes[0] * column + sizes[1] * row + sizes[2] * rng.standard_normal(sensor.shape)

        return cls(response=1 + pattern("prnu", sensor.prnu), offset_e=pattern("dsnu", sensor.dsnu_e))


def take(
    sensor: Sensor,
    plan: Sequence[Shot],
    targets: Mapping[str, np.ndarray],
    seed: int,
    hidden: Sequence[Hidden] = (),
) -> np.ndarray:
    """Take the frames of a plan with one specimen. Returns (frames, rows, columns) uint16 in DN."""
    specimen = Specimen.draw(sensor, seed)
    memories: dict[str, dict[str, Any]] = {effect.name: {} for effect in hidden}
    frames = np.empty((len(plan), *sensor.shape), np.uint16)
    for index, shot in enumerate(plan):
        frames[index] = _expose(sensor, specimen, shot, index, targets, seed, hidden, memories)
    return frames


def _expose(
    sensor: Sensor,
    specimen: Specimen,
    shot: Shot,
    index: int,
    targets: Mapping[str, np.ndarray],
    seed: int,
    hidden: Sequence[Hidden],
    memories: dict[str, dict[str, Any]],
) -> np.ndarray:
    thermal_e = sensor.thermal_e(shot.seconds, shot.celsius)

    def meet(stage: str, x: np.ndarray) -> np.ndarray:
        for effect in hidden:
            if effect.stage == stage:
                x = effect.act(
                    x,
                    effect.strength,
                    Moment(
                        sensor, shot, index, effect.form, seed, effect.name, memories[effect.name], thermal_e
                    ),
                )
        return x

    light = np.zeros(sensor.shape)
    if shot.kind == "flat":
        light = np.full(sensor.shape, float(shot.photons or 0))
    elif shot.kind == "scene":
        light = np.asarray(targets[shot.target or ""], float)
    light = meet("light", light)

    mean_e = sensor.efficiency * specimen.response * light + thermal_e
    mean_e = meet("yield", mean_e)
    electrons = stream(seed, "arrivals", index).poisson(np.maximum(mean_e, 0)).astype(float)

    electrons = meet("charge", electrons)
    electrons = np.minimum(electrons, sensor.well_e)

    voltage_e = meet("voltage", electrons + specimen.offset_e)
    voltage_e = voltage_e + tukey_lambda(
        stream(seed, "read", index), sensor.tail, sensor.read_e, sensor.shape
    )

    dn = np.rint(meet("converter", voltage_e / sensor.e_per_dn + sensor.pedestal_dn))
    return meet("code", np.clip(dn, 0, 2**sensor.bits - 1)).astype(np.uint16)
