"""Measured fixed patterns: files that `prnu.map` and `dsnu.map` name."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from visaug.errors import InputError

if TYPE_CHECKING:
    from visaug.camera.spec import CameraSpec

PATTERNS = ("prnu", "dsnu")


def load_maps(spec: "CameraSpec", folder: Path | None) -> dict[str, Tensor]:
    """The camera's measured maps by effect, each (rows, columns) float32: K as a fraction, offsets in e-.

    Args:
        spec: the camera; a map's name is relative to `folder` unless it is absolute.
        folder: the folder of the camera.yaml; the working folder where the camera came from no file.

    Raises:
        InputError: a missing or unreadable file, another shape than the sensor's, or a value that is not
            finite.
    """
    found = {}
    for effect in PATTERNS:
        name = getattr(spec, effect).map
        if name is not None:
            found[effect] = torch.from_numpy(_read(name, f"{effect}.map", folder or Path(), spec.resolution))
    return found


def moved(name: str, old: Path | None, new: Path) -> str:
    """A map's name as seen from another folder; the file stays where it is."""
    path = (old or Path()) / name
    return (
        name
        if Path(name).is_absolute()
        else Path(os.path.relpath(path.absolute(), new.absolute())).as_posix()
    )


def _read(name: str, field: str, folder: Path, resolution: tuple[int, int]) -> np.ndarray:
    from visaug.frames.pixels import PixelReader

    try:
        pixels = PixelReader(folder).read(name).astype(np.float32)
    except InputError as error:
        raise InputError(error.problem, file=error.file, field=field, expected=error.expected) from error
    if pixels.shape != tuple(resolution):
        expected = f"{resolution[0]} x {resolution[1]}, the camera's resolution"
        raise InputError(
            f"is {pixels.shape[0]} x {pixels.shape[1]}", file=folder / name, field=field, expected=expected
        )
    if not np.isfinite(pixels).all():
        raise InputError("holds values that are not finite", file=folder / name, field=field)
    return pixels
