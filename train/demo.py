"""The main job: a real camera beside its model, the ablation on rendered data, a hidden effect; one report."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from visaug.core.errors import InputError
from visaug.report.html import Page, write_page
from visaug.report.provenance import footer
from visaug.report.real_camera import real_camera_section
from visaug_train.ablation import Ablation, ablate
from visaug_train.arms import Arm
from visaug_train.config import Config, load_config
from visaug_train.render.independent_camera import LIGHTBOX_CAMERA
from visaug_train.report import ablation_sections, finding, timing_section
from visaug_train.studies.laboratory import BIASES, FLATS, LEVELS, diagnosed_camera, diagnosis_of
from visaug_train.studies.story import hidden_effect_sections

Progress = Callable[[str, int, int], None]
CONFIG = Path(__file__).resolve().parents[1] / "configs" / "demo.yaml"


def demo_config(output: str | Path, seed: int = 0) -> Config:
    """The demo's config, writing to `output`."""
    if not CONFIG.is_file():
        raise InputError(
            "no such file", file=CONFIG, expected="a checkout of the project, which has configs/demo.yaml"
        )
    config = load_config(CONFIG)
    return config.model_copy(update={"output": Path(output), "seeds": [s + seed for s in config.seeds]})


def with_diagnosed(config: Config, seed: int = 0, progress: Progress | None = None) -> Config:
    """The config with an arm more: the sensor noise of the lightbox-like camera as a diagnosis of its frames finds it."""
    vis = config.arm("vis").vis
    assert vis is not None
    found = diagnosed_camera(
        LIGHTBOX_CAMERA, "lightbox camera", config.output / "lightbox_camera", seed, progress
    )
    named = ", ".join(diagnosis_of(found)["accepted"]) or "nothing"
    arm = Arm(
        like=config.baseline,
        why=f"the same, and the sensor noise of the lightbox-like camera: its data sheet and what a diagnosis of "
        f"{BIASES + FLATS * len(LEVELS)} frames of it found missing there ({named})",
        vis=vis.model_copy(update={"camera": str(found)}),
    )
    return config.model_copy(update={"arms": {**config.arms, "vis_diagnosed": arm}})


def run_ablation(output: str | Path, seed: int = 0, progress: Progress | None = None) -> Ablation:
    """Render, train the arms, score them on the test sets; goes on where it was stopped."""
    config = with_diagnosed(demo_config(output, seed), seed, progress)
    ablation = ablate(config, progress, partial(print, flush=True))
    ablation.write(Path(output) / "tables")
    print(ablation.tables()["overview"].to_markdown(), flush=True)
    return ablation


def run_demo(output: str | Path, seed: int = 0, progress: Progress | None = None) -> Path:
    """The whole job: a real camera, the ablation, a hidden effect; returns the report's path."""
    output = Path(output)
    say = progress or (lambda *_: None)
    seconds: dict[str, float] = {}

    @contextmanager
    def timed(part: str) -> Iterator[None]:
        began = time.monotonic()
        say(part, 0, 1)
        yield
        seconds[part] = time.monotonic() - began
        say(part, 1, 1)

    with timed("a real camera beside its model"):
        sections = [real_camera_section(seed)]
    ablation = run_ablation(output, seed, progress)
    with timed("pictures and intervals"):
        sections += ablation_sections(ablation)
    with timed("a hidden effect"):
        sections += hidden_effect_sections(output / "hidden_effect", seed, progress)
    sections.append(timing_section(ablation, seconds))
    return write_page(
        output / "report.html",
        Page(
            "Sensor noise as augmentation: the demonstration",
            finding(ablation),
            sections,
            footer=footer(None, None, seed),
        ),
    )
