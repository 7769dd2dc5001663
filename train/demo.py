"""The main job: frames of a camera are diagnosed, networks are trained with its noise, and one report says what it gives.

The camera is that of a rendered test domain, `visaug_train.render.independent_camera`, which shares no code with the package.
Its data sheet states the base chain; banding, taps and the like are not in it. Frames of it are diagnosed from the data sheet
on, and the camera that is found becomes the noise of an arm.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import visaug
from visaug.core.cores import cores
from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.progress import Progress, phase_of
from visaug.frames import FrameRecord, FrameSet
from visaug.report.html import Page, Section, figure, footer, write_page
from visaug_train.arms import Arm, Vis
from visaug_train.checks import check_arms
from visaug_train.config import Config, load_config
from visaug_train.parallel import Workers
from visaug_train.plots import plot_scores
from visaug_train.render.independent_camera import LIGHTBOX_CAMERA, IndependentCamera
from visaug_train.report import ablation_sections, timing_section
from visaug_train.results import Ablation, ablate
from visaug_train.studies.hidden import kept_diagnosis
from visaug_train.studies.story import hidden_effect_sections, real_camera_section, story_sections
from visaug_train.training import prepare, start_network

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
SHORT, FULL = CONFIGS / "demo_short.yaml", CONFIGS / "demo.yaml"
DIAGNOSED, DOMAIN = "vis_diagnosed", "lightbox"  # the arm and the test set of the headline
NAME = "lightbox camera"
RESOLUTION = (64, 96)  # of the frames; a diagnosis takes time by the pixel
CONDITIONS = {"exposure_s": 0.01, "temperature_c": 20.0}
BIASES, FLATS = 12, 6
LEVELS = (0.1, 0.3, 0.5, 0.7)  # of full well


def demo_config(output: str | Path, seed: int = 0, full: bool = False) -> Config:
    """The demo's config, writing to `output`. Runs of different `seed` share no seed of a training."""
    file = FULL if full else SHORT
    if not file.is_file():
        raise InputError("no such file", file=file, expected="a checkout of the project, which has configs/")
    config = load_config(file)
    seeds = [s + seed * len(config.seeds) for s in config.seeds]
    return config.model_copy(update={"output": Path(output), "seeds": seeds})


def data_sheet(camera: IndependentCamera, name: str, resolution: tuple[int, int]) -> dict[str, Any]:
    """The base chain of a camera as a camera.yaml states it: nothing of banding, taps, blooming, flare or bend."""
    return {
        "name": name,
        "resolution": list(resolution),
        "bit_depth": 12,
        "quantum_efficiency": camera.quantum_efficiency,
        "gain_e_per_dn": camera.e_per_dn,
        "black_level_dn": camera.black_level_dn,
        "full_well_e": camera.full_well_e,
        **CONDITIONS,
        "read_noise": {"sigma_e": camera.read_noise_e, "shape": -0.1},
        "prnu": {"pixel": camera.pixel_gain},
        "dsnu": {"column_e": camera.column_offset_e, "pixel_e": camera.pixel_offset_e},
    }


def take_frames(camera: IndependentCamera, resolution: tuple[int, int], seed: int = 0) -> FrameSet:
    """Bias frames and flats of known light, in mixed order."""
    rng = np.random.default_rng([20261, seed])
    white = camera.full_well_e / camera.quantum_efficiency
    photons = [0.0] * BIASES + [level * white for level in LEVELS for _ in range(FLATS)]
    records, frames = [], []
    for sequence, i in enumerate(rng.permutation(len(photons))):
        kind, exposure_s = ("flat", CONDITIONS["exposure_s"]) if photons[i] else ("bias", 0.0)
        where = (sequence, f"frame{sequence:03d}", kind, exposure_s, CONDITIONS["temperature_c"], 0.0)
        records.append(FrameRecord(*where, photons=photons[i] or None))
        frames.append(camera.expose(np.full(resolution, photons[i]), rng))
    return FrameSet.from_arrays(records, np.stack(frames), bit_depth=12)


def diagnosed_camera(output: Path, seed: int = 0, progress: Progress | None = None) -> tuple[Path, Path]:
    """The files of the camera that a diagnosis of the lightbox-like camera's frames finds, and of its answer; kept once made."""
    folder = output / "lightbox_camera"
    found, answer = folder / f"camera-{seed}.yaml", folder / f"diagnosis-{seed}.json"
    stated = visaug.Camera.load(data_sheet(LIGHTBOX_CAMERA, NAME, RESOLUTION))

    def frames() -> FrameSet:
        stated.save(folder / "data_sheet.yaml")
        return take_frames(LIGHTBOX_CAMERA, RESOLUTION, seed)

    # In training: one known camera, but its images reach the network reduced, which takes some of the white noise and shortens
    # the period of a banding.
    relative = ("read_noise.sigma_e", "dsnu.column_e", "dsnu.pixel_e")
    banding = ("periodic_banding.amplitude_e", "periodic_banding.period_rows")
    spreads = {"gain_db": {"std": 1.0}, **dict.fromkeys(relative, 0.2), **dict.fromkeys(banding, 0.3)}
    kept_diagnosis(answer, found, stated, frames, spreads, seed=seed, progress=progress)
    return found, answer


def with_diagnosed(config: Config, seed: int = 0, progress: Progress | None = None) -> Config:
    """The config with an arm more: the sensor noise of the lightbox-like camera as a diagnosis of its frames finds it."""
    found, answer = diagnosed_camera(config.output, seed, progress)
    named = ", ".join(read_json(answer)["accepted"]) or "nothing"
    arm = Arm(
        like=config.baseline,
        why=f"the same, and the sensor noise of the lightbox-like camera: its data sheet and what a diagnosis of "
        f"{BIASES + FLATS * len(LEVELS)} frames of it found missing there ({named})",
        vis=Vis(camera=str(found)),
    )
    return config.model_copy(update={"arms": {**config.arms, DIAGNOSED: arm}})


