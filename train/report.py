"""The page of an ablation: tables, images with and without noise, training curves, predictions, times."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import torch

import visaug
from visaug.report.html import Figure, Page, Section, Table, Text, figure, footer, write_page
from visaug.report.noise import components
from visaug.report.plots.learning import plot_components, plot_images, plot_timing, plot_training
from visaug_train.plots import plot_dependence, plot_gallery
from visaug_train.reduction import read_pixels
from visaug_train.results import Ablation
from visaug_train.studies.hidden import proof_sections
from visaug_train.studies.target import target_sections, transductive
from visaug_train.tables import MEASURES, WHICH_OKS, by_chance, marked, overview_table, score_table
from visaug_train.training import batch_noise


def write_report(ablation: Ablation) -> Path:
    """Write report.html into the config's output; returns its path."""
    seeds = ", ".join(map(str, ablation.config.seeds))
    text = f"{len(ablation.means)} arms, seeds {seeds}; the same hyperparameters in all arms but for those that an arm sets."
    sections = [*target_sections(ablation), *proof_sections(ablation), *ablation_sections(ablation)]
    sections.append(timing_section(ablation))
    page = Page(f"Ablation: {ablation.config.name}", text, sections, footer=footer(None, None))
    return write_page(ablation.config.output / "report.html", page)


def ablation_sections(ablation: Ablation) -> list[Section]:
    return [
        Section("Scores of the arms", list(_results(ablation))),
        *_strength(ablation),
        Section("Images with and without noise", list(_images(ablation))),
        Section("Training", [_curves(ablation)]),
        _predictions(ablation),
        _dependence(ablation),
    ]


def _strength(ablation: Ablation) -> list[Section]:
    if ablation.noise is None:
        return []
    text = (
        "Standard deviations in 8-bit levels at the size of the network's input. An arm whose noise is below that of the "
        "training images can hardly change what the network learns. Figures of images are those of white noise alone: "
        'row noise, column patterns and other structure are not included. "none": no area of this level.'
    )
    blocks: list[Text | Table] = [Text(text), ablation.noise.table().block()]
    blocks += [Text(f"Warning: {line}.", "note") for line in ablation.noise.warnings()]
    return [Section("Strength of the noise", blocks)]


def timing_section(ablation: Ablation, seconds: Mapping[str, float] | None = None) -> Section:
    """How long each part took: data, runs, and what else is given in `seconds`."""
    runs = {f"train {arm}, seed {seed}": run.seconds for (arm, seed), (run, _) in ablation.scored.items()}
    parts = {"render and convert the data": ablation.study.data_seconds, **runs, **(seconds or {})}
    total = sum(parts.values())
    text = f"Seconds of each part, {total:.0f} s in total; parts that ran side by side count each."
    return Section("Computing time", [figure(plot_timing(parts), text)])


def _results(ablation: Ablation) -> Iterator[Text | Table | Figure]:
    config, seen = ablation.config, transductive(ablation.study)
    most_abreast = 2  # arms beside the baseline that fit into the page's width
    overview = overview_table(ablation.means, ablation.differences, config.baseline, most=most_abreast)
    yield marked(overview, seen).block()
    for name, arm in config.arms.items():
        if arm.why:
            yield Text(f"Arm {name}: {arm.why}.")
    for sentence in _findings(ablation):
        yield Text(sentence, "finding")
    detection, keypoints = ("box_ap", "iou"), ("keypoint_ap_paper", "oks_paper")
    by_coco = ("keypoint_ap_coco", "oks_coco")
    captions = {
        detection: "Target detection, in the form of the paper's table 2.",
        keypoints: "Keypoint regression, in the form of the paper's table 3; OKS by the paper's definition (sigma 1/11, area of "
        "the box).",
        by_coco: "The same predictions by COCO's definition (2 sigma, 0.53 of the area).",
    }
    domains = list(ablation.study.tests)
    for measures, caption in captions.items():
        head = ["arm", *(_label(measure) for _ in domains for measure in measures)]
        groups = [("", 1), *((domain, len(measures)) for domain in domains)]
        yield Table(head, score_table("", ablation.means, measures).rows, caption, groups=groups)
    if config.published:
        yield Text(WHICH_OKS, "note")
    if ablation.differences:
        measures = (detection[0], *keypoints)  # more do not fit; differences.csv has all
        found = {(d.arm, d.domain, d.measure): str(d) for d in ablation.differences}
        pairs = dict.fromkeys((d.arm, d.domain) for d in ablation.differences)
        head = ["arm", "test set", *(_label(m).removesuffix(" mean") for m in measures)]
        caption = f"Differences to {config.baseline}, with 95 % intervals"
        caption += "; keypoints by the paper's definition."
        yield Table(head, [[*pair, *(found[(*pair, m)] for m in measures)] for pair in pairs], caption)
        yield Text(f"95 % intervals: {ablation.interval_covers}.", "note")
        yield Text(by_chance(ablation.differences), "note")
    if weights := ablation.tables().get("weights"):
        yield weights.block()
        yield Text(weights.note, "note")
    notes = [f"† {arm}: {sentence}." for arm, sentence in seen.items()]
    notes += [ablation.mixed] if ablation.mixed else []
    notes += [f"Failed: {f.arm}, seed {f.seed}: {f.error}" for f in ablation.failures]
    yield from (Text(note, "note") for note in notes)


