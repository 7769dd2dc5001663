"""Cameras with an effect that their file does not contain: their images are a test set, their diagnosis is an arm.

For each effect the noiseless views of a test set are taken by the camera with the effect, and a frame set of
the same specimen is diagnosed, starting from the camera's file, which lacks it. The diagnosed camera is the
noise of a further arm, so the study shows the loss by the effect and the gain by its diagnosis. All
of it lies in files and is made once.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import visaug
from visaug.camera.simulation import simulate, with_chart
from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import write_bytes, write_json
from visaug.core.progress import Progress
from visaug.frames import FrameRecord, FrameSet
from visaug.frames.plan import default_plan
from visaug_train.config import Arm, Config
from visaug_train.convert import identity
from visaug_train.reduction import read_pixels
from visaug_train.render.dataset import LINEAR_WHITE_DN
from visaug_train.speed import PoseSet

PLAIN = "plain"  # the test set of the camera that hides nothing
TOGETHER = 16  # images in memory at once
SPECIMEN = 1  # the seed of the one camera that takes frames and test images: its fixed patterns are the same


@dataclass(frozen=True)
class HiddenEffect:
    """One effect that a test camera has and its file leaves out.

    Attributes:
        domain: name of its test set.
        effect: name and parameters, as in camera.yaml.
        answer: the diagnosis as `visaug diagnose --json` has it.
        found: name and parameters of the effects that the diagnosed camera has.
        named: the arm that trains with the diagnosed camera; None where nothing was named.
        known: the arm that knew the effect: the same one where the name was right.
        wrong: the arm of another of the effects, the control; None where there is no other.
    """

    domain: str
    effect: dict[str, Any]
    answer: dict[str, Any]
    found: list[dict[str, Any]]
    named: str | None
    known: str
    wrong: str | None

    @property
    def right(self) -> bool:
        """Whether the diagnosis named this effect and no other."""
        return self.answer["accepted"] == [self.effect["name"]]


def hidden_cameras(config: Config) -> dict[str, visaug.Camera]:
    """The test cameras by test set: the plain one, then one for each hidden effect; none where a config hides nothing.

    Raises:
        InputError: an effect that the camera cannot have.
    """
    if config.hidden is None:
        return {}
    vis = config.arm(config.baseline).vis
    if vis is None:
        raise InputError("has no `vis`", field=f"arms.{config.baseline}", expected="the noise of a camera")
    if len(vis.cameras) != 1:
        raise InputError("is a list", field=f"arms.{config.baseline}.vis.camera", expected="one camera")
    plain = visaug.Camera.load(vis.cameras[0])
    cameras = {PLAIN: plain}
    for domain, effect in config.hidden.effects.items():
        if domain in (PLAIN, *config.data.test) or domain in config.arms:
            raise InputError("is taken", field=f"hidden.effects.{domain}", expected="another name")
        cameras[domain] = plain.with_effect(**effect)
    return cameras


def hide_effects(
    config: Config, tests: Mapping[str, PoseSet], progress: Progress | None = None
) -> tuple[Config, dict[str, PoseSet], list[HiddenEffect]]:
    """The config with the arms, and the test sets, that a study of hidden effects adds; and what was diagnosed."""
    assert config.hidden is not None
    cameras = hidden_cameras(config)
    if config.hidden.views not in tests:
        raise InputError("is not a test set", field="hidden.views", expected=f"one of {', '.join(tests)}")
    views = tests[config.hidden.views]
    size = (views.camera.height, views.camera.width)
    if cameras[PLAIN].resolution != size:
        raise InputError(
            f"resolution is {list(cameras[PLAIN].resolution)}",
            file=config.arm(config.baseline).camera_files[0],
            expected=f"{list(size)}, rows and columns of the views",
        )
    taken, arms, found = {}, dict(config.arms), []
    for domain, camera in cameras.items():
        light = config.hidden.light
        decides = f"{camera.to_yaml()} {light} {identity(views)}"
        digest = hashlib.sha256(decides.encode()).hexdigest()[:8]
        folder = config.output / "cameras" / f"{domain}-{digest}"
        taken[domain] = take_views(camera, views, folder, domain, light, progress)
        if domain == PLAIN:
            continue
        effect = config.hidden.effects[domain]
        answer = diagnose_frames(cameras[PLAIN], camera, folder, domain, progress)
        diagnosed = visaug.Camera.load(folder / "diagnosed.yaml").to_dict().get("effects", [])
        named = f"{domain}_named" if answer["accepted"] else None
        if named:
            why = f"the baseline's noise by the diagnosed camera: with {', '.join(answer['accepted'])}"
            arms[named] = _arm(config, folder / "diagnosed.yaml", why)
        right = answer["accepted"] == [effect["name"]]
        known = named if right and named else f"{domain}_known"
        if known != named:
            arms[known] = _arm(config, folder / "camera.yaml", f"the baseline's noise with {domain} as it is")
        found.append(HiddenEffect(domain, effect, answer, diagnosed, named, known, None))
    found = [replace(each, wrong=_control(each, found[i + 1 :] + found[:i])) for i, each in enumerate(found)]
    return config.model_copy(update={"arms": arms}), {**tests, **taken}, found


def _arm(config: Config, camera: Path, why: str) -> Arm:
    """The baseline with another camera."""
    vis = config.arm(config.baseline).vis
    assert vis is not None
    return Arm(like=config.baseline, why=why, vis=vis.model_copy(update={"camera": str(camera)}))


def _control(each: HiddenEffect, others: list[HiddenEffect]) -> str | None:
    """The arm of the first other effect that does not contain this one too."""
    for other in others:
        unknowing = other.named and each.effect["name"] not in other.answer["accepted"]
        return other.named if unknowing else other.known
    return None


def take_views(
    camera: visaug.Camera,
    views: PoseSet,
    folder: Path,
    domain: str,
    light: float = 1.0,
    progress: Progress | None = None,
) -> PoseSet:
    """The views as the camera sees them, 8 bit, black level off, in SPEED+'s layout; kept where they are there.

    `light` 1: white of a view is what fills the camera's converter, as in training. Sequence numbers, and so the noise,
    are the same for all cameras: they differ by their effects alone.
    """
    images = folder / domain / "images"
    listing = folder / domain / "test.json"
    files = tuple(images / file.name for file in views.files)
    # sequence numbers of test images, so that their noise is not that of the frame set
    first_view = 1_000_000
    if not listing.is_file():
        full_dn = 2**camera.bit_depth - 1
        white_photons = light * full_dn * camera.spec.gain_e_per_dn / camera.spec.quantum_efficiency
        for first in range(0, len(views), TOGETHER):
            chosen = views.files[first : first + TOGETHER]
            cleans = {file.name: noiseless(file) * np.float32(white_photons) for file in chosen}
            records = [
                FrameRecord(
                    first_view + first + i,
                    file.name,
                    "scene",
                    camera.spec.exposure_s,
                    camera.spec.temperature_c,
                    camera.spec.gain_db,
                    clean=file.name,
                )
                for i, file in enumerate(chosen)
            ]
            unread = np.broadcast_to(np.uint16(0), (len(records), *camera.resolution))
            plan = FrameSet.from_arrays(records, unread, cleans, bit_depth=camera.bit_depth)
            frames = simulate(camera, plan, seed=SPECIMEN)
            for i, file in enumerate(chosen):
                dn = frames.read(i).astype(float) - camera.spec.black_level_dn
                picture = np.clip(np.rint(dn / full_dn * 255), 0, 255).astype(np.uint8)
                write_bytes(images / file.name, cv2.imencode(".png", picture)[1].tobytes())
            if progress:
                progress(f"taking views: {domain}", min(first + TOGETHER, len(views)), len(views))
        camera.save(folder / "camera.yaml")
        write_json(folder / "camera.json", views.camera.to_json())
        poses = zip(files, views.quaternions.tolist(), views.translations.tolist())
        write_json(
            listing, [{"filename": f.name, "q_vbs2tango_true": q, "r_Vo2To_vbs_true": r} for f, q, r in poses]
        )
    return replace(views, name=domain, files=files)


def noiseless(file: Path) -> np.ndarray:
    """A view as it came from the renderer, (rows, columns), 1 is white; beyond white where that was kept."""
    linear = file.parent.with_name("images_linear") / file.name
    if not linear.is_file():
        return read_pixels(file).astype(np.float32) / 255
    return read_pixels(linear, cv2.IMREAD_UNCHANGED).astype(np.float32) / LINEAR_WHITE_DN


def diagnose_frames(
    plain: visaug.Camera, camera: visaug.Camera, folder: Path, domain: str, progress: Progress | None = None
) -> dict[str, Any]:
    """Diagnose frames of `camera`, starting from `plain`; the answer, kept in diagnosis.json."""
    answer = folder / "diagnosis.json"
    if not answer.is_file():
        frames = simulate(camera, plan_of(plain), seed=SPECIMEN)
        diagnosis = visaug.diagnose(plain, frames, progress=_titled(progress, f"{domain}: "))
        content = diagnosis.camera.to_dict() | {"randomize": plain.to_dict().get("randomize", {})}
        visaug.Camera.load(content).save(folder / "diagnosed.yaml")
        write_json(answer, diagnosis.to_json())  # last: where it stands, the camera does
    return read_json(answer)


def plan_of(camera: visaug.Camera) -> FrameSet:
    """The frames to take of a camera, as `visaug plan` names them, at two temperatures and one gain."""
    spec = camera.spec
    records = default_plan(
        saturation_photons=spec.saturation_photons,
        exposure_s=spec.exposure_s,
        temperatures_c=(spec.temperature_c, spec.temperature_c + 10),
        gains_db=(spec.gain_db,),
    )
    unread = np.broadcast_to(np.uint16(0), (len(records), *camera.resolution))
    return with_chart(camera, FrameSet.from_arrays(records, unread, bit_depth=camera.bit_depth))


def _titled(progress: Progress | None, title: str) -> Progress | None:
    return (lambda what, done, total: progress(title + what, done, total)) if progress else None
