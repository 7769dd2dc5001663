"""Measured maps: files that `prnu.map`, `dsnu.map`, `read_noise.map` and the `map` of further effects name."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from visaug.core.errors import InputError
from visaug.effects import catalogue
from visaug.effects.readout.unexplained import Unexplained, fault_of

if TYPE_CHECKING:
    from visaug.camera.spec import CameraSpec


def named_maps(spec: "CameraSpec") -> dict[str, tuple[str, str]]:
    """Which effects have a measured map: its file's name, and the key that gives it, by effect."""
    found = {part: (getattr(spec, part).map, f"{part}.map") for part in ("prnu", "dsnu", "read_noise")}
    found |= {entry["name"]: (entry.get("map"), f"effects.{i}.map") for i, entry in enumerate(spec.effects)}
    return {effect: (name, key) for effect, (name, key) in found.items() if name is not None}


def set_map(content: dict[str, Any], key: str, name: str) -> None:
    """Names another file in the content of a camera.yaml, at a key of `named_maps`."""
    part, _, entry = key.removesuffix(".map").partition(".")
    holder = content[part][int(entry)] if entry else content[part]
    holder["map"] = name


def load_maps(spec: "CameraSpec", folder: Path | None) -> dict[str, Tensor]:
    """The camera's measured maps by effect, each (rows, columns) float32 in the effect's `map_unit`, or (n,) of a table.

    A profile, (1, columns) or (rows, 1), holds for all rows or columns. The arrays of `unexplained` have keys of their own,
    such as `unexplained.map_e`.

    Args:
        spec: the camera; a map's name is relative to `folder` unless it is absolute.
        folder: the folder of the camera.yaml; the working folder where the camera came from no file.

    Raises:
        InputError: a missing or unreadable file, another shape than the sensor's, or a value that is not
            finite or, of what cannot be below 0, negative.
    """
    found, folder = {}, folder or Path()
    named = named_maps(spec)
    for i, entry in enumerate(spec.effects):
        if entry["name"] == Unexplained.name and Unexplained.name not in named:
            expected = "the file that `visaug diagnose --unexplained` writes"
            raise InputError("is missing", field=f"effects.{i}.map", expected=expected)
    for effect, (name, key) in named.items():
        if effect == Unexplained.name:
            parts = _read_parts(name, key, folder, spec.resolution)
            found |= {f"{effect}.{part}": torch.from_numpy(values) for part, values in parts.items()}
        elif catalogue()[effect].map_is_table:
            found[effect] = torch.from_numpy(_read_table(name, key, folder))
        else:
            pixels = _read(name, key, folder, spec.resolution)
            if catalogue()[effect].map_low > pixels.min():
                raise InputError("holds negative values", file=folder / name, field=key)
            found[effect] = torch.from_numpy(np.broadcast_to(pixels, spec.resolution).copy())
    return found


def effect_of(key: str) -> str:
    """The effect that a measured map belongs to: `unexplained` of `unexplained.map_e`, any other key as it is."""
    return key.partition(".")[0]


def moved(name: str, old: Path | None, new: Path) -> str:
    """A map's name as seen from another folder; the file stays where it is."""
    if Path(name).is_absolute():
        return name
    return Path(os.path.relpath(((old or Path()) / name).absolute(), new.absolute())).as_posix()


def _read(name: str, field: str, folder: Path, resolution: tuple[int, int]) -> np.ndarray:
    from visaug.frames.pixels import PixelReader

    try:
        pixels = PixelReader(folder).read(name).astype(np.float32)
    except InputError as error:
        raise InputError(error.problem, file=error.file, field=field, expected=error.expected) from error
    if any(size not in (1, whole) for size, whole in zip(pixels.shape, resolution)):
        expected = f"{resolution[0]} x {resolution[1]}, the camera's resolution, or 1 for a profile"
        problem = "is {} x {}".format(*pixels.shape)
        raise InputError(problem, file=folder / name, field=field, expected=expected)
    if not np.isfinite(pixels).all():
        raise InputError("holds values that are not finite", file=folder / name, field=field)
    return pixels


def _read_table(name: str, field: str, folder: Path) -> np.ndarray:
    """Values of a table in [0, 1], one after another: from a .npy, or from text with a number or more a line."""
    file = folder / name
    try:
        values = np.load(file) if file.suffix == ".npy" else np.loadtxt(file)
    except (OSError, ValueError) as error:
        expected = ".npy or a text of numbers"
        raise InputError("cannot be read", file=file, field=field, expected=expected) from error
    values = np.atleast_1d(np.asarray(values).squeeze())
    if values.ndim != 1 or len(values) < 2 or values.dtype.kind not in "fiu":
        problem = f"has shape {values.shape}"
        raise InputError(problem, file=file, field=field, expected="2 numbers or more in a row")
    if not np.isfinite(values).all() or values.min() < 0 or values.max() > 1:
        problem = "holds a value below 0, above 1 or not finite"
        raise InputError(problem, file=file, field=field, expected="0 to 1")
    return values.astype(np.float32)


def _read_parts(name: str, field: str, folder: Path, resolution: tuple[int, int]) -> dict[str, np.ndarray]:
    """The arrays of an .npz, float32 by name."""
    file = folder / name
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
    except FileNotFoundError:
        raise InputError("no such file", file=file, field=field) from None
    except Exception as error:  # whatever the bytes lead to
        raise InputError("cannot be read", file=file, field=field, expected="an .npz of arrays") from error
    if fault := fault_of(arrays, resolution):
        raise InputError(fault[0], file=file, field=field, expected=fault[1])
    return {key: values.astype(np.float32) for key, values in arrays.items()}
