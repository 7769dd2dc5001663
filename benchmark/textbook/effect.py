"""What an effect is: it may act at ten places of the chain, and does nothing where it says nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..camera import Shot
from .cameras import Camera

Numbers = Mapping[str, Any]


@dataclass
class Moment:
    """The frame being taken: its place in the plan, its shot, and, once they are known, the electrons that were read."""

    index: int
    shot: Shot
    charge_e: np.ndarray


class Effect:
    """One effect in one specimen. `numbers` are its parameters, `rng` the generator of the whole set.

    `prepare` makes what stays the same in all frames. The other methods are the places of the chain, in its order.
    """

    def __init__(self, numbers: Numbers, camera: Camera, rng: np.random.Generator, frames: int):
        self.numbers, self.camera, self.rng, self.frames = numbers, camera, rng, frames
        self.prepare()

    def prepare(self) -> None:
        """Make the maps of the specimen."""

    def light(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """Expected photons per pixel; flats and scenes only."""
        return x

    def photo(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """Expected electrons from light."""
        return x

    def dark(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """Dark current in e-/s."""
        return x

    def expected(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """Expected electrons from all."""
        return x

    def collected(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """Electrons drawn, before the full well clips them."""
        return x

    def well(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """Electrons in the wells and on their way to the amplifier."""
        return x

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """Signal, offset and read noise in electrons, as real numbers."""
        return x

    def amplified(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """The same in DN, without the pedestal."""
        return x

    def converter(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """DN with the pedestal, before rounding."""
        return x

    def code(self, x: np.ndarray, at: Moment) -> np.ndarray:
        """Whole DN."""
        return x
