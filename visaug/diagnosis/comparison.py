"""Compares a camera file with measured frames: whether it is adequate, how large the difference is, and where."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from visaug.camera import Camera
from visaug.characterization.usable import usable
from visaug.core.reporting import Reported
from visaug.core.wording import p_text
from visaug.diagnosis.laboratory import Laboratory
from visaug.frames import FrameSet
from visaug.pictures.part import with_a_well
from visaug.statistics import Statistic
from visaug.statistics.distance import Distance, largest_of_each, least_spread, variance
from visaug.statistics.places import Places, data_frame, places, verdict_json, z_scores
from visaug.statistics.subsample import Selection
from visaug.statistics.tail import SIGNIFICANT, is_decided

STAGES = (100, 200, 400)  # simulated sets of the camera: more while too few have been counted to decide


@dataclass(frozen=True)
class Comparison(Reported):
    """The result of `compare`.

    Attributes:
        camera: the camera that was tested.
        p_value: of the largest standardised residual, from a parametric bootstrap with the camera.
        statistics: the statistics that were compared.
        measured: (statistics,) their measured values.
        modelled: (statistics,) their means over simulated sets of the camera.
        spread: (statistics,) their standard deviations over simulated sets.
        where: views that differ, the largest share of the excess first.
        warnings: assumptions, and properties of the set that make effects undetectable.
        frame_set: the frames that were compared.
        seed: of the simulations.
        used: the frames and pixels that were used.
    """

    camera: Camera
    p_value: float
    statistics: tuple[Statistic, ...]
    measured: np.ndarray
    modelled: np.ndarray
    spread: np.ndarray
    where: Places
    warnings: tuple[str, ...]
    frame_set: FrameSet | None = field(default=None, repr=False, compare=False)
    seed: int = 0
    used: Selection | None = None

    @property
    def adequate(self) -> bool:
        """Whether the camera explains the frames: no significant difference at a false-alarm rate of 2 %."""
        return self.p_value > SIGNIFICANT

    def to_json(self) -> dict[str, Any]:
        return {
            **verdict_json(self.p_value, self.adequate, self.where),
            "differences": self.differences(),
            "used": self.used.to_json() if self.used else None,
            "warnings": list(self.warnings),
        }

    def differences(self, most: int = 40) -> list[dict[str, Any]]:
        """The statistics with the largest deviations: their measured and modelled values, standard deviation and z-score."""
        z = z_scores(self.measured - self.modelled, self.spread)
        rows = []
        for i in np.argsort(-np.abs(z))[:most]:
            s = self.statistics[i]
            rows.append(
                {
                    "view": s.view,
                    "statistic": s.name,
                    "frames": s.frames,
                    "unit": s.unit,
                    "axes": list(s.axes),
                    "measured": float(self.measured[i]),
                    "modelled": float(self.modelled[i]),
                    "standard_deviation": float(self.spread[i]),
                    "z": round(float(z[i]), 2),
                }
            )
        return rows

    def to_frame(self) -> Any:
        """All statistics as a pandas DataFrame: view, statistic, frames, unit, measured, modelled, standard_deviation, z.

        Raises:
            InputError: pandas is not installed.
        """
        columns = ["view", "statistic", "frames", "unit", "measured", "modelled", "standard_deviation", "z"]
        return data_frame(self.differences(len(self.statistics)), columns)

    def __repr__(self) -> str:
        verdict = "holds" if self.adequate else "fails in " + ", ".join(p.view for p in self.where[:3])
        return f"Comparison({self.camera.name!r} {verdict}, {p_text(self.p_value)})"


def compare(
    camera: Camera | str | Path,
    frames: FrameSet | str | Path,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
    transfer: Literal["linear", "srgb"] = "linear",
) -> Comparison:
    """Tests whether a camera explains measured frames, by comparing their statistics with those of simulated frames.

    Args:
        camera: the camera to test, or its file or name. Its parameters are not refitted.
        frames: bias, dark, flat or scene frames, or the path of a frame set; or six or more ordinary pictures, of which the black
            sky and flat regions are compared.
        seed: of the simulations.
        progress: called with (description, done, total).
        transfer: of ordinary pictures, how their values follow from light; frames are linear.

    Returns:
        The p-value of the largest deviation, and the views and statistics that differ.

    Raises:
        InputError: too few pictures, a scene without its target, or a frame that cannot be read.

    Examples:
        >>> import visaug
        >>> result = visaug.compare(camera, frames)  # doctest: +SKIP
        >>> result.adequate, result.where[0].view  # doctest: +SKIP
        (False, 'temporal_lines')
    """
    say = progress or (lambda *_: None)
    camera = Camera.load(camera)
    frames = FrameSet.of(frames, camera.resolution)
    camera, frames = (
        (with_a_well(camera), frames) if frames.is_pictures else (camera, usable(frames, camera.resolution))
    )
    lab = Laboratory(frames, camera, seed, folds=False, report=say, transfer=transfer)
    fingerprint = lab.measured[0]
    least = np.array([s.least_spread for s in fingerprint.statistics])
    sets, z, p = _tested(lab, camera, fingerprint.values, least, say)
    distance = Distance(fingerprint.statistics, fingerprint.values, sets, least)
    return Comparison(
        camera,
        p,
        fingerprint.statistics,
        fingerprint.values,
        sets.mean(0),
        np.maximum(np.sqrt(variance(sets)), least),
        places(distance, fingerprint.statistics, z),
        lab.warnings,
        frames,
        seed,
        lab.selection,
    )


def _tested(
    lab: Laboratory,
    camera: Camera,
    measured: np.ndarray,
    least: np.ndarray,
    say: Callable[[str, int, int], None],
) -> tuple[np.ndarray, np.ndarray, float]:
    """Simulated sets (R, statistics) of the camera, the standardised residuals, and the p-value of the largest.

    A hundred sets hold a false-alarm rate of 2 % only on average: single samples of a hundred gave 0.1 to 12 % (docs/results.md).
    More are simulated where the p-value is close to 2 %, which it is for one set in 17 of a complete camera.
    """
    sets, z, p_value = np.empty((0, len(measured))), np.zeros_like(measured), 1.0
    for stage in STAGES:
        done = len(sets)
        more = lab.finding(
            [(camera, k) for k in range(done, stage)],
            lambda n, done=done, stage=stage: say("simulating sets of the camera", done + n, stage),
        )
        sets = np.vstack([sets, more])
        mean, spread = sets.mean(0), np.maximum(np.sqrt(variance(sets)), least)
        z = z_scores(measured - mean, spread)
        null = largest_of_each((sets - mean) * stage / (stage - 1), least_spread(spread, least))
        largest = float(np.abs(z).max())
        p_value = float((1 + np.count_nonzero(null >= largest)) / (stage + 1))
        if is_decided(largest, null):
            break
    return sets, z, p_value
