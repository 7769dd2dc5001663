"""Flats of unknown photons are simulated with those that give their measured level, with each camera its own.

What a lens or a bend takes from the level is made up for by more light: nothing but the level was measured, so that it says nothing
of the camera. Everything else that the flats show, their noise and their patterns, does.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from visaug.camera import Camera
from visaug.frames import FrameRecord, FrameSet

ROUNDS = 3  # of simulations at most
SAME = 2e-4  # relative change of the light that noise makes, and that is none
MOST = 2.0  # factor by which a round changes the light at most

# (levels,) simulated means of a camera, in DN, with these photons
Levels = Callable[[Camera, Sequence[float]], np.ndarray]


class UnmeasuredLight(NamedTuple):
    """Flats of one setting of the lamp whose photons are not known.

    Attributes:
        dn: mean of those that are measured.
        shown: their positions among the frames of a part.
        planned: positions of all of them in its plan.
    """

    dn: float
    shown: tuple[int, ...]
    planned: tuple[int, ...]
    exposure_s: float
    temperature_c: float | None
    gain_db: float

    def dark_dn(self, camera: Camera) -> float:
        """The level without light."""
        dark_e = camera.dark_rate_at(self.temperature_c) * self.exposure_s
        return camera.spec.black_level_dn + dark_e / camera.gain_at(self.gain_db)

    def photons(self, camera: Camera) -> float:
        """Of a camera without further effects."""
        electrons = (self.dn - self.dark_dn(camera)) * camera.gain_at(self.gain_db)
        return max(electrons, 0.0) / camera.spec.quantum_efficiency


def levels_of(
    frames: FrameSet, plan: FrameSet, keep: Sequence[int], unknown: frozenset[int]
) -> tuple[UnmeasuredLight, ...]:
    """The levels of a part whose photons are not known, of those that are measured.

    Args:
        frames: the measured frames of the part; their records have one number of photons for one setting of the lamp.
        plan: the sequence in which they were taken.
        keep: positions of the frames in it.
        unknown: sequence numbers of the flats of unknown photons.
    """

    def condition(record: FrameRecord) -> tuple:
        return record.photons, record.exposure_s, record.temperature_c, record.gain_db

    planned: dict[tuple, list[int]] = {}
    for i, record in enumerate(plan.records):
        if record.sequence in unknown:
            planned.setdefault(condition(record), []).append(i)
    places = {i: k for k, i in enumerate(keep)}
    found = []
    for (_, exposure, temperature, gain), own in planned.items():
        shown = tuple(places[i] for i in own if i in places)
        if shown:
            dn = float(np.mean([frames.read(k).mean(dtype=np.float64) for k in shown]))
            found.append(UnmeasuredLight(dn, shown, tuple(own), exposure or 0.0, temperature, gain))
    return tuple(found)


def photons_of(camera: Camera, levels: Sequence[UnmeasuredLight], simulated: Levels) -> list[float]:
    """(levels,) the photons with which a camera gives the measured levels.

    Those of a camera without further effects follow from its parameters. Further effects change them by the ratio of the light of
    both cameras in simulations that share their random numbers, whose noise is not in it.
    """
    photons = np.array([level.photons(camera) for level in levels])
    if not camera.effect_names:
        return photons.tolist()
    plain = camera
    for name in camera.effect_names:
        plain = plain.without_effect(name)
    dark = np.array([level.dark_dn(camera) for level in levels])
    wanted = simulated(plain, photons.tolist()) - dark
    for _ in range(ROUNDS):
        there = simulated(camera, photons.tolist()) - dark
        ratio = np.divide(wanted, there, out=np.full_like(wanted, MOST), where=there > 0)
        ratio = np.where(np.abs(ratio - 1) < SAME, 1.0, np.clip(ratio, 1 / MOST, MOST))
        if (ratio == 1).all():
            break
        photons = photons * ratio
    return photons.tolist()
