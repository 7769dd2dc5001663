"""Random draws of a rendering: attitude, position, sun, fill light and the Earth, each from its own stream."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import zoom
from scipy.spatial.transform import Rotation

from visaug_train.geometry import Pinhole
from visaug_train.render.caster import Views


@dataclass(frozen=True)
class Lighting:
    """Ranges (low, high) that an image's light is drawn from; levels are relative to the unit sun.

    The phase is the angle between sun and camera as seen from the target, in degrees.
    """

    sun_level: tuple[float, float] = (0.6, 1.2)
    phase_deg: tuple[float, float] = (10.0, 80.0)
    fill_level: tuple[float, float] = (0.08, 0.3)
    earth_share: float = 0.25


SYNTHETIC = Lighting()
# Light boxes on the walls of a dark room: no sun, even light from one half, far less of it.
LIGHTBOX = Lighting(sun_level=(0.0, 0.1), fill_level=(0.25, 0.7), earth_share=0.0)
# A lamp like the sun from the side, and nearly nothing else.
SUNLAMP = Lighting(sun_level=(2.0, 4.0), phase_deg=(25.0, 100.0), fill_level=(0.02, 0.08), earth_share=0.0)


def draw_views(
    camera: Pinhole,
    count: int,
    lighting: Lighting,
    distance_m: tuple[float, float],
    attitude_deg: float,
    rng: np.random.Generator,
) -> Views:
    """`count` views: distance uniform in its logarithm, centre anywhere inside, attitude at most `attitude_deg` off."""
    z = np.exp(rng.uniform(np.log(distance_m[0]), np.log(distance_m[1]), count))
    # The target's centre keeps 0.45 m from the border where there is room, so that few targets are cut.
    focal = camera.matrix[[0, 1], [0, 1]]
    room = np.array([camera.width, camera.height]) / 2
    reach = np.maximum(room - 0.45 * focal / z[:, None], 0.15 * room)
    pixels = camera.matrix[:2, 2] + rng.uniform(-1, 1, (count, 2)) * reach
    translations = camera.rays(pixels) * z[:, None]
    offsets = _turns(count, np.radians(attitude_deg), rng)
    # The camera looks at a corner of the body from below, so panel, body and antennas all show.
    nominal = Rotation.from_euler("xyz", [-130.0, 25.0, 20.0], degrees=True)
    x, y, z_, w = (offsets * nominal).as_quat().T
    phase, azimuth = np.radians(rng.uniform(*lighting.phase_deg, count)), rng.uniform(0, 2 * np.pi, count)
    # at the phase angle from the direction target -> camera, which is -z of the camera's frame
    sun = np.stack([np.sin(phase) * np.cos(azimuth), np.sin(phase) * np.sin(azimuth), -np.cos(phase)], axis=1)
    fill = rng.normal(size=(count, 3))
    return Views(
        np.stack([w, x, y, z_], axis=1),
        translations,
        sun,
        rng.uniform(*lighting.sun_level, count),
        fill / np.linalg.norm(fill, axis=1, keepdims=True),
        rng.uniform(*lighting.fill_level, count),
    )


def draw_earth(camera: Pinhole, share: float, rng: np.random.Generator) -> np.ndarray | None:
    """The Earth behind the target as radiance (height, width), in `share` of the images: limb, clouds and sea."""
    if rng.uniform() >= share:
        return None
    shape = (camera.height, camera.width)
    clouds = np.zeros(shape)
    for octave in range(2, 7):
        coarse = rng.normal(size=(2**octave, 2**octave))
        fine = zoom(coarse, [side / 2**octave for side in shape], order=3, grid_mode=True, mode="nearest")
        clouds = clouds + np.asarray(fine)[: shape[0], : shape[1]] * 0.5 ** (octave - 2)
    clouds = np.clip((clouds - clouds.mean()) / clouds.std() * 0.5 + 0.3, 0, 1)
    angle, offset = rng.uniform(0, 2 * np.pi), rng.uniform(-0.6, 0.8) * camera.width / 2
    y, x = np.mgrid[: shape[0], : shape[1]]
    x, y = x - shape[1] / 2, y - shape[0] / 2
    radius = 2.2 * camera.width
    along = np.hypot(x - (offset + radius) * np.cos(angle), y - (offset + radius) * np.sin(angle))
    limb = np.clip((radius - along) / (0.02 * camera.width), 0, 1)
    return rng.uniform(0.3, 0.8) * limb * (0.12 + 0.6 * clouds)


def _turns(count: int, largest: float, rng: np.random.Generator) -> Rotation:
    """Rotations by at most `largest` radians, evenly spread over these (uniform on SO(3), cut)."""
    angles = np.linspace(0, largest, 4001)
    share = angles - np.sin(angles)  # the uniform law's cumulated share of rotations by less than an angle
    angle = np.interp(rng.uniform(0, share[-1], count), share, angles)
    axis = rng.normal(size=(count, 3))
    return Rotation.from_rotvec(axis / np.linalg.norm(axis, axis=1, keepdims=True) * angle[:, None])
