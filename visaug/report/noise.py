"""What a camera does to an image, and what each part of it does alone."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from visaug.camera import Camera

# Base terms beyond shot noise, and what in camera.yaml turns each off.
PARTS = {
    "PRNU": {"prnu.column": 0.0, "prnu.row": 0.0, "prnu.pixel": 0.0},
    "DSNU": {"dsnu.column_e": 0.0, "dsnu.row_e": 0.0, "dsnu.pixel_e": 0.0},
    "dark current": {"dark_current.a_e_per_s": 0.0},
    "read noise": {"read_noise.sigma_e": 0.0, "read_noise.after_gain_dn": 0.0},
}


def components(camera: "Camera", image: np.ndarray) -> dict[str, np.ndarray]:
    """Each noise component alone, in DN of the camera's converter.

    A component is the difference between two exposures with the same random numbers, with it and without it.

    Args:
        camera: the camera at its nominal values.
        image: (H, W) in [0, 1], linear in light; 1 is where the camera saturates. It is the whole image of the camera, whatever
            its size.

    Returns:
        Name -> (H, W) float32, in the order of the chain; shot noise first.
    """
    import torch

    from visaug.core.sampling import Stream, derive_key

    spec = camera.spec
    rows, columns = image.shape
    photons = torch.from_numpy(image.astype(np.float32))[None, None] * spec.saturation_photons
    off = {path: value for values in PARTS.values() for path, value in values.items()}
    nominal = camera.values()

    def expose(taken: "Camera", values: dict[str, float]) -> np.ndarray:
        window = range(rows), range(columns)
        stream = Stream([derive_key(0, "frame")], [derive_key(0, "camera")], 1, window)
        return taken.expose(photons, stream, values, resolution=(rows, columns))[0, 0].numpy()

    plain = camera
    for name in camera.effect_names:
        plain = plain.without_effect(name)
    quiet = expose(plain, off)
    ideal = photons[0, 0].numpy() * (spec.quantum_efficiency / spec.gain_e_per_dn) + spec.black_level_dn
    found = {"shot noise": quiet - ideal}
    for name, values in PARTS.items():
        if any(nominal[path] for path in values):
            found[name] = expose(plain, {**off, **{path: nominal[path] for path in values}}) - quiet
    for entry in spec.effects:
        found[entry["name"].replace("_", " ")] = expose(plain.with_effect(**entry), off) - quiet
    return found
