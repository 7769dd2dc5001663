"""Frames that come with the package beside their cameras' files: simulated ones with a hidden effect, and real ones."""

from dataclasses import replace
from pathlib import Path

import visaug
from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.progress import Progress
from visaug.report.headline import comparison_headline
from visaug.report.html import Section, Text
from visaug.report.next_step import Inputs
from visaug.report.pages import diagnosis_sections, where_table
from visaug.report.views import ViewGallery
from visaug_train.studies.hidden import kept_diagnosis

FRAMES = Path(visaug.__file__).parent / "data" / "hidden_effect"
REAL = FRAMES.with_name("ccd12")


def hidden_effect_sections(output: Path, seed: int = 0, progress: Progress | None = None) -> list[Section]:
    """Diagnose the frames that come with the package; an answer of an earlier call with this seed is kept in `output`."""
    camera = visaug.Camera.load(FRAMES / "camera.yaml")
    frames = visaug.FrameSet.load(FRAMES, resolution=camera.resolution)
    answer, found = output / f"diagnosis-{seed}.json", output / f"camera-{seed}.yaml"
    kept_diagnosis(answer, found, camera, lambda: frames, seed=seed, progress=progress)
    return story_sections(camera, frames, answer, found, seed)


def story_sections(
    camera: visaug.Camera, frames: visaug.FrameSet, answer: Path, better_file: Path, seed: int
) -> list[Section]:
    """The sections of a kept diagnosis: of `frames`, from the incomplete `camera` on."""
    intro = Text(
        "A camera's file, and frames that it took; the file is incomplete. The"
        " frames were simulated by code that shares nothing with the model. Which physical effect is "
        "missing, and how strong is it?"
    )
    better = visaug.Camera.load(better_file)
    inputs = Inputs.of(camera, frames, better_file)
    sections = diagnosis_sections(read_json(answer), camera, better, frames, seed, inputs)
    first = replace(sections[0], blocks=[intro, *sections[0].blocks])
    return [replace(each, title=f"Hidden effect: {each.title.lower()}") for each in (first, *sections[1:])]


def real_camera() -> tuple[visaug.Camera, visaug.FrameSet]:
    """The 12-bit CCD's published parameters and its frames, which are share-alike and so in the source tree alone."""
    if not REAL.is_dir():
        problem = "is not in the wheel: its licence is CC BY-SA 3.0"
        raise InputError(problem, file=REAL, expected="a clone, or the source archive")
    camera = visaug.Camera.load(REAL / "camera.yaml")
    return camera, visaug.FrameSet.load(REAL, resolution=camera.resolution, bit_depth=camera.bit_depth)


def real_camera_section(seed: int = 0) -> Section:
    """Whether the published parameters explain a real camera's frames, and the four views that differ most."""
    camera, frames = real_camera()
    content = visaug.compare(camera, frames, seed=seed).to_json()
    intro = (
        "Real frames: a 12-bit CCD (640 x 480), the EMVA 1288 reference set of Basler AG, 2011 (M. Grimm; CC BY-SA 3.0, and so "
        "are the pictures of this section), cut to 192 x 256 pixels. Beside them the same frames as the base chain makes them "
        "from the parameters that were published for this camera, nothing fitted."
    )
    views = list(dict.fromkeys(place["view"] for place in content["where"]))
    pictures = ViewGallery(frames, camera, seed).pictures(views[:4])
    blocks = [Text(intro), Text(comparison_headline(content), "finding"), *pictures.values()]
    return Section("A real camera beside its model", [*blocks, where_table(content["where"])])
