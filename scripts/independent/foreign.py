"""Effects that no catalogue has.

The honest answer to these is "unexplained", until a user writes them down.
"""

from __future__ import annotations

import numpy as np

from .camera import Moment
from .effects import Kind


def slanted_pickup(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A plane wave across rows and columns, `strength` e-, phase new in every frame.

    Mains or a motor nearby.
    """
    rng = at.die()
    slant, period = rng.uniform(0.5, 1.0), rng.uniform(7, 15)
    y, x_index = np.ogrid[: x.shape[0], : x.shape[1]]
    return x + strength * np.sin(
        2 * np.pi * ((y * np.cos(slant) + x_index * np.sin(slant)) / period + at.now().random())
    )


def row_gain_noise(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """The gain of each row wavers from frame to frame by a relative `strength`: a noisy reference voltage."""
    return x * (1 + strength * at.now().standard_normal((x.shape[0], 1)))


def patchwork(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """8 x 8 blocks whose offset, `strength` e- rms, is new in every frame: a lossy block coder."""
    blocks = [-(-size // 8) for size in x.shape]
    offsets = np.kron(at.now().standard_normal(blocks), np.ones((8, 8)))
    return x + strength * offsets[: x.shape[0], : x.shape[1]]


KINDS: tuple[Kind, ...] = (
    Kind("slanted_pickup", "voltage", slanted_pickup, "e-", 0.2, 100, None, ("time",)),
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
)
