"""Hidden effects on light, before a photon is detected. Each takes and returns expected photons per pixel."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, uniform_filter, zoom
from scipy.signal import fftconvolve
from scipy.special import erf

from .camera import Moment


def _spread(image: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Convolve; beyond the edge the scene goes on as its last pixel."""
    reach = kernel.shape[0] // 2
    return np.maximum(fftconvolve(np.pad(image, reach, mode="edge"), kernel, mode="valid"), 0)


def _radius(reach: int) -> np.ndarray:
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return np.hypot(y, x)


def vignetting(light: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Light lost at half a diagonal from the axis, a fraction. cos^4 of the field angle; other form: off-centre, r^4."""
    rng = at.die()
    rows, columns = light.shape
    wander = 0.2 if at.form == "off-centre quartic" else 0.02
    centre = (0.5 + wander * rng.uniform(-1, 1), 0.5 + wander * rng.uniform(-1, 1))
    y, x = np.mgrid[0:rows, 0:columns] + 0.5  # from the edge of the frame
    r2 = ((y - centre[0] * rows) ** 2 + (x - centre[1] * columns) ** 2) / (
        (rows / 2) ** 2 + (columns / 2) ** 2
    )
    if at.form == "off-centre quartic":
        return light * np.clip(1 - strength * r2**2, 0, 1)
    tangent2 = (1 - min(strength, 0.95)) ** -0.5 - 1  # so that cos^4 = 1 - strength at r = 1
    return light * (1 + tangent2 * r2) ** -2


def point_spread(light: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Gaussian blur of standard deviation `strength` pixels, integrated over pixels.

    Other form: exponential.
    """
    if strength == 0 or at.shot.kind != "scene":
        return light
    if at.form == "exponential":
        fine, reach = 9, 12
        edge = np.arange(-(reach * fine + fine // 2), reach * fine + fine // 2 + 1) / fine
        # exp(-r / l) in the plane has variance 3 l^2 along each axis
        profile = np.exp(-np.hypot(edge[:, None], edge[None, :]) * np.sqrt(3) / strength)
        kernel = profile.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).sum((1, 3))
        kernel = kernel / kernel.sum()
    else:
        edge = (np.arange(-9, 9) + 0.5) / (strength * np.sqrt(2))
        line = np.diff(erf(edge)) / 2
        kernel = np.outer(line, line)
        kernel /= kernel.sum()
    return _spread(light, kernel)


def veiling_glare(light: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share of the light goes into a wide Gaussian halo; other form: an exponential halo."""
    if strength == 0 or at.shot.kind != "scene":
        return light
    width = at.die().uniform(15, 35)
    if at.form == "exponential halo":
        reach = int(min(4 * width, min(light.shape) - 1))
        kernel = np.exp(-_radius(reach) / (width / 2))
        halo = _spread(light, kernel / kernel.sum())
    else:
        halo = gaussian_filter(light, width, mode="nearest", truncate=3.5)
    return (1 - strength) * light + strength * halo


def lens_flare(light: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Light returned by lens surfaces: a defocused ghost opposite the source and a halo around it.

    Other form: the ghost is shrunk towards the axis and the halo is a ring.
    """
    if strength == 0 or at.shot.kind != "scene":
        return light
    radius = at.die().uniform(4, 9)
    reach = int(3 * radius)
    r = _radius(reach)
    if at.form == "ring and small ghost":
        small = np.asarray(zoom(light[::-1, ::-1], 0.5, order=1))
        ghost = np.zeros_like(light)
        top, left = (light.shape[0] - small.shape[0]) // 2, (light.shape[1] - small.shape[1]) // 2
        ghost[top : top + small.shape[0], left : left + small.shape[1]] = 4 * small
        halo = np.exp(-0.5 * ((r - 2 * radius) / (0.2 * radius)) ** 2)
    else:
        ghost = light[::-1, ::-1]
        halo = np.exp(-r / radius)
    ghost = uniform_filter(ghost, int(2 * radius // 2 * 2 + 1), mode="constant")
    return light + strength * (0.5 * ghost + 0.5 * _spread(light, halo / halo.sum()))


def light_drift(light: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """The lamp's level, a relative standard deviation, fresh in every frame.

    Other form: a slow random walk.
    """
    if at.form == "slow walk":
        steps = at.die("walk").standard_normal(at.index + 1)
        level = 1 + strength * 0.35 * steps.sum()
    else:
        level = 1 + strength * at.now().standard_normal()
    return light * max(level, 0.0)
