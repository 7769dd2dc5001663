"""The main job: a real camera beside its model, then the ablation on rendered data, in one report."""

import time
from collections.abc import Callable
from pathlib import Path

from visaug_train.ablation import Ablation, ablate
from visaug_train.config import Config, load_config
from visaug_train.report import ablation_sections, finding, timing_section

from visaug.errors import InputError
from visaug.report.html import Page, Section, write_page

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


def run_demo(
    output: str | Path,
    seed: int = 0,
    progress: Progress | None = None,
    more: Callable[[Ablation], list[Section]] | None = None,
) -> Path:
    """The whole job; returns the report's path. `more` gives sections to put behind the ablation's."""
    from visaug.report.real_camera import real_camera_section

    output = Path(output)
    began = time.monotonic()
    real = real_camera_section(seed)
    seconds = {"real camera": time.monotonic() - began}
    ablation = run_ablation(output, seed, progress)
    began = time.monotonic()
    sections = [real, *ablation_sections(ablation)]
    seconds["pictures and intervals"] = time.monotonic() - began
    if more is not None:
        began = time.monotonic()
        sections += more(ablation)
        seconds["hidden effect"] = time.monotonic() - began
    sections.append(timing_section(ablation, seconds))
    return write_page(
        output / "report.html",
        Page("Sensor noise as augmentation: the demonstration", finding(ablation), sections),
    )
