"""Ten cameras, two of real size and a small one with frame plans and targets, fixed by seeds and rounded as data sheets do."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.ndimage import gaussian_filter

from . import small
from .camera import Sensor, Shot
from .randomness import stream

# bit depth, rows, columns: from a small 12-bit sensor to a 16-bit one of 200 x 256
_FORMATS = (
    (16, 128, 160), (12, 128, 160), (14, 96, 128), (16, 160, 200), (12, 128, 192),
    (14, 144, 176), (12, 200, 256), (16, 112, 144), (14, 160, 160), (12, 176, 224),
)  # fmt: skip
COUNT = len(_FORMATS)  # of those that a seed may draw
# Sets of real size by the camera's number: bit depth, rows, columns, frames
LARGE = {COUNT: (12, 200, 256, 150), COUNT + 1: (14, 1000, 1000, 60)}
SMALL = COUNT + 2  # 47 frames of 64 x 80 pixels, `small`


def camera_of(seed: int) -> int:
    """Which of the ten a seed gets."""
    return int(stream(seed, "which camera").integers(COUNT))


@lru_cache
def sensor(number: int) -> Sensor:
    if number == SMALL:
        return small.SENSOR
    bits, rows, columns = LARGE[number][:3] if number in LARGE else _FORMATS[number]
    rng = stream(1288, "sensor", number)
    well_e = round(rng.uniform(7000, 11000) if bits == 12 else rng.uniform(9000, 20000), -2)
    headroom = rng.uniform(0.86, 0.94)  # the well fills before the converter does

    def about(low: float, high: float, digits: int) -> float:
        return round(float(rng.uniform(low, high)), digits)

    return Sensor(
        name=f"camera {number}",
        rows=rows,
        columns=columns,
        bits=bits,
        efficiency=about(0.35, 0.75, 3),
        e_per_dn=round(well_e / (headroom * 2**bits), 4),
        pedestal_dn=round(2**bits * rng.uniform(0.004, 0.008)) + 40,
        well_e=well_e,
        integration_s=about(0.005, 0.02, 3),
        celsius=about(15, 25, 0),
        read_e=about(2.5, 5, 2) if bits == 12 else about(1.8, 4, 2),
        tail=about(-0.2, 0.05, 3),
        dark_e_per_s=about(0.06, 0.25, 3),
        dark_per_c=about(0.09, 0.13, 3),
        prnu=(about(0.001, 0.002, 5), about(0.001, 0.002, 5), about(0.004, 0.008, 5)),
        dsnu_e=(about(0.5, 1.5, 3), about(0.2, 0.6, 3), about(0.8, 1.5, 3)),
    )


@lru_cache
def plan(number: int) -> tuple[Shot, ...]:
    """Bias, dark ladder, flats to near full well or beyond, scenes each followed by a dark frame: about 70 frames."""
    if number == SMALL:
        return (*small.PLAN, *small.CHART)
    if number in LARGE:
        return _large_plan(number, LARGE[number][3])
    camera, rng = sensor(number), stream(1288, "plan", number)
    shots = [Shot("bias", 1e-5, camera.celsius)] * int(rng.integers(14, 19))
    longest = float(rng.choice([1.5, 2.0, 3.0]))
    for celsius in (camera.celsius, camera.celsius + float(rng.choice([8, 10, 12]))):
        for seconds in (longest / 20, longest / 4, longest):
            shots += [Shot("dark", seconds, celsius)] * 3
    fractions = [0.003, 0.012, 0.05, 0.15, 0.35, 0.6, 0.8, 0.93]
    fractions += [1.05] if number % 2 else []  # some ladders go on beyond the full well
    for fraction in fractions[int(rng.integers(0, 2)) :]:
        photons = round(float(f"{fraction * camera.well_e / camera.efficiency:.3g}"))
        shots += [Shot("flat", camera.integration_s, camera.celsius, photons=photons)] * 3
    for target in ("chart", "scene", "spot"):
        for _ in range(2):
            shots.append(Shot("scene", camera.integration_s, camera.celsius, target=target))
            shots.append(Shot("dark", camera.integration_s, camera.celsius))
    return tuple(shots)


def _large_plan(number: int, frames: int) -> tuple[Shot, ...]:
    """A plan of so many frames: more of each condition in a longer set, bias frames fill it up. Scenes stand in the middle."""
    camera, each = sensor(number), frames // 18
    ladder = [
        Shot("dark", t, camera.celsius + warmer)
        for warmer in (0.0, 10.0)
        for t in (0.3, 3.0)
        for _ in range(each)
    ]
    scenes = []
    for target in ("chart", "scene", "spot"):
        for _ in range(2):
            scenes.append(Shot("scene", camera.integration_s, camera.celsius, target=target))
            scenes.append(Shot("dark", camera.integration_s, camera.celsius))
    full = camera.well_e / camera.efficiency
    flats = [
        Shot("flat", camera.integration_s, camera.celsius, photons=float(round(share * full)))
        for share in (0.01, 0.05, 0.2, 0.45, 0.7, 0.92)
        for _ in range(each)
    ]
    biases = [Shot("bias", 1e-5, camera.celsius)] * (frames - len(ladder) - len(scenes) - len(flats))
    return tuple(biases + ladder + scenes + flats)


@lru_cache
def targets(number: int) -> dict[str, np.ndarray]:
    """Noiseless photons per pixel.

    A chart of edges, a natural-looking scene, and spots far above full well.
    """
    if number == SMALL:
        return {"chart.npy": small.chart()}
    camera, rng = sensor(number), stream(1288, "targets", number)
    full = camera.well_e / camera.efficiency
    rows, columns = camera.shape
    y, x = np.mgrid[0:rows, 0:columns]
    low = round(0.003 * full)

    chart = np.full(camera.shape, float(low))
    height, width = rows // 5, columns // 6
    for top, left, level in (
        (0.08, 0.06, 0.8),
        (0.1, 0.4, 0.3),
        (0.4, 0.7, 0.8),
        (0.45, 0.1, 0.1),
        (0.7, 0.42, 0.6),
    ):
        r, c = int(top * rows), int(left * columns)
        chart[r : r + height, c : c + width] = level * full
    slanted = (x - 0.8 * columns) > 0.09 * (y - 0.2 * rows)
    chart[(y < 0.3 * rows) & slanted & (x < 0.95 * columns) & (y > 0.05 * rows)] = 0.5 * full
    bars = (y > 0.75 * rows) & (y < 0.93 * rows) & (x < 0.35 * columns) & (x > 0.05 * columns)
    chart[bars & (x % 6 < 3)] = 0.7 * full

    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None, :])
    frequency[0, 0] = np.inf
    texture = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(camera.shape)) * frequency**-1.3, s=camera.shape)
    texture = (texture - texture.min()) / np.ptp(texture)
    scene = full * (0.03 + 0.55 * texture)
    for _ in range(6):
        r, c, radius = rng.uniform(0, rows), rng.uniform(0, columns), rng.uniform(5, 16)
        scene[np.hypot(y - r, x - c) < radius] = full * rng.uniform(0.02, 0.8)
    scene = gaussian_filter(scene, 0.7)

    spot = np.full(camera.shape, float(low))
    for r, c, radius, level in ((0.34, 0.37, 4, 12.0), (0.7, 0.77, 2, 5.0)):
        spot[np.hypot(y - r * rows, x - c * columns) <= radius] = level * full
    return {"chart": chart, "scene": scene, "spot": spot}
