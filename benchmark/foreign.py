"""Effects that no catalogue has.

The honest answer to these is "unexplained", until a user writes them down.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from .camera import Moment
from .effects import Kind


def row_gain_noise(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """The gain of each row wavers from frame to frame by a relative `strength`: a noisy reference voltage."""
    return x * (1 + strength * at.now().standard_normal((x.shape[0], 1)))


def patchwork(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """8 x 8 blocks whose offset, `strength` e- rms, is new in every frame: a lossy block coder."""
    blocks = [-(-size // 8) for size in x.shape]
    offsets = np.kron(at.now().standard_normal(blocks), np.ones((8, 8)))
    return x + strength * offsets[: x.shape[0], : x.shape[1]]


def row_loading(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Bright rows sag: every pixel loses a share `strength` of its row's mean. A supply that the row's amplifiers load."""
    return x - strength * x.mean(1, keepdims=True)


def electronic_ghost(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share `strength` of the signal comes again some twenty pixels later in the row: an echo on the video line."""
    late = int(at.die().integers(14, 30))
    echo = np.zeros_like(x)
    echo[:, late:] = x[:, :-late]
    return x + strength * echo


def bit_flips(code: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share `strength` of the pixels of every frame arrives with one of its eight lowest bits flipped: a noisy link."""
    rng = at.now()
    hit = rng.random(code.shape) < strength
    flipped = code.astype(int) ^ (1 << rng.integers(0, 8, code.shape))
    return np.where(hit, flipped, code)


def checkerboard(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Pixels that share an amplifier in pairs, staggered: `strength` e- more on black fields, less on white ones."""
    y, column = np.ogrid[: x.shape[0], : x.shape[1]]
    return x + strength * np.where((y + column) % 2, 1.0, -1.0)


def converter_step(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """All signal above a fifth of the full well reads `strength` e- higher: a coarse stage of the converter is off."""
    return x + strength * (x > 0.2 * at.sensor.well_e)


def despeckle(code: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A pixel that differs from the median of its neighbours by more than 1 / `strength` read noises gets that median."""
    middle = median_filter(code, 3)
    off_dn = np.abs(code.astype(float) - middle)
    return np.where(strength * off_dn > at.sensor.read_e / at.sensor.e_per_dn, middle, code)


KINDS: tuple[Kind, ...] = (
    Kind(
        "row_gain_noise",
        "voltage",
        row_gain_noise,
        "relative rms",
        4e-4,
        0.2,
        None,
        ("row", "time"),
        ("signal",),
    ),
    Kind("patchwork", "voltage", patchwork, "e- rms", 0.2, 100, None, ("time", "smooth")),
    Kind("row_loading", "voltage", row_loading, "share", 1e-3, 0.5, None, ("row",), ("signal",)),
    Kind(
        "electronic_ghost",
        "voltage",
        electronic_ghost,
        "share",
        1e-3,
        0.5,
        None,
        ("row", "column", "pixel", "smooth"),
        ("signal",),
    ),
    Kind("bit_flips", "code", bit_flips, "share of pixels", 1e-5, 0.1, None, ("time", "pixel")),
    Kind("checkerboard", "voltage", checkerboard, "e-", 0.1, 100, None, ("pixel",)),
    Kind("converter_step", "voltage", converter_step, "e-", 1, 1000, None, ("level",), ("signal",)),
    Kind(
        "despeckle",
        "code",
        despeckle,
        "1 / read noises",
        0.05,
        0.5,
        None,
        ("time", "pixel"),
        (),
        ("signal", "exposure", "temperature"),
    ),
)
