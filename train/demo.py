"""The main job: a real camera beside its model, the ablation on rendered data, a hidden effect; one report."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from visaug.errors import InputError
from visaug.report.html import Page, write_page
from visaug.report.real_camera import real_camera_section
from visaug_train.ablation import Ablation, ablate
from visaug_train.config import Config, load_config
from visaug_train.report import ablation_sections, finding, timing_section
from visaug_train.story import hidden_effect_sections

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


def run_ablation(output: str | Path, seed: int = 0, progress: Progress | None = None) -> Ablation:
    """Render, train both arms, score them on the three test sets; goes on where it was stopped."""
    ablation = ablate(demo_config(output, seed), progress)
    ablation.write(Path(output) / "tables")
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
        Page("Sensor noise as augmentation: the demonstration", finding(ablation), sections),
    )
