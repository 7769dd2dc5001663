"""Names of simulated sets: two sets have the same name exactly if they are simulated alike."""

import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any
from weakref import WeakKeyDictionary

from torch import Tensor

from visaug.camera import Camera
from visaug.effects import catalogue

ROOT = Path(__file__).parents[1]  # of the package
ROOMS = ("core/sampling", "effects", "camera", "frames", "statistics", "pictures", "diagnosis")


class Names:
    """Names of the simulated sets of one plan.

    Args:
        identity: what the plan's simulations depend on, as something that prints as what it is.
        seed: of all simulations.
    """

    def __init__(self, identity: Any, seed: int):
        self._plan = digest(identity, seed, _code())
        self._cameras: WeakKeyDictionary[Camera, str] = WeakKeyDictionary()
        self._maps: dict[int, tuple[Tensor, str]] = {}  # by identity; the tensor is held so that it stays one

    def of(self, camera: Camera, number: int, uses: Sequence[str]) -> str:
        """The name of the simulation of this number, by the uses of its frames."""
        own = self._cameras.get(camera)
        if own is None:
            own = self._cameras[camera] = self._camera(camera)
        return digest(self._plan, own, number, tuple(uses))

    def _camera(self, camera: Camera) -> str:
        sources = [source_of(name) for name in camera.effect_names]
        maps = [(name, self._map(values)) for name, values in camera.maps.items()]
        return digest(camera.to_dict(), maps, sources)

    def _map(self, values: Tensor) -> str:
        known = self._maps.get(id(values))
        if known is None:
            known = self._maps[id(values)] = (values, digest(values.numpy().tobytes()))
        return known[1]


def digest(*parts: object) -> str:
    """A name for parts that print as what they are."""
    return hashlib.blake2b(repr(parts).encode(), digest_size=12).hexdigest()


@cache
def _code() -> str:
    """Hash of the program's own code."""
    content = hashlib.blake2b(digest_size=8)
    files = [file for room in ROOMS for file in sorted((ROOT / room).rglob("*.py"))]
    for file in (*files, ROOT / "augment/exposure.py"):
        content.update(file.read_bytes())
    return content.hexdigest()


def source_of(name: str) -> str:
    """Hash of the source of an effect from a user's file; empty for the catalogue's own."""
    for part in vars(catalogue()[name]).values():
        if isinstance(part, FunctionType):
            file = Path(part.__code__.co_filename)
            if file.is_relative_to(ROOT) or not file.is_file():
                return ""
            return hashlib.blake2b(file.read_bytes(), digest_size=8).hexdigest()
    return ""
