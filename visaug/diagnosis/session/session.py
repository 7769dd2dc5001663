"""A diagnosis step by step: refit, try, add and remove effects, search."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from visaug.camera import Camera
from visaug.camera.paths import path_of
from visaug.characterization.usable import usable
from visaug.core.errors import InputError
from visaug.core.nearest import did_you_mean
from visaug.diagnosis.comparison import Comparison, compare
from visaug.diagnosis.result import Diagnosis, Step
from visaug.diagnosis.search import SETS, diagnose
from visaug.diagnosis.session.fits import CameraFit, Fits, Names
from visaug.frames import FrameSet
from visaug.statistics.distance import Error
from visaug.statistics.places import Places

Report = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Setup:
    """The camera of a session: the file as given, or the file with effects added and removed, refitted.

    Attributes:
        without: effects of the file that were removed.
        added: effects that were added, in this order.
        fit: None for the file as given.
        steps: the errors on the way here.
        numbers: set by hand, by path as in camera.yaml; nothing was refitted since.
        quick: whether `fit` is an estimate from a few simulated sets.
    """

    without: Names = ()
    added: Names = ()
    fit: CameraFit | None = None
    steps: tuple[Step, ...] = field(default=())
    numbers: Mapping[str, float] = field(default_factory=dict)
    quick: bool = False


class Session:
    """One camera and one frame set, with effects added and removed by hand or by a search.

    Args:
        camera: the camera model. Errors are relative to it.
        frames: measured bias, dark, flat or scene frames.
        seed: of all simulations.
        sets: simulated sets of the camera file; fewer are faster and less certain.
        progress: called with (description, done, total) during long work.

    Attributes:
        given: the camera file.
        now: the effects added and removed, and the fit with them.
        comparison: of the camera file; None until `compare` was called.
        diagnosis: of the camera file; None until `search` was called.

    Raises:
        InputError: frames of kind image, or too few frames.

    Examples:
        >>> session = visaug.Session(camera, frames)  # doctest: +SKIP
        >>> session.add("row_noise").error  # doctest: +SKIP
    """

    def __init__(
        self,
        camera: Camera | str | Path,
        frames: FrameSet | str | Path,
        seed: int = 0,
        sets: int = SETS,
        progress: Report | None = None,
    ):
        camera = Camera.load(camera)
        frames = FrameSet.of(frames, camera.resolution)
        if frames.is_pictures:
            raise InputError(
                "only ordinary pictures",
                field="frames",
                expected="bias, dark, flat or scene frames; `visaug diagnose` takes pictures",
            )
        frames = usable(frames, camera.resolution)
        self.given, self.frames, self.seed, self.sets = camera, frames, seed, sets
        self.progress: Report = progress or (lambda *_: None)
        self.fits = Fits(camera, frames, seed, sets)
        self.comparison: Comparison | None = None
        self.diagnosis: Diagnosis | None = None
        self.now = Setup()

    @property
    def camera(self) -> Camera:
        """The camera file, or the refitted camera with the added effects."""
        return self.now.fit.camera if self.now.fit else self.given

    @property
    def error(self) -> Error | None:
        """1 for the camera file, 0 for a second camera of the same type; None if the file has no significant excess."""
        if not self.now.fit:
            return Error(1.0, 1.0, 1.0) if self.has_excess else None
        return self.now.fit.error if self.has_excess else None

    @property
    def where(self) -> Places:
        """Views in which the camera differs from the frames, the largest share of the excess first."""
        return (self.now.fit or self.compare()).where

    @property
    def has_excess(self) -> bool:
        """Whether the camera file deviates significantly from the frames."""
        if self.diagnosis:
            return bool(self.diagnosis.steps)
        return not self.compare().adequate

    def compare(self) -> Comparison:
        """Compares the camera file with the frames, once."""
        if self.comparison is None:
            self.comparison = compare(self.given, self.frames, seed=self.seed, progress=self.progress)
        return self.comparison

    def refit(self) -> CameraFit:
        """Refits the camera with the effects that are added now, also numbers set by hand; the session keeps the result."""
        if self.now.numbers and (self.now.without or self.now.added):
            self._set(self.now.without, self.now.added)
        elif self.now.numbers or self.now.fit is None:
            fit = self.fits.fit(self.now.without, self.now.added, self.progress)
            self.now = Setup(self.now.without, self.now.added, fit, (Step("refit", fit.error),))
        assert self.now.fit is not None
        return self.now.fit

    def try_effect(self, name: str) -> CameraFit:
        """The fit with one more effect. The session does not change.

        Raises:
            InputError: an effect that the camera has already, or that has no strength to fit.
        """
        self._check(name)
        return self.fits.fit(self.now.without, (*self.now.added, name), self.progress)

    def add(self, name: str) -> "Session":
        """Adds an effect and refits all parameters.

        Raises:
            InputError: an effect that the camera has already, or that has no strength to fit.
        """
        if name in self.now.without:
            self._set(tuple(other for other in self.now.without if other != name), self.now.added)
        else:
            self._check(name)
            self._set(self.now.without, (*self.now.added, name))
        return self

    def remove(self, name: str) -> "Session":
        """Removes an effect and refits. With nothing added or removed, the camera is the unchanged file.

        Raises:
            InputError: an effect that the camera does not have.
        """
        if name in self.now.added:
            self._set(self.now.without, tuple(other for other in self.now.added if other != name))
        elif name in self.given.effect_names and name not in self.now.without:
            self._set((*self.now.without, name), self.now.added)
        elif name not in self.now.without:
            raise InputError(f"the camera has no {name}", field="remove", expected="an effect of the camera")
        return self

    def set_numbers(self, values: Mapping[str, float], quick: bool = False) -> CameraFit:
        """Sets numbers of the camera by hand; nothing is refitted, and `add` and `remove` refit them again.

        Args:
            values: by path as in camera.yaml, e.g. {"read_noise.sigma_e": 2.5}.
            quick: estimate the error from a few simulated sets; the p-value is then NaN.

        Raises:
            InputError: a path that the camera does not have, or a value out of its range.
        """
        camera = self.camera.replace(values)
        fit = self.fits.as_it_is(camera, quick, self.progress)
        before = self.now.fit.parameters if self.now.fit else {}
        kept = {
            name: {key: e for key, e in numbers.items() if path_of(name, key) not in values}
            for name, numbers in before.items()
        }
        steps = self.now.steps[:-1] if self.now.numbers else self.now.steps
        steps = (*steps, Step("numbers set by hand", fit.error))
        numbers = {**self.now.numbers, **values}
        fit = replace(fit, parameters=kept)
        self.now = Setup(self.now.without, self.now.added, fit, steps, numbers, quick)
        return fit

    def search(self, adopt: bool = True) -> Diagnosis:
        """Runs `visaug.diagnose`.

        Args:
            adopt: use the accepted effects as the camera of the session.
        """
        self.compare()
        self.diagnosis = diagnose(
            self.given, self.frames, seed=self.seed, progress=self.progress, sets=self.sets
        )
        if adopt and self.diagnosis.accepted:
            self._set((), self.diagnosis.accepted)
        return self.diagnosis

    def can_add(self) -> list[str]:
        """Effects that the camera lacks and that have a strength to fit, in chain order."""
        return self.fits.can_add(self.camera)

    def forget(self, name: str) -> None:
        """Drops the fits with an effect whose class was loaded anew."""
        self.fits.forget(name)
        if name in self.now.added:
            self.now = Setup()

    def _check(self, name: str) -> None:
        if name not in self.can_add():
            problem = f"{name} cannot be added" + did_you_mean(name, self.can_add())
            raise InputError(problem, field="add", expected="an effect that the camera lacks")

    def _set(self, without: Names, added: Names) -> None:
        self.compare()
        if not without and not added:
            self.now = Setup()
            return
        named = self._as_diagnosed(without, added)
        if named:
            self.now = named
            return
        fits = [self.fits.fit(without, added[:n], self.progress) for n in range(len(added) + 1)]
        first = f"without {', '.join(without)}" if without else "refit"
        actions = [first, *(f"add {name}" for name in added)]
        steps = tuple(Step(action, fit.error) for action, fit in zip(actions, fits, strict=True))
        self.now = Setup(without, added, fits[-1], steps)

    def _as_diagnosed(self, without: Names, added: Names) -> Setup | None:
        """The camera of the diagnosis, if its effects are those requested: it needs no further fit."""
        found = self.diagnosis
        if not found or without or set(added) != set(found.accepted) or not found.adequate_after:
            return None
        known = {entry.effect: entry.parameters for entry in found.ranking}
        parameters = {name: known[name] for name in added}
        fit = CameraFit(found.camera, found.error_after, found.p_value_after, Places(), parameters)
        return Setup((), added, fit, found.steps)

    def __repr__(self) -> str:
        changes = [f"+ {name}" for name in self.now.added] + [f"- {name}" for name in self.now.without]
        return f"Session({self.given.name!r}{''.join(', ' + change for change in changes)})"
