"""The sections of a study with cameras made from pictures: the gain, and the parameters estimated from the pictures."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

import visaug
from visaug.report.html import Figure, Section, Table, Text, figure
from visaug.report.plots.images import plot_images
from visaug_train import tables
from visaug_train.noise import vis_noise
from visaug_train.plots import plot_scores
from visaug_train.reduction import read_pixels
from visaug_train.studies.oracle import MEASURE, ArmGain, gain_table, target_sets
from visaug_train.studies.target import TargetCamera

if TYPE_CHECKING:
    from visaug_train.results import Ablation

STATED = {
    "gain_e_per_dn": "gain, e-/DN",
    "black_level_dn": "black level, DN",
    "read_noise.sigma_e": "read noise, DN",
    "row_noise.sigma_e": "row noise, DN",
    "dsnu.column_e": "column pattern, DN",
    "dsnu.pixel_e": "pixel pattern, DN",
}


def target_sections(ablation: "Ablation") -> list[Section]:
    """Nothing without an oracle or cameras that were made."""
    sections = []
    if ablation.gains:
        sections.append(Section("Gain by cameras estimated from pictures", list(_gains(ablation))))
    if ablation.study.cameras:
        sections.append(Section("Cameras estimated from pictures", list(_cameras(ablation))))
    return sections


def gain_finding(gain: ArmGain, oracle: str) -> str:
    """What came out for one arm, whichever way, in a sentence."""
    change, low, high = gain.gain
    verdict = "raises" if low > 0 else "lowers" if high < 0 else "does not clearly change"
    return (
        f"Arm {gain.arm} {verdict} the keypoint AP on {' and '.join(gain.domains)}: {gain.baseline:.3f} to "
        f"{gain.baseline + change:.3f} ({tables.signed(change, low, high)}). Arm {oracle} changes it by "
        f"{tables.signed(*gain.oracle)}; share of that gain: {gain}."
    )


def _gains(ablation: "Ablation") -> Iterator[Text | Table | Figure]:
    oracle, baseline = str(ablation.config.oracle), ablation.config.baseline
    most = max(len(gain.domains) for gain in ablation.gains)
    for gain in ablation.gains:
        if len(gain.domains) == most:
            yield Text(gain_finding(gain, oracle), "finding")
    points = {
        domain: {arm: ablation.of_seeds(arm, domain, MEASURE) for arm in ablation.means}
        for domain in target_sets(ablation)
    }
    yield figure(plot_scores(points), "Keypoint AP50-95 (COCO's). Bars: mean over seeds. Dots: seeds.")
    table = gain_table(ablation.gains, baseline, oracle)
    yield Table(table.head, table.rows, f"{table.title}, with 95 % intervals.")
    yield Text(f"95 % intervals: {ablation.interval_covers}. Shares: Fieller's interval of a ratio.", "note")


def _cameras(ablation: "Ablation") -> Iterator[Text | Table | Figure]:
    cameras = ablation.study.cameras
    estimates = [camera for camera in cameras if camera.answer is not None]
    true = {camera.domain: camera for camera in cameras if camera.answer is None}
    if estimates:
        yield Text(
            "Each camera was estimated from pictures of its domain alone; their labels were not used. Noise is given in steps"
            " of the 8-bit pictures (DN), which is what a network sees; electrons are that times the gain."
        )
        rows = [row for camera in estimates for row in _rows(camera, true.get(camera.domain))]
        yield Table(
            ["camera", "pictures", "parameter", "true", "estimated"], rows, "Estimated with 95 % intervals."
        )
    for camera in estimates:
        for line in (camera.answer or {}).get("warnings", []):
            yield Text(f"{camera.name}: {line}.", "note")
    yield _pictures(ablation)


def _rows(camera: TargetCamera, true: TargetCamera | None) -> Iterator[list[str]]:
    found = (camera.answer or {})["parameters"]
    known = _flat(visaug.Camera.load(true.file).to_dict()) if true else {}
    for key, label in STATED.items():
        entry = found.get(key)
        in_dn = key.split(".")[-1].endswith("_e")
        gain = found["gain_e_per_dn"]["value"] if in_dn else 1.0
        estimate = (
            "not determined"
            if entry is None
            else f"{entry['value'] / gain:.3g} [{entry['low'] / gain:.3g}, {entry['high'] / gain:.3g}]"
        )
        value = known.get(key, 0.0) / (known["gain_e_per_dn"] if in_dn else 1.0) if known else None
        yield [camera.name, str(camera.pictures), label, "" if value is None else f"{value:.3g}", estimate]


def _flat(content: dict[str, Any]) -> dict[str, float]:
    """Values of a camera by path, those of its effects too."""
    found: dict[str, float] = {}
    for key, value in content.items():
        if isinstance(value, dict):
            found |= {f"{key}.{name}": v for name, v in value.items() if isinstance(v, int | float)}
        elif isinstance(value, int | float):
            found[key] = value
    for effect in content.get("effects", []):
        found |= {f"{effect['name']}.{name}": v for name, v in effect.items() if isinstance(v, int | float)}
    return found


def _pictures(ablation: "Ablation") -> Figure:
    """For each camera: two of the test pictures, and a clean training image as its noise makes it."""
    study = ablation.study
    files = [study.training_images.files[i] for i in (0, 1)]
    clean = torch.from_numpy(np.stack([read_pixels(file) for file in files])[:, None] / 255).float()
    pictures, titles = list(clean[:, 0].numpy()), ["clean training image"] * 2
    for domain in target_sets(ablation):
        pictures += [read_pixels(file) / 255 for file in study.tests[domain].files[:2]]
        titles += [f"{domain}: test picture"] * 2
    parts = {name: study.config.arm(name).vis for name in study.config.arms}
    for camera in study.cameras:
        vis = next((p for p in parts.values() if p is not None and str(camera.file) in p.cameras), None)
        if vis is None:
            continue
        with torch.random.fork_rng(devices=[]), torch.no_grad():
            torch.manual_seed(0)
            noisy = vis_noise(vis.model_copy(update={"camera": str(camera.file), "p": 1.0}))(clean)
        pictures += list(noisy[:, 0].numpy())
        titles += [f"clean, {camera.name}"] * 2
    return figure(
        plot_images(pictures, titles, columns=4, limits=(0, 1)),
        "Pictures of the test sets, and clean training images with the noise of each camera.",
        raster=True,
    )
