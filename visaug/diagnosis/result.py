"""The result of a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from visaug.camera import Camera
from visaug.camera.paths import place_of
from visaug.core.reporting import Reported
from visaug.diagnosis.camera_file import Mistake
from visaug.diagnosis.empirical import Component, component
from visaug.diagnosis.fitting.errors import Errors
from visaug.diagnosis.fitting.parameters import Coordinate, intervals, is_of
from visaug.diagnosis.residue import Residue
from visaug.diagnosis.verdict import Verdict
from visaug.frames import FrameSet
from visaug.statistics.distance import Error
from visaug.statistics.places import Places, data_frame
from visaug.statistics.subsample import Selection


@dataclass(frozen=True)
class FittedValue:
    """A parameter value with its 95 % interval; both limits are None if the interval is not known."""

    value: float
    low: float | None
    high: float | None
    unit: str = ""

    def reaching(self, other: "FittedValue") -> "FittedValue":
        """The same value with the interval that holds both intervals; as it is where one of them is not known."""
        if self.low is None or self.high is None or other.low is None or other.high is None:
            return self
        return FittedValue(self.value, min(self.low, other.low), max(self.high, other.high), self.unit)

    def is_apart(self, other: "FittedValue") -> bool:
        """Whether both intervals are known and have no value in common."""
        if self.low is None or self.high is None or other.low is None or other.high is None:
            return False
        return self.high < other.low or other.high < self.low

    def __str__(self) -> str:
        return f"{self.value:.3g}" + (f" {self.unit}" if self.unit not in ("", "1") else "")

    def to_json(self) -> dict[str, Any]:
        return {"value": self.value, "low": self.low, "high": self.high, "unit": self.unit}


def estimates(
    effect: str,
    camera: Camera,
    coordinates: Sequence[Coordinate],
    steps: np.ndarray | None = None,
    undetermined: np.ndarray | None = None,
) -> dict[str, FittedValue]:
    """The fitted parameters of one effect, by name.

    Args:
        effect: name of the effect.
        camera: the fitted camera.
        coordinates: free parameters, some of them those of the effect.
        steps: (R, coordinates) changes by refits to R simulated sets; if None, no interval is known.
        undetermined: (coordinates,) prior standard deviation of what the frames do not determine.
    """
    return {
        path.split(".", 1)[-1]: FittedValue(*numbers, place_of(path).parameter.unit)
        for path, numbers in intervals(coordinates, camera, steps, undetermined).items()
        if is_of(path, effect)
    }


@dataclass(frozen=True)
class Ranked:
    """A candidate effect: its probability among those tried, the remaining error with it, and its fitted parameters."""

    effect: str
    probability: float
    error_after: float | None
    parameters: dict[str, FittedValue]
    forms: dict[str, str] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        return {
            "effect": self.effect,
            "probability": self.probability,
            "error_after": self.error_after,
            "parameters": {name: estimate.to_json() for name, estimate in self.parameters.items()},
            "forms": dict(self.forms),
        }


@dataclass(frozen=True)
class Step:
    """One step of the diagnosis and the error after it, on the hold-out frames."""

    action: str
    error: Error | None

    def to_json(self) -> dict[str, Any]:
        if self.error is None:
            return {"action": self.action, "error": None, "interval": None}
        return {
            "action": self.action,
            "error": self.error.value,
            "interval": [self.error.low, self.error.high],
        }


@dataclass(frozen=True)
class Diagnosis(Reported):
    """The result of `visaug.diagnose`.

    Attributes:
        camera: the refitted camera with the accepted effects; the file as given where none was found and the refit
            does not lower the error.
        accepted: names of the accepted effects, in the order in which they were added.
        error_after: error on the hold-out frames, 1 for the camera file and 0 for a second camera of the same type; None if the
            camera file has no significant excess.
        p_value_before: of the refitted camera without the accepted effects.
        p_value_after: of the refitted camera with the accepted effects.
        adequate_before: whether the refitted camera without them explains the frames, at a false-alarm rate of 2 %.
        adequate_after: whether it does with them.
        where: views by their share of the excess of the camera file.
        ranking: candidate effects, the most probable first.
        steps: the steps of the search, with the error after each.
        ambiguous: groups of effects that the frames do not distinguish, each with the frames that would.
        unexplained: the remaining difference, if it is significant or a cause outside the catalogue is likelier than its effects.
        form: remaining difference in the form of an accepted effect, in words.
        cannot_show: effects that these frames could not show even if they were strong.
        given: the camera file.
        frame_set: the frames.
        seed: of the simulations.
        frames: sequence numbers of the frames used to fit, select and confirm.
        used: the frames and pixels that were used.
        warnings: assumptions, and properties of the set that make effects undetectable.
        camera_file: mistakes in the camera file, which were corrected before anything else.
        effects: the verdict on each effect of the catalogue that was considered.
        outside: probability that the cause is outside the catalogue, and that the accepted effects resemble it or explain a
            small part of it by chance; None if no effect was accepted.
        component: the measured component of what is unexplained; None where it was not measured, see `with_component`.
        errors: of cameras on these frames, as `error_after` is computed.
    """

    camera: Camera
    accepted: tuple[str, ...]
    error_after: Error | None
    p_value_before: float
    p_value_after: float
    adequate_before: bool
    adequate_after: bool
    where: Places
    ranking: tuple[Ranked, ...]
    steps: tuple[Step, ...]
    frames: dict[str, list[int]]
    ambiguous: tuple[dict[str, Any], ...]
    unexplained: Residue | None
    form: str | None
    cannot_show: tuple[str, ...]
    given: Camera | None = field(default=None, repr=False, compare=False)
    frame_set: FrameSet | None = field(default=None, repr=False, compare=False)
    seed: int = 0
    used: Selection | None = None
    warnings: tuple[str, ...] = ()
    camera_file: tuple[Mistake, ...] = ()
    effects: tuple[Verdict, ...] = ()
    outside: float | None = None
    component: Component | None = None
    errors: Errors | None = field(default=None, repr=False, compare=False)

    def with_component(self, progress: Callable[[str, int, int], None] | None = None) -> "Diagnosis":
        """The diagnosis with `component`: a fixed map, spectra of rows and columns, and a variance curve of what is unexplained.

        They are measured from the discovery frames. `component.saved("better.yaml")` writes the camera with them.

        Args:
            progress: called with (description, done, total).

        Returns:
            The diagnosis as it is where nothing is unexplained.

        Examples:
            >>> found = visaug.diagnose(camera, frames).with_component()  # doctest: +SKIP
            >>> found.component.parts, found.component.error_after  # doctest: +SKIP
        """
        if self.unexplained is None or self.errors is None:
            return self
        report = progress or (lambda *_: None)
        return replace(self, component=component(self.camera, self.errors, self.error_after, report))

    def to_json(self) -> dict[str, Any]:
        """The result as written by `visaug diagnose --json`."""
        error = self.error_after
        return {
            "schema": 1,
            "error": {
                "before": None if error is None else 1.0,
                "after": None if error is None else error.value,
                "floor": 0.0,
                "interval_after": None if error is None else [error.low, error.high],
            },
            "fits": {
                "p_value_before": self.p_value_before,
                "p_value_after": self.p_value_after,
                "adequate_before": self.adequate_before,
                "adequate_after": self.adequate_after,
            },
            "where": [place.to_json() for place in self.where],
            "ranking": [entry.to_json() for entry in self.ranking],
            "accepted": list(self.accepted),
            "steps": [step.to_json() for step in self.steps],
            "frames": self.frames,
            "ambiguous": list(self.ambiguous),
            "unexplained": self._unexplained_json(),
            "form": self.form,
            "cannot_show": list(self.cannot_show),
            "used": self.used.to_json() if self.used else None,
            "warnings": list(self.warnings),
            "camera_file": [mistake.to_json() for mistake in self.camera_file],
            "effects": [verdict.to_json() for verdict in self.effects],
            "outside": self.outside,
        }

    def _unexplained_json(self) -> dict[str, Any] | None:
        if self.unexplained is None:
            return None
        more = {} if self.component is None else {"component": self.component.to_json()}
        return self.unexplained.to_json() | more

    def to_frame(self) -> Any:
        """The ranking as a pandas DataFrame: effect, probability, error_after, parameter, value, low, high, unit, accepted.

        One row for each parameter of an effect, one row for an effect without parameters.

        Raises:
            InputError: pandas is not installed.
        """
        rows = []
        for entry in self.ranking:
            about = {
                "effect": entry.effect,
                "probability": entry.probability,
                "error_after": entry.error_after,
            }
            about["accepted"] = entry.effect in self.accepted
            numbers = [{"parameter": name, **e.to_json()} for name, e in entry.parameters.items()]
            rows += [about | one for one in numbers or [{}]]
        columns = [
            "effect",
            "probability",
            "error_after",
            "parameter",
            "value",
            "low",
            "high",
            "unit",
            "accepted",
        ]
        return data_frame(rows, columns)

    def __repr__(self) -> str:
        told = [f"{m.key}: {m.mistake}" for m in self.camera_file] + list(self.accepted)
        if self.unexplained:
            told.append(f"unexplained along {', '.join(self.unexplained.axis)}")
        return f"Diagnosis({'; '.join(told) or 'nothing missing'})"
