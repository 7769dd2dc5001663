"""Laboratory frames of the camera of a rendered test domain, its data sheet, and the effects that the sheet omits.

The camera is `visaug_train.render.independent_camera`, which shares no code with the package. Its data sheet states the
base chain; banding, taps and the like are not in it. Frames of it are diagnosed from the data sheet on, and the camera
that is found becomes the noise of an arm.
"""

from pathlib import Path
from typing import Any

import numpy as np

import visaug
from visaug.core.documents import read_json
from visaug.core.files import write_json
from visaug.core.progress import Progress
from visaug.frames import FrameRecord, FrameSet
from visaug_train.render.independent_camera import IndependentCamera

RESOLUTION = (64, 96)  # of the frames; a diagnosis takes time by the pixel
EXPOSURE_S, TEMPERATURE_C = 0.01, 20.0
BIASES, FLATS = 12, 6
LEVELS = (0.1, 0.3, 0.5, 0.7)  # of full well
# Of the camera that is found, in training: one known camera, but its images reach the network reduced, which takes some
# of the white noise and shortens the period of a banding.
SPREADS: dict[str, Any] = {
    "gain_db": {"std": 1.0},
    "read_noise.sigma_e": 0.2,
    "dsnu.column_e": 0.2,
    "dsnu.pixel_e": 0.2,
    "periodic_banding.amplitude_e": 0.3,
    "periodic_banding.period_rows": 0.3,
}


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
        "exposure_s": EXPOSURE_S,
        "temperature_c": TEMPERATURE_C,
        "read_noise": {"sigma_e": camera.read_noise_e, "shape": -0.1},
        "prnu": {"pixel": camera.pixel_gain},
        "dsnu": {"column_e": camera.column_offset_e, "pixel_e": camera.pixel_offset_e},
    }


def take_frames(camera: IndependentCamera, resolution: tuple[int, int], seed: int = 0) -> FrameSet:
    """Bias frames and flats of known light, in mixed order."""
    rng = np.random.default_rng([20261, seed])
    white = camera.full_well_e / camera.quantum_efficiency
    photons = [0.0] * BIASES + [level * white for level in LEVELS for _ in range(FLATS)]
    order = rng.permutation(len(photons))
    records = [
        FrameRecord(
            sequence,
            f"frame{sequence:03d}",
            "flat" if photons[i] else "bias",
            EXPOSURE_S if photons[i] else 0.0,
            TEMPERATURE_C,
            0.0,
            photons=photons[i] or None,
        )
        for sequence, i in enumerate(order)
    ]
    frames = np.stack([camera.expose(np.full(resolution, photons[i]), rng) for i in order])
    return FrameSet.from_arrays(records, frames, bit_depth=12)


def diagnosed_camera(
    camera: IndependentCamera,
    name: str,
    folder: Path,
    seed: int = 0,
    progress: Progress | None = None,
) -> Path:
    """The file of the camera that a diagnosis of its frames finds, starting from its data sheet; kept once made."""
    answer, found = folder / f"diagnosis-{seed}.json", folder / f"camera-{seed}.yaml"
    if not answer.is_file():
        stated = visaug.Camera.load(data_sheet(camera, name, RESOLUTION))
        stated.save(folder / "data_sheet.yaml")
        frames = take_frames(camera, RESOLUTION, seed)
        diagnosis = visaug.diagnose(stated, frames, seed=seed, progress=progress)
        content = diagnosis.camera.to_dict()
        known = visaug.Camera.load(content).values()
        content["randomize"] = {path: spread for path, spread in SPREADS.items() if path in known}
        visaug.Camera.load(content).save(found)
        write_json(answer, diagnosis.to_json())  # last: where it stands, the camera does
    return found


def diagnosis_of(found: Path) -> dict[str, Any]:
    """The answer that belongs to a camera that `diagnosed_camera` found."""
    return read_json(found.with_name(found.name.replace("camera-", "diagnosis-")).with_suffix(".json"))
