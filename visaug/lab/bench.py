"""What lies on the bench: frames, the camera file as given, what was found, and the camera as it is now."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from visaug.camera import Camera
from visaug.comparison import Comparison, Places, compare
from visaug.diagnosis import Diagnosis, Step, diagnose
from visaug.diagnosis.search import SETS
from visaug.effects import catalogue, load_file
from visaug.errors import InputError
from visaug.frames import FrameSet
from visaug.lab.by_hand import ByHand, Fit, Names
from visaug.progress import Progress


@dataclass(frozen=True)
class Setup:
    """The camera on the bench: the file as given, or the file with effects added and taken away, refitted.

    Attributes:
        without: effects of the file that were taken away.
        added: effects that were added, in this order.
        fit: None for the file as given.
        steps: the errors on the way here.
    """

    without: Names = ()
    added: Names = ()
    fit: Fit | None = None
    steps: tuple[Step, ...] = field(default=())


class Bench:
    """The lab without its page. Methods that take `progress` are long.

    Args:
        camera: the model, as its file has it.
        frames: measured bias, dark, flat or scene frames.
        own: names of effects of one's own that are loaded already.
        output: where `save` writes the camera, beside what the page hands out.
        sets: simulated sets of the camera file.

    Attributes:
        comparison, diagnosis: of the camera file as given; None until they are done.
        now: the camera on the bench.
        loaded: names of effects of one's own.

    Raises:
        InputError: frames of which nothing is known, too few frames.
    """

    def __init__(
        self,
        camera: Camera,
        frames: FrameSet,
        own: Sequence[str] = (),
        seed: int = 0,
        output: Path | None = None,
        sets: int = SETS,
    ):
        self.given, self.frames, self.seed, self.output, self.sets = camera, frames, seed, output, sets
        self.by_hand = ByHand(camera, frames, seed, sets)
        self.comparison: Comparison | None = None
        self.diagnosis: Diagnosis | None = None
        self.now = Setup()
        self.loaded = list(own)
        self._uploads = TemporaryDirectory(prefix="visaug-lab-")

    @property
    def camera(self) -> Camera:
        return self.now.fit.camera if self.now.fit else self.given

    @property
    def has_excess(self) -> bool:
        """Whether the file as given is further off than chance: else there is no error to lower."""
        if self.diagnosis:
            return bool(self.diagnosis.steps)
        return self.comparison is not None and not self.comparison.adequate

    def compare(self, progress: Progress) -> None:
        self.comparison = compare(self.given, self.frames, seed=self.seed, progress=progress)

    def diagnose(self, progress: Progress) -> None:
        """Names what the file as given lacks. The camera on the bench stays as it is: adding is the user's."""
        self._ensure_comparison(progress)
        self.diagnosis = diagnose(self.given, self.frames, seed=self.seed, progress=progress, sets=self.sets)

    def add(self, name: str, progress: Progress) -> None:
        """One more effect, everything refitted."""
        if name in self.now.without:
            without = tuple(other for other in self.now.without if other != name)
            self._set(without, self.now.added, progress)
        elif name not in self.now.added:
            if name not in self.can_add():
                raise InputError(f"{name} cannot be added", expected="an effect that the camera lacks")
            self._set(self.now.without, (*self.now.added, name), progress)

    def remove(self, name: str, progress: Progress) -> None:
        """One effect less, everything refitted; with none added or taken away it is the file as given again."""
        if name in self.now.added:
            added = tuple(other for other in self.now.added if other != name)
            self._set(self.now.without, added, progress)
        elif name in self.given.effect_names and name not in self.now.without:
            self._set((*self.now.without, name), self.now.added, progress)

    def load(self, file_name: str, text: str) -> None:
        """Takes up an effect of one's own from the text of a Python file, which is run."""
        name = Path(file_name).name
        if not name.endswith(".py"):
            raise InputError(
                "is no Python file", file=name, expected="a .py file as `visaug effects new` writes it"
            )
        path = Path(self._uploads.name) / name
        path.write_text(text, encoding="utf-8")
        try:
            names = load_own(path)
        except InputError as mistake:
            raise InputError(str(mistake).replace(str(path), name)) from None
        for effect in names:
            self.by_hand.forget(effect)
            if effect in self.now.added:
                self.now = Setup()
            if effect not in self.loaded:
                self.loaded.append(effect)

    def can_add(self) -> list[str]:
        return self.by_hand.can_add(self.camera)

    def save(self) -> Path | None:
        """Writes the camera on the bench where `output` says; returns that path."""
        if self.output:
            self.camera.save(self.output)
        return self.output

    def camera_yaml(self) -> str:
        """The camera on the bench as a camera.yaml that can lie anywhere: measured maps are named in full."""
        content = self.camera.to_dict()
        for part in [*content.values(), *content.get("effects", ())]:
            if isinstance(part, dict) and "map" in part:
                part["map"] = str(((self.camera.folder or Path()) / part["map"]).absolute())
        return Camera.load(content).to_yaml()

    def to_json(self) -> dict[str, Any]:
        """What is on the bench in the form of `visaug diagnose --json`: `accepted` is what was added by hand."""
        assert self.comparison is not None
        fit, found = self.now.fit, self.diagnosis
        error = fit.error if fit and self.has_excess else None
        content = (found or self.comparison).to_json()
        content = {"ranking": [], "ambiguous": [], "unexplained": None, **content}
        return content | {
            "error": {
                "before": 1.0 if self.has_excess else None,
                "after": error and error.value,
                "floor": 0.0,
                "interval_after": error and [error.low, error.high],
            },
            "fits": content["fits"]
            | (
                {"p_value_after": fit.p_value, "adequate_after": fit.adequate}
                if fit
                else {"p_value_after": None, "adequate_after": None}
            ),
            "ranking": self._ranking(content["ranking"]),
            "accepted": list(self.now.added),
            "steps": [step.to_json() for step in self.now.steps] if self.has_excess else [],
        }

    def _ranking(self, ranked: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The diagnosis' ranking with what was fitted by hand."""
        fitted = self.now.fit.parameters if self.now.fit else {}
        known = {entry["effect"]: entry for entry in ranked}
        for name, parameters in fitted.items():
            blank = {"effect": name, "probability": 0.0, "error_after": None, "forms": {}}
            numbers = {key: estimate.to_json() for key, estimate in parameters.items()}
            known[name] = known.get(name, blank) | {"parameters": numbers}
        return list(known.values())

    def _ensure_comparison(self, progress: Progress) -> None:
        if self.comparison is None:  # it was stopped
            self.compare(progress)

    def _set(self, without: Names, added: Names, progress: Progress) -> None:
        self._ensure_comparison(progress)
        if not without and not added:
            self.now = Setup()
            return
        named = self._as_diagnosed(without, added)
        if named:
            self.now = named
            return
        fits = [self.by_hand.fit(without, added[:n], progress) for n in range(len(added) + 1)]
        first = f"without {', '.join(without)}" if without else "refit"
        actions = [first, *(f"add {name}" for name in added)]
        steps = tuple(Step(action, fit.error) for action, fit in zip(actions, fits, strict=True))
        self.now = Setup(without, added, fits[-1], steps)

    def _as_diagnosed(self, without: Names, added: Names) -> Setup | None:
        """The diagnosis' own camera, where it is asked for: there is nothing to fit again."""
        found = self.diagnosis
        if not found or without or set(added) != set(found.accepted) or not found.adequate_after:
            return None
        known = {entry.effect: entry.parameters for entry in found.ranking}
        parameters = {name: known[name] for name in added}
        fit = Fit(found.camera, found.error_after, found.p_value_after, Places(), parameters)
        return Setup((), added, fit, found.steps)


def load_own(file: str | Path) -> list[str]:
    """Takes up the effects of a Python file, which is run; their names.

    Raises:
        InputError: a file that cannot be imported or holds no effect, an effect without a strength to fit.
    """
    found = load_file(file)
    for effect in found:
        if not effect.strengths():
            raise InputError(
                f"{effect.name} has no strength",
                file=file,
                expected="a Parameter with strength=True, at which the effect vanishes when it is zero",
            )
    return [effect.name for effect in found]


def summary(name: str) -> str:
    """What an effect is, in a sentence."""
    return catalogue()[name].summary
