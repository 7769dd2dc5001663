"""What the scenes show: expected photons per pixel, without lens or noise."""

from __future__ import annotations

import numpy as np

from .cameras import Camera
from .randomness import grid


def chart(camera: Camera, rng: np.random.Generator) -> np.ndarray:
    """A square, a slanted bar, a staircase of eight greys and bars of two widths, in full wells."""
    rows, columns = camera.shape
    y, x = grid(camera.shape)
    image = np.full(camera.shape, 0.08)
    image[rows // 10 : rows // 2, columns // 10 : columns // 2 - columns // 16] = 0.7

    slant = np.deg2rad(rng.uniform(4, 8))
    across = (x - columns * 0.74) * np.cos(slant) + (y - rows * 0.28) * np.sin(slant)
    image[(np.abs(across) < columns * 0.13) & (np.abs(y - rows * 0.28) < rows * 0.2)] = 0.45

    for step in range(8):
        left, right = int(columns * (0.08 + 0.105 * step)), int(columns * (0.08 + 0.105 * (step + 1)))
        image[int(rows * 0.58) : int(rows * 0.72), left:right] = 0.02 + 0.1 * step

    column = np.arange(columns)
    width = np.where(column < columns * 0.4, 3, 8)
    image[int(rows * 0.78) : int(rows * 0.93)] = np.where((column // width) % 2, 0.6, 0.05)
    return image


def scene(camera: Camera, rng: np.random.Generator) -> np.ndarray:
    """A cloud with amplitudes f^-1.9, as natural scenes about have, brighter towards the last row, in full wells."""
    rows, columns = camera.shape
    y, _ = grid(camera.shape)
    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None])
    frequency[0, 0] = 1
    waves = rng.normal(size=frequency.shape) + 1j * rng.normal(size=frequency.shape)
    cloud = np.fft.irfft2(waves * frequency**-1.9 * np.exp(-((frequency / 0.25) ** 2)), s=camera.shape)
    cloud = (cloud - cloud.min()) / np.ptp(cloud)
    return 0.04 + 0.7 * cloud**1.5 * (0.6 + 0.4 * y / rows)


def spot(camera: Camera, rng: np.random.Generator) -> np.ndarray:
    """A spot of three to seven full wells, and one of half a full well across from it."""
    rows, columns = camera.shape
    y, x = grid(camera.shape)
    down = 0.5 + rng.choice([-1, 1]) * rng.uniform(0.12, 0.26)
    along = 0.5 + rng.choice([-1, 1]) * rng.uniform(0.12, 0.26)
    image = np.full(camera.shape, 0.008)
    distance = np.hypot(y - rows * down, x - columns * along)
    image += rng.uniform(3, 7) / (1 + np.exp((distance - rng.uniform(3, 5)) / 0.5))
    distance = np.hypot(y - rows * down, x - columns * (1 - along))
    image += 0.5 / (1 + np.exp((distance - 3) / 0.5))
    return image


def targets(camera: Camera, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """All three, in photons."""
    full = camera.well_e / camera.efficiency
    made = {"chart": chart(camera, rng), "scene": scene(camera, rng), "spot": spot(camera, rng)}
    return {name: (image * full).astype(np.float32) for name, image in made.items()}