def _label(measure: str) -> str:
    """Of a measure under a caption that names the definition."""
    return MEASURES[measure][1].split(" (")[0]


def _findings(ablation: Ablation) -> Iterator[str]:
    """The conclusion from the keypoint AP: significant changes, or that there are none."""
    for arm in ablation.means:
        mine = [d for d in ablation.differences if d.arm == arm and d.measure == "keypoint_ap_coco"]
        said = [
            f"{'higher' if d.low > 0 else 'lower'} on {d.domain}, {d.reference + d.difference:.3f} instead of "
            f"{d.reference:.3f} ({d})"
            for d in mine
            if d.clear
        ]
        unclear = [d.domain for d in mine if d.low <= 0 <= d.high]
        said += [f"no clear change on {', '.join(unclear)}"] if unclear else []
        if said:
            yield f"Arm {arm}, keypoint AP50-95 (COCO) against {ablation.config.baseline}: {'; '.join(said)}."


def _images(ablation: Ablation) -> Iterator[Text | Figure]:
    config = ablation.config
    (domain, poses), *others = ablation.study.tests.items()
    files = [poses.files[i] for i in np.linspace(0, len(poses) - 1, 4).astype(int)]
    clean = np.stack([read_pixels(file) for file in files]).astype(np.float32) / 255
    pictures, titles = list(clean), [f"{domain}, clean"] * 4
    for name in config.arms:
        with torch.random.fork_rng(devices=[]), torch.no_grad():
            torch.manual_seed(0)
            batch = torch.from_numpy(clean)[:, None].repeat(1, 3, 1, 1)
            pictures += list(batch_noise(config.arm(name))(batch)[:, 0].numpy())
        titles += [f"arm {name}"] * 4
    yield figure(
        plot_images(pictures, titles),
        "The same clean images with the noise of each arm, which is drawn anew whenever an image is used.",
        raster=True,
    )
    if others:
        shown = [(name, read_pixels(file) / 255) for name, each in others for file in each.files[:4]]
        names, pictures = zip(*shown)
        yield figure(plot_images(pictures, names), "Images of the other test sets.", raster=True)
    vis = next((arm.vis for arm in map(config.arm, config.arms) if arm.vis), None)
    if vis is not None:
        camera = visaug.Camera.load(vis.cameras[0])
        parts = components(camera, clean[0])
        yield figure(
            plot_components(list(parts.values()), list(parts)),
            f"Each noise component of {camera.name} on the first of these images: the difference of two exposures, with "
            "and without it, from the same random numbers. The colour scale ends at three standard deviations.",
            raster=True,
        )


def _curves(ablation: Ablation) -> Figure:
    labels = {
        "train/pose_loss": "training pose loss",
        "train/box_loss": "training box loss",
        "metrics/mAP50-95(P)": "validation keypoint AP50-95",
    }
    scored = ablation.scored
    curves = {arm: [scored[arm, seed][0].curves for seed in ablation.seeds(arm)] for arm in ablation.means}
    text = "Losses and validation score of ultralytics (COCO's OKS, clean images) by epoch; a line for each seed."
    return figure(plot_training(curves, labels), text)


def _predictions(ablation: Ablation) -> Section:
    """Best and worst predictions of the last arm's first seed on each test set."""
    arm = list(ablation.means)[-1]
    seed = ablation.seeds(arm)[0]
    blocks = []
    for domain, each in ablation.scored[arm, seed][1].items():
        worst_first = each.worst_first()
        for what, indices in (("best", worst_first[::-1][:4]), ("worst", worst_first[:4])):
            said = f"{domain}: {what} predictions of arm {arm} by OKS (the paper's definition), seed {seed}."
            blocks.append(figure(plot_gallery(each, indices), said, raster=True))
    return Section("Predictions", blocks)


def _dependence(ablation: Ablation) -> Section:
    blocks, scored = [], ablation.scored
    for domain in ablation.study.tests:
        found = {arm: [scored[arm, s][1][domain] for s in ablation.seeds(arm)] for arm in ablation.means}
        said = f"{domain}: OKS (the paper's definition) against distance, attitude and brightness."
        blocks.append(figure(plot_dependence(found), said))
    return Section("Scores against distance, attitude and brightness", blocks)