def train_side_by_side(
    output: str | Path, seed: int = 0, progress: Progress | None = None, full: bool = False
) -> float:
    """Diagnose, render and train in several processes; returns the seconds of the diagnosis, 0 where it was there.

    Arms that need no diagnosis are trained beside it. A run that fails is tried again, and told of, by `run_ablation`.
    """
    config = demo_config(output, seed, full)
    runs = (len(config.arms) + 1) * len(config.seeds)
    most_processes = 4  # each takes about 1 GB of memory
    with Workers(min(cores(), most_processes), runs, progress) as workers:
        diagnosis = workers.submit(_diagnose, config.output, seed)
        study = prepare(config, progress)
        start_network(study, progress)
        for number in config.seeds:
            for arm in config.arms:
                workers.train(study, arm, number)
        seconds = diagnosis.result()
        study = replace(study, config=with_diagnosed(config, seed))
        for number in config.seeds:
            workers.train(study, DIAGNOSED, number)
    return seconds


def _diagnose(output: Path, seed: int, progress: Progress | None = None) -> float:
    """Run the diagnosis and return its duration in seconds. Progress names phases, because other work reports beside it."""

    def show(step: str, done: int, total: int) -> None:
        if progress:
            progress(f"diagnosis: {phase_of(step)}", done, total)

    began = time.monotonic()
    diagnosed_camera(output, seed, show)
    return time.monotonic() - began


def run_ablation(
    output: str | Path, seed: int = 0, progress: Progress | None = None, full: bool = False
) -> Ablation:
    """Diagnose, render, train the arms, score them on the test sets; goes on where it was stopped."""
    ablation = ablate(with_diagnosed(demo_config(output, seed, full), seed, progress), progress)
    ablation.write(Path(output) / "tables")
    return ablation


def run_demo(
    output: str | Path, seed: int = 0, progress: Progress | None = None, full: bool = False
) -> tuple[Path, list[str]]:
    """The whole job; returns the report's path and the finding, in three sentences.

    It starts processes that import the calling script: call it under `if __name__ == "__main__":`. `full` is the longer study:
    three arms of a network that is trained from nothing, four test sets, a real camera beside its model, and a second hidden
    effect.
    """
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

    check_arms(demo_config(output, seed, full))  # before the minutes of a diagnosis
    seconds["diagnosis of the lightbox-like camera"] = train_side_by_side(output, seed, progress, full)
    ablation = run_ablation(output, seed, progress, full)
    said = finding(ablation, output, seed)
    with timed("pictures and intervals"):
        sections = [_first_screen(ablation), *_story(output, seed), *ablation_sections(ablation)]
    if full:
        with timed("a real camera beside its model"):
            sections.append(real_camera_section(seed))
        with timed("a second hidden effect"):
            sections += hidden_effect_sections(output / "hidden_effect", seed, progress)
    sections.append(timing_section(ablation, seconds))
    title = "Sensor noise as augmentation: the demonstration"
    page = Page(title, " ".join(said), sections, footer=footer(None, None, seed))
    return write_page(output / "report.html", page), said


def finding(ablation: Ablation, output: Path, seed: int = 0) -> list[str]:
    """What was found missing, what it changes on the images of that camera, and on the other test sets."""
    answer = read_json(diagnosed_camera(output, seed)[1])
    changes = [d for d in ablation.differences if d.arm == DIAGNOSED and d.measure == "oks_coco"]
    ap = {d.domain: d for d in ablation.differences if d.arm == DIAGNOSED and d.measure == "keypoint_ap_coco"}
    if not changes:
        raise InputError("no pair of trainings ended well", file=output / "failures")
    [own] = [d for d in changes if d.domain == DOMAIN]
    others = "; ".join(f"{d.domain} {d}" for d in changes if d.domain != DOMAIN)
    trained = (
        "Trained with the noise of the camera that the diagnosis found, the network has a mean OKS of "
        f"{own.reference + own.difference:.3f} in place of {own.reference:.3f} on that camera's images ({own}; "
        f"keypoint AP50-95 {ap[DOMAIN]})."
    )
    beside = (
        f"On the other test sets the mean OKS changes by: {others}. In brackets: 95 % intervals over "
        f"{len(ablation.seeds(DIAGNOSED))} pairs of trainings and the test images."
    )
    *names, last = answer["accepted"] or ["nothing"]
    named = f"{', '.join(names)} and {last}" if names else last
    found = f"From {BIASES + FLATS * len(LEVELS)} frames and the data sheet, the diagnosis found missing: {named}."
    return [found, trained, beside]


def _first_screen(ablation: Ablation) -> Section:
    arms, domains = ablation.means, ablation.study.tests
    points = {d: {arm: ablation.of_seeds(arm, d, "oks_coco") for arm in arms} for d in domains}
    text = "Mean OKS (COCO's) on each test set: bars are means over the trainings, dots the single trainings."
    return Section("The finding", [figure(plot_scores(points, "mean OKS (COCO)"), text)])


def _story(output: Path, seed: int) -> list[Section]:
    found, answer = diagnosed_camera(output, seed)
    stated = visaug.Camera.load(data_sheet(LIGHTBOX_CAMERA, NAME, RESOLUTION))
    return story_sections(stated, take_frames(LIGHTBOX_CAMERA, RESOLUTION, seed), answer, found, seed)
