"""State of the page: frames, the camera file as given, what was found, and the camera as it is now."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from visaug.app.lab.data import OwnPicture
from visaug.camera import Camera
from visaug.camera.maps import named_maps, set_map
from visaug.core.errors import InputError
from visaug.core.progress import Progress
from visaug.diagnosis import SETS
from visaug.diagnosis.session import Session, Setup
from visaug.effects import catalogue, load_file
from visaug.frames import FrameSet
from visaug.report.next_step import Inputs


@dataclass
class Past:
    """What was done and the state after it, in this order, the first the camera file as given; and which of them is current."""

    entries: list[tuple[str, Setup]] = field(default_factory=lambda: [("camera as given", Setup())])
    at: int = 0

    def put(self, action: str, setup: Setup, instead: bool = False) -> None:
        """After a change, which may take the place of the last one: states that were undone are dropped."""
        first = self.at if instead and self.at else self.at + 1
        self.entries[first:] = [(action, setup)]
        self.at = first

    def go(self, to: int) -> Setup:
        """Back or forward to a state, by its place; one that is not there is the nearest."""
        self.at = min(max(to, 0), len(self.entries) - 1)
        return self.entries[self.at][1]


class Bench:
    """The lab without its page. Methods that take `progress` are long.

    Args:
        own: names of effects of one's own that are loaded already.
        output: where `save` writes the camera, beside what the page hands out.
        force: whether `save` may overwrite a file that it did not write.
    """

    def __init__(
        self,
        camera: Camera,
        frames: FrameSet,
        own: Sequence[str] = (),
        seed: int = 0,
        output: Path | None = None,
        sets: int = SETS,
        force: bool = False,
    ):
        self.output, self.force = output, force
        self.own_picture: OwnPicture | None = None
        self._saved = b""  # what `save` wrote last
        self.session = Session(camera, frames, seed, sets)
        self.given, self.frames, self.seed = self.session.given, self.session.frames, seed
        self.loaded = list(own)
        self.past = Past()
        self._uploads = TemporaryDirectory(prefix="visaug-lab-")

    # of the camera file as given, None until they are done; and the current camera
    comparison = property(attrgetter("session.comparison"))
    diagnosis = property(attrgetter("session.diagnosis"))
    now = property(attrgetter("session.now"))
    camera = property(attrgetter("session.camera"))

    @property
    def has_excess(self) -> bool:
        """Whether the camera file differs by more than chance, as far as that is known yet."""
        return (self.comparison or self.diagnosis) is not None and self.session.has_excess

    def compare(self, progress: Progress) -> None:
        self._with(progress).compare()

    def diagnose(self, progress: Progress) -> None:
        """Names what the file as given lacks. The current camera stays as it is: adding is the user's choice."""
        self._with(progress).search(adopt=False)

    def add(self, name: str, progress: Progress) -> None:
        """One more effect, everything refitted; a second request for it changes nothing."""
        if name not in self.now.added:
            self._with(progress).add(name)
            self.past.put(f"add {name}", self.now)

    def remove(self, name: str, progress: Progress) -> None:
        """One effect less, everything refitted; with none added or removed it is the file as given again."""
        if name in (*self.now.added, *self.given.effect_names):
            self._with(progress).remove(name)
            self.past.put(f"remove {name}", self.now)

    def set_numbers(self, values: Mapping[str, float], quick: bool, progress: Progress) -> None:
        """Numbers of the camera set by hand, nothing refitted; the error is estimated from few sets, or from many."""
        again = bool(self.now.numbers) and set(values) <= set(self.now.numbers)
        self._with(progress).set_numbers(values, quick)
        self.past.put(f"set {', '.join(self.now.numbers)}", self.now, instead=again)

    def settle(self, progress: Progress) -> None:
        """The full estimate of the error of a camera whose numbers were set by hand."""
        if self.now.quick:
            self.set_numbers(self.now.numbers, False, progress)

    def go(self, to: int) -> None:
        """Back or forward in the cameras."""
        self.session.now = self.past.go(to)

    def _with(self, progress: Progress) -> Session:
        self.session.progress = progress
        return self.session

    def load(self, file_name: str, text: str) -> str:
        """Takes up an effect of one's own from the text of a Python file, which is run; what was loaded, in words."""
        name = Path(file_name).name
        if not name.endswith(".py"):
            expected = "a .py file as `visaug effects new` writes it"
            raise InputError("is not a Python file", file=name, expected=expected)
        path = Path(self._uploads.name) / name
        path.write_text(text, encoding="utf-8")
        try:
            names = load_own(path)
        except InputError as mistake:
            raise InputError(str(mistake).replace(str(path), name)) from None
        for effect in names:
            self.session.forget(effect)
            if effect not in self.loaded:
                self.loaded.append(effect)
            self.past = Past() if self.now.fit is None else self.past
        return f"loaded {', '.join(names)}: Add puts it into the camera, and the next diagnosis tries it"

    def can_add(self) -> list[str]:
        return self.session.can_add()

    def save(self) -> Path | None:
        """Writes the current camera where `output` says, but not over a file that this lab did not write; returns that path."""
        if self.output is None:
            return None
        if not self.force and self.output.exists() and self.output.read_bytes() != self._saved:
            problem = "already exists, and is not as the lab wrote it: the camera is not written there"
            expected = "the download, or a lab that is started with another -o or with --force"
            raise InputError(problem, file=self.output, expected=expected)
        self.camera.save(self.output)
        self._saved = self.output.read_bytes()
        return self.output

    def inputs(self) -> Inputs:
        """The files of this bench, as commands name them."""
        found = Inputs.of(self.given, self.frames, self.output or "camera.yaml")
        uploads = Path(self._uploads.name).resolve()  # the user knows an uploaded file by its own name
        effects = (Path(file) for file in found.effects)
        return replace(found, effects=tuple(p.name if p.is_relative_to(uploads) else str(p) for p in effects))

    def camera_yaml(self) -> str:
        """The current camera as a camera.yaml that can lie anywhere: measured maps are named in full."""
        content = self.camera.to_dict()
        for name, key in named_maps(self.camera.spec).values():
            set_map(content, key, str(((self.camera.folder or Path()) / name).absolute()))
        return Camera.load(content).to_yaml()

    def to_json(self) -> dict[str, Any]:
        """The current camera in the form of `visaug diagnose --json`: `accepted` is what was added by hand."""
        assert self.comparison is not None
        fit = self.now.fit
        error = fit.error if fit and self.has_excess else None
        full = None if self.now.quick else fit
        blank: dict[str, Any] = {"ranking": [], "ambiguous": [], "unexplained": None}
        content = blank | (self.diagnosis or self.comparison).to_json()
        after, interval = error and error.value, error and [error.low, error.high]
        before = 1.0 if self.has_excess else None
        content["error"] = {"before": before, "after": after, "floor": 0.0, "interval_after": interval}
        judged = {"p_value_after": full and full.p_value, "adequate_after": full and full.adequate}
        content["fits"] = content["fits"] | judged
        content["ranking"] = self._ranking(content["ranking"])
        content["accepted"] = list(self.now.added)
        content["steps"] = [step.to_json() for step in self.now.steps] if self.has_excess else []
        return content

    def _ranking(self, ranked: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The diagnosis' ranking with what was fitted by hand."""
        fitted = self.now.fit.parameters if self.now.fit else {}
        known = {entry["effect"]: entry for entry in ranked}
        for name, parameters in fitted.items():
            blank = {"effect": name, "probability": 0.0, "error_after": None, "forms": {}}
            numbers = {key: estimate.to_json() for key, estimate in parameters.items()}
            known[name] = known.get(name, blank) | {"parameters": numbers}
        return list(known.values())


def load_own(file: str | Path) -> list[str]:
    """Takes up the effects of a Python file, which is run; their names."""
    found = load_file(file)
    expected = "a Parameter with strength=True, at which the effect vanishes when it is zero"
    for effect in found:
        if not effect.strengths():
            raise InputError(f"{effect.name} has no strength", file=file, expected=expected)
    return [effect.name for effect in found]


def summary(name: str) -> str:
    """What an effect is, in a sentence."""
    return catalogue()[name].summary
