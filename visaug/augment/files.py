"""Noisy copies of picture files: `visaug augment`.

A copy has its original's name, size, bit depth and number of channels. Each file's noise depends on the seed
and the file's name alone, so neither the order of files nor an interruption changes a byte.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from visaug.augment.journal import JOURNAL as JOURNAL
from visaug.augment.journal import Journal
from visaug.augment.pictures import SUFFIXES, Picture, read_picture, write_picture
from visaug.errors import InputError
from visaug.files import whole_file

if TYPE_CHECKING:
    from visaug.camera import Camera

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Augmented:
    """Numbers of files written, and of files that an earlier call with the same settings had made."""

    written: int
    kept: int


def augment_files(
    inputs: Sequence[str | Path],
    output: str | Path,
    camera: "Camera",
    *,
    seed: int = 0,
    progress: Progress | None = None,
    **options: Any,
) -> Augmented:
    """Write a noisy copy of every picture below `output`.

    Args:
        inputs: pictures, and folders that are searched whole; a folder's inner paths are kept below `output`.
        output: folder for the copies; may hold copies of an earlier call, which are kept if camera, seed,
            options and original are the same.
        camera: the camera whose noise is added.
        seed: the same seed gives the same bytes.
        progress: called with (description, files done, files in all).
        options: passed to `VISNoise`, e.g. transfer="srgb".

    Raises:
        InputError: no pictures, a picture that cannot be read, two with the same place in `output`, or an
            output that would overwrite an original.
    """
    from visaug.augment import VISNoise

    output = Path(output)
    jobs = plan_jobs([Path(path) for path in inputs], output)
    noise = VISNoise(camera, p=1.0, **options)
    settings = {"camera": camera.to_yaml(), "seed": seed, **{k: str(v) for k, v in options.items()}}
    written = 0
    with Journal(output, settings) as journal:
        for number, (name, source) in enumerate(jobs.items()):
            if progress:
                progress("augmenting", number, len(jobs))
            if not journal.holds(name, source):
                picture = add_noise(read_picture(source), noise, _seed_of(seed, name))
                with whole_file(output / name) as temporary:
                    write_picture(temporary, picture)
                journal.add(name, source)
                written += 1
    if progress:
        progress("augmenting", len(jobs), len(jobs))
    return Augmented(written, len(jobs) - written)


def plan_jobs(inputs: Sequence[Path], output: Path) -> dict[str, Path]:
    """Place below `output` -> original, in the order of names."""
    jobs: dict[str, Path] = {}
    for start in inputs:
        for name, source in _pictures(start, output):
            if name in jobs and jobs[name].resolve() != source.resolve():
                raise InputError(f"would be written to {name}, as {jobs[name]} would", file=source)
            if (output / name).resolve() == source.resolve():
                raise InputError("would be overwritten", file=source, expected="another output folder")
            jobs[name] = source
    if not jobs:
        raise InputError(
            "holds no pictures",
            file=", ".join(map(str, inputs)),
            expected="files ending in " + " ".join(SUFFIXES),
        )
    return dict(sorted(jobs.items()))


def _pictures(start: Path, output: Path) -> Iterator[tuple[str, Path]]:
    if start.is_file():
        if start.suffix.lower() not in SUFFIXES:
            raise InputError("is no picture", file=start, expected="a name ending in " + " ".join(SUFFIXES))
        yield start.name, start
    elif start.is_dir():
        inside = output.resolve()
        for path in start.rglob("*"):
            made_here = inside != start.resolve() and inside in path.resolve().parents
            if path.is_file() and path.suffix.lower() in SUFFIXES and path.name[0] != "." and not made_here:
                yield path.relative_to(start).as_posix(), path
    else:
        raise InputError("no such file or folder", file=start)


def add_noise(picture: Picture, noise: torch.nn.Module, seed: int) -> Picture:
    """The picture with noise on its colour channels; alpha, depth and size stay."""
    pixels, colours = picture.pixels, picture.colours
    top = float(np.iinfo(pixels.dtype).max)
    clean = torch.from_numpy(pixels[..., :colours].astype(np.float32) / np.float32(top))
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        torch.manual_seed(seed)
        noisy = noise(clean.permute(2, 0, 1)[None])[0].permute(1, 2, 0)
    result = pixels.copy()
    result[..., :colours] = (noisy.double() * top).round().clamp(0, top).numpy().astype(pixels.dtype)
    return Picture(result, picture.extras)


def _seed_of(seed: int, name: str) -> int:
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") >> 1
