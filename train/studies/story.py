"""The story of a hidden effect: frames of a camera whose file leaves something out, diagnosed."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import visaug
from visaug.core.documents import read_json
from visaug.core.files import write_json
from visaug.report.html import Section, Text
from visaug.report.next_step import Inputs
from visaug.report.pages import diagnosis_sections

Progress = Callable[[str, int, int], None]
FRAMES = Path(visaug.__file__).parent / "data" / "hidden_effect"


def hidden_effect_sections(output: Path, seed: int = 0, progress: Progress | None = None) -> list[Section]:
    """Diagnose the frames that come with the package; an answer of an earlier call with this seed is kept.

    Args:
        output: folder for diagnosis.json and the better camera.yaml.
        seed: of the diagnosis.
        progress: called with (description, done, total).
    """
    camera = visaug.Camera.load(FRAMES / "camera.yaml")
    frames = visaug.FrameSet.load(FRAMES, resolution=camera.resolution)
    answer, better_file = output / f"diagnosis-{seed}.json", output / f"camera-{seed}.yaml"
    if not answer.is_file():
        diagnosis = visaug.diagnose(camera, frames, seed=seed, progress=progress)
        diagnosis.camera.save(better_file)
        write_json(answer, diagnosis.to_json())  # last: where it stands, the camera does
    return story_sections(camera, frames, answer, better_file, seed)


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
