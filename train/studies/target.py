"""Cameras that are made before a training: estimated from unlabelled pictures of a domain, or the true one of a rendered
domain. Arms name them like camera files, so a study shows what the pictures alone give, and what knowing the camera gives.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import visaug
from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import write_json
from visaug.core.progress import Progress
from visaug_train.config import Config, MadeCamera, Source
from visaug_train.reduction import reduced_camera
from visaug_train.render.dataset import DOMAINS
from visaug_train.render.independent_camera import IndependentCamera
from visaug_train.speed import PoseSet

if TYPE_CHECKING:
    from visaug_train.training import Study


@dataclass(frozen=True)
class TargetCamera:
    """A camera that was made for arms.

    Attributes:
        name: by which arms name it.
        domain: whose pictures it took.
        file: its camera.yaml.
        pictures: of how many it was estimated; 0 for a true camera.
        files: these pictures.
        answer: the estimate as `visaug characterize --json` has it; None for a true camera.
    """

    name: str
    domain: str
    file: Path
    pictures: int = 0
    answer: dict[str, Any] | None = None
    files: tuple[Path, ...] = ()


def transductive(study: "Study") -> dict[str, str]:
    """The arms whose cameras were estimated from test images, each with a sentence on it."""
    found = {}
    for name in study.config.arms:
        used = study.config.arm(name).camera_files
        for camera in getattr(study, "cameras", ()):
            for domain, poses in study.tests.items():
                shared = {f.resolve() for f in camera.files} & {f.resolve() for f in poses.files}
                if str(camera.file) in used and shared:
                    found[name] = (
                        f"its camera was estimated from {len(shared)} of the {len(poses)} test images of {domain}, without "
                        "labels (transductive)"
                    )
    return found


def check_cameras(config: Config) -> None:
    """Refuse, before anything is rendered, true cameras that are not known."""
    for name, made in config.cameras.items():
        if made.rendered is not None and (config.data.rendered is None or made.rendered not in _known()):
            raise InputError(
                f"the camera of {made.rendered} is not known",
                field=f"cameras.{name}.rendered",
                expected=f"data.rendered and one of {', '.join(_known())}",
            )


def make_cameras(
    config: Config, read: Callable[[Source], PoseSet], progress: Progress | None = None
) -> tuple[Config, tuple[TargetCamera, ...]]:
    """The config with files in place of the names of its `cameras`, and the cameras; files that exist are kept.

    Args:
        config: of the study.
        read: gives the pictures of a source.
        progress: called with (description, done, total).

    Raises:
        InputError: pictures that give no camera.
    """
    made = []
    for done, (name, each) in enumerate(config.cameras.items()):
        if progress:
            progress("cameras of the target", done, len(config.cameras))
        made.append(
            _estimated(config, name, read(each.pictures)) if each.pictures else _true(config, name, each)
        )
    if progress and made:
        progress("cameras of the target", len(made), len(made))
    files = {camera.name: str(camera.file) for camera in made}
    arms = dict(config.arms)
    for name, arm in arms.items():
        changed = {}
        for key in ("vis", "white"):
            part = getattr(arm, key)
            if part is not None:
                cameras = [files.get(camera, camera) for camera in part.cameras]
                changed[key] = part.model_copy(
                    update={"camera": cameras[0] if isinstance(part.camera, str) else cameras}
                )
        arms[name] = arm.model_copy(update=changed)
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
            raise InputError(
                f"the {len(files)} pictures of {poses.domain} give no camera: {result.warnings[0]}",
                field=f"cameras.{name}",
                expected=result.not_determined["gain_e_per_dn"],
            )
        content = result.to_camera_dict()
        if size is not None:
            content = reduced_camera(content, (poses.camera.width, poses.camera.height), size, how)
        visaug.Camera.load(content).save(camera)
        write_json(answer, result.to_json())  # last: where it stands, the camera does
    return TargetCamera(name, poses.domain, camera, len(files), read_json(answer), tuple(files))


def _seen_size(config: Config, name: str, poses: PoseSet) -> tuple[int, int] | None:
    """Width and height of the images that arms give this camera's noise: as the network gets them.

    None where these are the pictures', or the noise comes on the sensor's pixels. The camera is estimated from whole pictures:
    small ones hold hardly any region that is flat.

    Raises:
        InputError: some arms do the one, some the other.
    """
    arms = [
        part for arm in config.arms.values() for part in (arm.vis, arm.white) if part and name in part.cameras
    ]
    places = {getattr(part, "resolution", "network") for part in arms}
    if len(places) > 1:
        raise InputError(
            "arms use it at both resolutions",
            field=f"cameras.{name}",
            expected="vis.resolution network or sensor in all of its arms, or another camera of the same pictures",
        )
    whole = (poses.camera.width, poses.camera.height)
    size = config.seen_size(poses.camera)
    return None if places == {"sensor"} or tuple(size) == whole else (size[0], size[1])


def _true(config: Config, name: str, made: MadeCamera) -> TargetCamera:
    rendered = config.data.rendered
    assert rendered is not None
    content = true_camera(_known()[made.domain], made.domain, (rendered.height, rendered.width))
    file = config.output / "cameras" / f"{name}.yaml"
    visaug.Camera.load(content).save(file)
    return TargetCamera(name, made.domain, file)


def _known() -> dict[str, IndependentCamera]:
    """The cameras of rendered domains that a camera file can state in full."""
    return {
        name: domain.camera
        for name, domain in DOMAINS.items()
        if domain.camera is not None and is_plain(domain.camera)
    }


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
