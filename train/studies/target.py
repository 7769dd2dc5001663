"""Cameras that are made before a training: estimated from unlabelled pictures of a domain, or the true one of a rendered
domain. Arms name them like camera files, so a study shows what the pictures alone give, and what knowing the camera gives:
the oracle's arm knows the test cameras, and the gains of the others are given as shares of its gain.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

import visaug
from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import write_json
from visaug.core.progress import Progress
from visaug.report.html import Figure, Section, Table, Text, figure
from visaug.report.plots.learning import plot_images
from visaug_train import tables
from visaug_train.config import Config, MadeCamera, Source
from visaug_train.noise import vis_noise
from visaug_train.plots import plot_scores
from visaug_train.reduction import read_pixels, reduced_camera
from visaug_train.render.dataset import DOMAINS
from visaug_train.render.independent_camera import IndependentCamera
from visaug_train.speed import PoseSet
from visaug_train.statistics import image_variance, paired_interval, share_interval, sign
from visaug_train.studies.hidden import MEASURE, VERDICTS

if TYPE_CHECKING:
    from visaug_train.results import Ablation
    from visaug_train.training import Study


@dataclass(frozen=True)
class TargetCamera:
    """A camera that was made for arms."""

    name: str  # by which arms name it
    domain: str  # whose pictures it took
    file: Path  # its camera.yaml
    pictures: int = 0  # of how many it was estimated; 0 for a true camera
    answer: dict[str, Any] | None = None  # the estimate as `visaug characterize --json` has it
    files: tuple[Path, ...] = ()  # these pictures


def transductive(study: "Study") -> dict[str, str]:
    """The arms whose cameras were estimated from test images, each with a sentence on it."""
    found = {}
    for camera in getattr(study, "cameras", ()):
        users = [arm for arm in study.config.arms if str(camera.file) in study.config.arm(arm).camera_files]
        for domain, poses in study.tests.items():
            shared = {f.resolve() for f in camera.files} & {f.resolve() for f in poses.files}
            said = f"its camera was estimated from {len(shared)} of the {len(poses)} test images of {domain}"
            found |= dict.fromkeys(users if shared else (), f"{said}, without labels (transductive)")
    return {arm: found[arm] for arm in study.config.arms if arm in found}


def check_cameras(config: Config) -> None:
    """Refuse, before anything is rendered, true cameras that are not known."""
    for name, made in config.cameras.items():
        if made.rendered is not None and (config.data.rendered is None or made.rendered not in _known()):
            problem, field = f"the camera of {made.rendered} is not known", f"cameras.{name}.rendered"
            raise InputError(problem, field=field, expected=f"data.rendered and one of {', '.join(_known())}")


def make_cameras(
    config: Config, read: Callable[[Source], PoseSet], progress: Progress | None = None
) -> tuple[Config, tuple[TargetCamera, ...]]:
    """The config with files in place of the names of its `cameras`, and the cameras; files that exist are kept.

    `read` gives the pictures of a source; those that give no camera are refused.
    """
    made: list[TargetCamera] = []
    total, say = len(config.cameras), progress or (lambda *_: None)
    for name, each in config.cameras.items():
        say("cameras of the target", len(made), total)
        given = each.pictures
        made.append(_estimated(config, name, read(given)) if given else _true(config, name, each))
    if made:
        say("cameras of the target", total, total)
    files = {camera.name: str(camera.file) for camera in made}
    arms = {}
    for name, arm in config.arms.items():
        parts = {key: part for key in ("vis", "white") if (part := getattr(arm, key)) is not None}
        for key, part in parts.items():
            named = [files.get(camera, camera) for camera in part.cameras]
            camera = named[0] if isinstance(part.camera, str) else named
            parts[key] = part.model_copy(update={"camera": camera})
        arms[name] = arm.model_copy(update=parts)
    return config.model_copy(update={"arms": arms}), tuple(made)


def _estimated(config: Config, name: str, poses: PoseSet) -> TargetCamera:
    most_pictures = 300  # of a source, evenly spaced
    files = poses.files[:: -(-len(poses) // most_pictures)]
    size, how = _seen_size(config, name, poses), config.data.reduction
    digest = hashlib.sha256(f"{visaug.__version__} {size} {how}".encode())
    for file in files:
        digest.update(file.read_bytes())
    stem = config.output / "cameras" / f"{name}-{digest.hexdigest()[:8]}"
    camera, answer = stem.with_suffix(".yaml"), stem.with_suffix(".json")
    if not answer.is_file():
        folder = visaug.FrameSet.load(files[0].parent)
        names = {file.name for file in files}
        frames = folder.subset([i for i, record in enumerate(folder.records) if record.file in names])
        result = visaug.characterize(frames)
        if "gain_e_per_dn" not in result.parameters:
            problem = f"the {len(files)} pictures of {poses.domain} give no camera: {result.warnings[0]}"
            expected = result.not_determined["gain_e_per_dn"]
            raise InputError(problem, field=f"cameras.{name}", expected=expected)
        content = result.to_camera_dict()
        if size is not None:
            content = reduced_camera(content, poses.camera.size, size, how)
        visaug.Camera.load(content).save(camera)
        write_json(answer, result.to_json())  # last: where it stands, the camera does
    return TargetCamera(name, poses.domain, camera, len(files), read_json(answer), tuple(files))


def _seen_size(config: Config, name: str, poses: PoseSet) -> tuple[int, int] | None:
    """Width and height of the images that arms give this camera's noise: as the network gets them.

    None where these are the pictures', or the noise comes on the sensor's pixels, in all of its arms. The camera is estimated
    from whole pictures: small ones hold hardly any region that is flat.
    """
    parts = [part for arm in config.arms.values() for part in (arm.vis, arm.white)]
    places = {part.resolution for part in parts if part and name in part.cameras}
    if len(places) > 1:
        expected = "vis.resolution network or sensor in all of its arms"
        expected += ", or another camera of the same pictures"
        raise InputError("arms use it at both resolutions", field=f"cameras.{name}", expected=expected)
    size = config.seen_size(poses.camera)
    return None if places == {"sensor"} or tuple(size) == poses.camera.size else size


def _true(config: Config, name: str, made: MadeCamera) -> TargetCamera:
    rendered = config.data.rendered
    assert rendered is not None
    content = true_camera(_known()[made.domain], made.domain, (rendered.height, rendered.width))
    file = config.output / "cameras" / f"{name}.yaml"
    visaug.Camera.load(content).save(file)
    return TargetCamera(name, made.domain, file)


def _known() -> dict[str, IndependentCamera]:
    """The cameras of rendered domains that a camera file can state in full."""
    return {name: d.camera for name, d in DOMAINS.items() if d.camera is not None and is_plain(d.camera)}


def is_plain(camera: IndependentCamera) -> bool:
    """Whether it has the base chain and row noise alone."""
    return replace(camera, row_noise_e=0.0) == camera.without_effects()


def true_camera(camera: IndependentCamera, name: str, resolution: tuple[int, int]) -> dict[str, Any]:
    """The content of the camera.yaml of a plain camera, in steps of its 8-bit pictures, as an estimate from these has it.

    Tails of Student's t with 4 degrees of freedom are near those of a Tukey-lambda law of shape -0.1; 0.14 is a normal law.
    """
    to_8bit = 255 / camera.white_dn
    row_noise = [{"name": "row_noise", "sigma_e": camera.row_noise_e}] if camera.row_noise_e else []
    return {
        "name": f"true camera of {name}",
        "resolution": list(resolution),
        "bit_depth": 8,
        "quantum_efficiency": camera.quantum_efficiency,
        "gain_e_per_dn": camera.e_per_dn / to_8bit,
        "black_level_dn": camera.black_level_dn * to_8bit if camera.keeps_black else 0.0,
        "read_noise": {"sigma_e": camera.read_noise_e, "shape": -0.1 if camera.heavy_tails else 0.14},
        "prnu": {"pixel": camera.pixel_gain},
        "dsnu": {"column_e": camera.column_offset_e, "pixel_e": camera.pixel_offset_e},
        "effects": row_noise,
    }


@dataclass(frozen=True)
class ArmGain:
    """What an arm and the oracle gain over the baseline in keypoint AP50-95 (COCO's), on one domain or the mean of several.

    `gain` and `oracle` are (mean, low, high). `share` is their ratio; its ends are None where it is not determined.
    """

    arm: str
    domains: tuple[str, ...]
    baseline: float
    gain: tuple[float, float, float]
    oracle: tuple[float, float, float]
    share: float
    low: float | None
    high: float | None

    def __str__(self) -> str:
        if self.low is None or self.high is None:
            return "not determined: the oracle's gain is not clear of 0"
        return f"{100 * self.share:.0f} % [{100 * self.low:.0f}, {100 * self.high:.0f}]"


def gains(ablation: "Ablation") -> list[ArmGain]:
    """Of every arm but baseline and oracle: on each domain of the cameras that were made, and on their mean."""
    config, trained = ablation.config, ablation.means
    if config.oracle not in trained or config.baseline not in trained:
        return []
    domains = target_sets(ablation)
    groups = [(each,) for each in domains] + ([tuple(domains)] if len(domains) > 1 else [])
    arms = [arm for arm in trained if arm not in (config.baseline, config.oracle)]
    found = [_gain(ablation, arm, group, config.baseline, config.oracle) for arm in arms for group in groups]
    return [each for each in found if each is not None]


def target_sets(ablation: "Ablation") -> list[str]:
    """The test sets of the domains whose cameras were made; all of them where none was."""
    made, sources = {camera.domain for camera in ablation.study.cameras}, ablation.config.data.test
    return [n for n in ablation.study.tests if not made or (n in sources and sources[n].domain in made)]


def _gain(
    ablation: "Ablation", arm: str, domains: tuple[str, ...], baseline: str, oracle: str
) -> ArmGain | None:
    seeds = [s for s in ablation.seeds(arm) if s in ablation.seeds(oracle) and s in ablation.seeds(baseline)]
    if not seeds:
        return None
    column = list(tables.MEASURES).index(MEASURE)

    def mean_over_domains(name: str) -> tuple[np.ndarray, np.ndarray]:
        """Scores of each seed, (seeds); on resampled images their mean over seeds, (resamples)."""
        pairs = [ablation.scores((name, domain), seeds) for domain in domains]
        scores = np.mean([s[:, column] for s, _ in pairs], axis=0)
        return scores, np.mean([r[:, :, column] for _, r in pairs], axis=0).mean(axis=1)

    at_baseline, resampled = mean_over_domains(baseline)
    found = [mean_over_domains(name) for name in (arm, oracle)]
    won, by_images = (np.stack(each, axis=1) for each in zip(*found))
    won, by_images = won - at_baseline[:, None], by_images - resampled[:, None]
    images = min(len(ablation.study.tests[domain]) for domain in domains)
    ends = paired_interval(won, image_variance(by_images), images)
    own, known = np.array([won.mean(axis=0), *ends]).T.tolist()
    share = share_interval(won[:, 0], won[:, 1], by_images, images) or (None, None)
    ratio = own[0] / known[0] if known[0] else float("nan")
    return ArmGain(arm, domains, float(at_baseline.mean()), tuple(own), tuple(known), ratio, *share)


def gain_table(found: list[ArmGain], baseline: str, oracle: str) -> tables.ResultTable:
    won, share = f"change by {oracle}", f"share of what {oracle} gains"
    head = ["arm", "test set", baseline, "change by the arm", won, share]
    rows = []
    for g in found:
        changes = [tables.signed(*each) for each in (g.gain, g.oracle)]
        rows.append([g.arm, " and ".join(g.domains), f"{g.baseline:.3f}", *changes, str(g)])
    title = "Keypoint AP50-95 (COCO's): what knowing the camera gains, and the share of it"
    return tables.ResultTable(title, head, rows)


def target_sections(ablation: "Ablation") -> list[Section]:
    """The gain, and the parameters estimated from the pictures; nothing without an oracle or cameras that were made."""
    sections = []
    if ablation.gains:
        sections.append(Section("Gain by cameras estimated from pictures", list(_gains(ablation))))
    if ablation.study.cameras:
        sections.append(Section("Cameras estimated from pictures", list(_cameras(ablation))))
    return sections


def _gains(ablation: "Ablation") -> Iterator[Text | Table | Figure]:
    oracle, baseline = str(ablation.config.oracle), ablation.config.baseline
    most = max(len(gain.domains) for gain in ablation.gains)
    for gain in ablation.gains:
        change, low, high = gain.gain
        points = f"{gain.baseline:.3f} to {gain.baseline + change:.3f} ({tables.signed(change, low, high)})"
        finding = (
            f"Arm {gain.arm} {VERDICTS[sign(low, high)]} the keypoint AP on {' and '.join(gain.domains)}: {points}. Arm "
            f"{oracle} changes it by {tables.signed(*gain.oracle)}; share of that gain: {gain}."
        )
        if len(gain.domains) == most:
            yield Text(finding, "finding")
    arms, domains = ablation.means, target_sets(ablation)
    scores = {d: {arm: ablation.of_seeds(arm, d, MEASURE) for arm in arms} for d in domains}
    yield figure(plot_scores(scores), "Keypoint AP50-95 (COCO's). Bars: mean over seeds. Dots: seeds.")
    table = gain_table(ablation.gains, baseline, oracle)
    yield Table(table.head, table.rows, f"{table.title}, with 95 % intervals.")
    yield Text(f"95 % intervals: {ablation.interval_covers}. Shares: Fieller's interval of a ratio.", "note")


def _cameras(ablation: "Ablation") -> Iterator[Text | Table | Figure]:
    cameras = ablation.study.cameras
    estimates = [(camera, camera.answer) for camera in cameras if camera.answer is not None]
    true = {c.domain: visaug.Camera.load(c.file).values() for c in cameras if c.answer is None}
    if estimates:
        yield Text(
            "Each camera was estimated from pictures of its domain alone; their labels were not used. Noise is given in steps"
            " of the 8-bit pictures (DN), which is what a network sees; electrons are that times the gain."
        )
        rows = [row for camera, _ in estimates for row in _rows(camera, true.get(camera.domain))]
        head = ["camera", "pictures", "parameter", "true", "estimated"]
        yield Table(head, rows, "Estimated with 95 % intervals.")
    for camera, answer in estimates:
        for line in answer.get("warnings", []):
            yield Text(f"{camera.name}: {line}.", "note")
    yield _pictures(ablation)


def _rows(camera: TargetCamera, true: dict[str, float] | None) -> Iterator[list[str]]:
    found = (camera.answer or {})["parameters"]
    stated = {
        "gain_e_per_dn": "gain, e-/DN",
        "black_level_dn": "black level, DN",
        "read_noise.sigma_e": "read noise, DN",
        "row_noise.sigma_e": "row noise, DN",
        "dsnu.column_e": "column pattern, DN",
        "dsnu.pixel_e": "pixel pattern, DN",
    }
    for key, label in stated.items():
        in_dn = key.endswith("_e")
        gain = found["gain_e_per_dn"]["value"] if in_dn else 1.0
        estimate, known = "not determined", ""
        if key in found:
            value, low, high = (found[key][end] / gain for end in ("value", "low", "high"))
            estimate = f"{value:.3g} [{low:.3g}, {high:.3g}]"
        if true is not None:
            known = f"{true.get(key, 0.0) / (true['gain_e_per_dn'] if in_dn else 1.0):.3g}"
        yield [camera.name, str(camera.pictures), label, known, estimate]


def _pictures(ablation: "Ablation") -> Figure:
    """For each camera: two of the test pictures, and a clean training image as its noise makes it."""
    study = ablation.study
    shown = [("clean training image", read_pixels(file) / 255) for file in study.training_images.files[:2]]
    clean = torch.from_numpy(np.stack([image for _, image in shown])[:, None]).float()
    for domain in target_sets(ablation):
        taken = study.tests[domain].files[:2]
        shown += [(f"{domain}: test picture", read_pixels(file) / 255) for file in taken]
    parts = [study.config.arm(name).vis for name in study.config.arms]
    for camera in study.cameras:
        for vis in [part for part in parts if part is not None and str(camera.file) in part.cameras][:1]:
            with torch.random.fork_rng(devices=[]), torch.no_grad():
                torch.manual_seed(0)
                noisy = vis_noise(vis.model_copy(update={"camera": str(camera.file), "p": 1.0}))(clean)
            shown += [(f"clean, {camera.name}", image) for image in noisy[:, 0].numpy()]
    titles, pictures = zip(*shown)
    return figure(
        plot_images(pictures, titles),
        "Pictures of the test sets, and clean training images with the noise of each camera.",
        raster=True,
    )
