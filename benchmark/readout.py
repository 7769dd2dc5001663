"""Hidden effects between the wells and the converter: electrons, as real numbers."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate

from .camera import Moment
from .randomness import coloured


def interpixel_crosstalk(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Capacitive coupling: `strength` to each of the four neighbours; other form: arms two pixels long."""
    arm = [0.0, 1.0] if at.form == "longer arms" else [1.0]
    weights = np.array([0.6, 0.4]) if at.form == "longer arms" else np.array(arm)
    size = 2 * weights.size + 1
    kernel = np.zeros((size, size))
    for distance, weight in enumerate(weights, start=1):
        for dy, dx in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            kernel[size // 2 + dy * distance, size // 2 + dx * distance] = strength * weight
    kernel[size // 2, size // 2] = 1 - kernel.sum()
    return correlate(x, kernel, mode="nearest")


def nonlinearity(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """The response sags by `strength` at full well, as q^2; other form: as q^3, with a foot at low signal."""
    u = x / at.sensor.well_e
    if at.form == "cubic with foot":
        return x - strength * at.sensor.well_e * (u**3 + 0.05 * (1 - np.exp(-np.maximum(u, 0) / 0.02)))
    return x * (1 - strength * u)


def dead_pixels(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share `strength` of the pixels rests at a level of its own; other form: all at the dark level."""
    rng = at.die()
    dead = at.once("dead", lambda: rng.random(x.shape) < strength)
    level = at.once("level", lambda: at.die("level").uniform(0, 0.3, x.shape) * at.sensor.well_e)
    return np.where(dead, 0.0 if at.form == "dark" else level, x)


def rts_noise(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share `strength` of the pixels jumps between two levels; a trap keeps its state for a few frames.

    Other form: three levels, each frame afresh.
    """
    rng = at.die()
    jumps = at.once("where", lambda: rng.random(x.shape) < strength)
    height = at.once("height", lambda: at.sensor.read_e * at.die("height").uniform(2, 7, x.shape))
    if at.form == "three levels":
        state = at.now().choice([0.0, 0.5, 1.0], x.shape, p=[0.5, 0.3, 0.2])
    else:
        upper = at.once("upper", lambda: at.die("upper").uniform(0.15, 0.6, x.shape))
        state = at.memory.get("state", at.die("start").random(x.shape) < upper)
        fresh = at.now("wake").random(x.shape) < 0.5
        state = np.where(fresh, at.now("state").random(x.shape) < upper, state)
        at.memory["state"] = state
    return x + jumps * height * state


def row_noise(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """An offset per row and frame, Gaussian; other form: Laplace."""
    return x + _line(strength, at, (x.shape[0], 1))


def column_noise(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """An offset per column and frame, Gaussian; other form: Laplace."""
    return x + _line(strength, at, (1, x.shape[1]))


def _line(sigma_e: float, at: Moment, shape: tuple[int, int]) -> np.ndarray:
    if at.form == "Laplace":
        return at.now().laplace(0, sigma_e / np.sqrt(2), shape)
    return sigma_e * at.now().standard_normal(shape)


def flicker_noise(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """1/f noise along the pixel stream, `strength` e- rms; other form: f^-1.4."""
    exponent = 1.4 if at.form == "steeper" else 1.0
    return x + strength * coloured(at.now(), x.size, exponent).reshape(x.shape)


def periodic_banding(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A sine of the row number, phase new in every frame; other form: with a third harmonic."""
    period = at.die().uniform(6, 24)
    phase = 2 * np.pi * (np.arange(x.shape[0])[:, None] / period + at.now().random())
    wave = np.sin(phase)
    if at.form == "third harmonic":
        wave = wave + np.sin(3 * phase) / 3
    return x + strength * wave


def tap_mismatch(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """The second half has `strength` e- more offset and a gain that differs by 0.1 % per e-.

    Other form: by rows.
    """
    rng = at.die()
    share, offset, gain = rng.uniform(0.4, 0.6), rng.choice([-1, 1]), rng.choice([-1, 1]) * 1e-3
    y, x_index = np.ogrid[: x.shape[0], : x.shape[1]]
    second = y >= share * x.shape[0] if at.form == "upper and lower" else x_index >= share * x.shape[1]
    return np.where(second, x * (1 + gain * strength) + offset * strength, x)


def row_parity(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Odd rows lie `strength` e- higher; other form: they also have 0.05 % per e- more gain."""
    odd = (np.arange(x.shape[0]) % 2)[:, None]
    gain = 5e-4 * strength if at.form == "gain too" else 0.0
    return x * (1 + gain * odd) + strength * odd


def black_level_drift(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """The whole frame's offset, Gaussian and fresh; other form: a slow walk."""
    if at.form == "slow walk":
        return x + strength * 0.35 * at.die("walk").standard_normal(at.index + 1).sum()
    return x + strength * at.now().standard_normal()


def fixed_pattern_structure(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Column bands of differing height; other form: a slope with a slanted sine.

    Dark, the same in every frame.
    """

    def pattern() -> np.ndarray:
        rng = at.die()
        y, x_index = np.indices(x.shape) / np.array(x.shape)[:, None, None]
        if at.form == "slope and sine":
            angle, period = rng.uniform(0.4, 1.2), rng.uniform(0.05, 0.15)
            wave = np.sin(2 * np.pi * (y * np.sin(angle) + x_index * np.cos(angle)) / period)
            shape = rng.choice([-1, 1]) * (x_index - 0.5) * 2 + 0.8 * wave
        else:
            edges = np.sort(rng.uniform(0.1, 0.9, 2))
            heights = rng.permutation([1.0, 0.0, -0.8])
            shape = heights[np.searchsorted(edges, x_index)]
        return shape - shape.mean()

    return x + strength * at.once("pattern", pattern)


# ---- whole DN ----------------------------------------------------------------------------------------------


def bit_truncation(dn: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """The lowest `strength` bits (rounded up to a whole number) read zero; other form: rounded, not cut."""
    bits = int(np.ceil(strength - 1e-9))
    if bits == 0:
        return dn
    step = 2**bits
    top = 2**at.sensor.bits - step
    if at.form == "rounded":
        return np.minimum(np.floor(dn / step + 0.5) * step, top)
    return np.floor(dn / step) * step


def missing_codes(dn: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share `strength` of the codes never comes, the code below comes instead.

    Other form: at regular places.
    """
    codes = 2**at.sensor.bits
    if at.form == "regular" and strength > 0:
        every = max(round(1 / strength), 2)
        gone = (np.arange(codes) + at.die().integers(every)) % every == 0
    else:
        gone = at.once("gone", lambda: at.die().random(codes) < strength)
    table = np.arange(codes, dtype=float)
    table[1:][gone[1:]] -= 1
    return table[dn.astype(int)]
