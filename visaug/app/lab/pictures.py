"""What the page draws, and its reports. They are made one at a time, beside whatever else is being computed."""

import hashlib
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import RLock
from typing import Any

from visaug.app.lab.bench import Bench
from visaug.app.lab.data import OwnPicture, map_data, view_data
from visaug.camera import Camera
from visaug.core.errors import InputError
from visaug.core.wording import frames_text
from visaug.frames import FrameSet
from visaug.report.html import Figure, Page, Text, figure, footer, render
from visaug.report.pages import described, diagnosis_sections, write_comparison, write_diagnosis
from visaug.report.plots.error import plot_error_steps
from visaug.report.views import ViewGallery
from visaug.statistics.conditions import labels

COMPARED = "_compared"  # ends a key with which views show their worst statistic: before the comparison nobody knows it


class ViewPlots:
    """Views of the measured frames beside those of a camera, computed when they are first asked for; `closed` when nobody waits for
    further ones.
    """

    def __init__(self, frames: FrameSet, seed: int):
        self.closed = False
        self.frames, self.seed = frames, seed
        self._drawing = RLock()  # matplotlib's settings are global
        self._galleries: OrderedDict[str, tuple[Camera, ViewGallery | None]] = OrderedDict()

    def announce(self, camera: Camera, compared: bool = False) -> str:
        """The key under which pictures of a camera can be asked for; another one after the comparison."""
        key = hashlib.blake2b(camera.to_yaml().encode(), digest_size=8).hexdigest()
        kept = 4  # cameras whose pictures are kept
        with self._drawing:
            self._galleries.setdefault(key, (camera, None))
            self._galleries.move_to_end(key)
            while len(self._galleries) > kept:
                self._galleries.popitem(last=False)
        return key + COMPARED * compared

    def view(self, key: str, name: str, worst: str = "") -> dict[str, Any] | None:
        """A view's curves and maps, of its worst statistic; None where the frames do not show it, or the camera is gone."""
        gallery = self._gallery(key)
        found = gallery and gallery.shown(name, worst)
        if not found:
            return None
        measured, (modelled,) = found
        return view_data(measured.title.rstrip("."), measured, modelled)

    def frame(self, key: str, index: int) -> dict[str, Any] | None:
        """One measured frame and the same frame as the camera takes it, in DN; None where there is no such frame.

        `choices` holds one frame of each condition: its place among the frames in use, and its condition in words.
        """
        gallery = self._gallery(key)
        if gallery is None or not 0 <= index < len(gallery.sets[0]):
            return None
        groups = list(gallery.sets[0].groups())
        words = labels(groups).values()
        choices = {g.indices[0]: frames_text(word) for g, word in zip(groups, words, strict=True)}
        title = choices.get(index, f"frame {index}")
        maps = [map_data(title, *(frames.read(index) for frames in gallery.sets))]
        about = {"title": title, "names": ["measured", "modelled"], "y_label": "DN"}
        return {**about, "curves": [], "maps": maps, "choices": choices}

    def own(self, key: str, picture: OwnPicture | None, exposure: float) -> dict[str, Any] | None:
        """A picture of the user's own before and after a camera; None where there is none, or no such camera."""
        key = key.removesuffix(COMPARED)
        with self._drawing:
            if picture is None or key not in self._galleries:
                return None
            return picture.through(self._galleries[key][0], self.seed, exposure)

    def _gallery(self, key: str) -> ViewGallery | None:
        key = key.removesuffix(COMPARED)
        with self._drawing:
            if self.closed or key not in self._galleries:
                return None
            camera, gallery = self._galleries[key]
            if gallery is None:
                gallery = ViewGallery(self.frames, camera, self.seed)
                self._galleries[key] = (camera, gallery)
            return gallery

    def steps(self, bench: Bench) -> Figure | None:
        """The error falling on the way to the current camera, or as the diagnosis found it."""
        steps = bench.now.steps or (bench.diagnosis.steps if bench.diagnosis else ())
        if not bench.has_excess or not any(step.error for step in steps):
            return None
        with self._drawing:
            drawn = plot_error_steps([step.to_json() for step in steps], 1.0, 0.0)
            alt = ", ".join(f"{step.action} {step.error.value:.2f}" for step in steps if step.error)
            return figure(drawn, "", f"Error by steps: camera as given 1, {alt}")

    def report(self, bench: Bench, verdict: str) -> str:
        """The one-file page of the current camera: a comparison, a diagnosis, or a camera changed by hand."""
        if bench.comparison is None:
            raise InputError("nothing is compared yet", field="report", expected="a finished comparison")
        with self._drawing, TemporaryDirectory(prefix="visaug-lab-") as folder:
            path = Path(folder) / "report.html"
            inputs = replace(bench.inputs(), better=None)  # what was found is not the current camera
            common = (bench.given, self.frames, self.seed, inputs)
            if bench.now.fit:
                return render(self._by_hand(bench, verdict))
            if bench.diagnosis:
                write_diagnosis(path, bench.diagnosis, *common)
            else:
                write_comparison(path, bench.comparison, *common)
            return path.read_text(encoding="utf-8")

    def _by_hand(self, bench: Bench, verdict: str) -> Page:
        cameras = bench.given, bench.camera
        sections = diagnosis_sections(bench.to_json(), *cameras, self.frames, self.seed, bench.inputs())
        blocks = [Text(verdict, "finding"), *list(sections[0].blocks)[1:]]
        sections[0] = replace(sections[0], title="The current camera", blocks=blocks)
        by_hand = "with effects added and taken away by hand"
        lead = f"{described(self.frames)} against {bench.given.name}, {by_hand}."
        return Page("Diagnosis by hand", lead, sections, footer=footer(bench.given, self.frames, self.seed))
