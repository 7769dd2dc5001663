"""Noisy copies of picture files: `visaug augment`.

A copy has its original's name, size, depth, number of channels and tags. Each file's noise depends on the seed
and the copy's name alone, so neither the order of files nor an interruption changes a byte.
"""

import hashlib
import shutil
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from visaug.augment.image_io import Picture, read_picture, write_picture
from visaug.augment.jobs import find_label, label_place, plan_jobs
from visaug.augment.journal import JOURNAL as JOURNAL
from visaug.augment.journal import Journal
from visaug.core.errors import InputError
from visaug.core.files import whole_file

if TYPE_CHECKING:
    from visaug.augment.sensor_noise import SensorNoise
    from visaug.camera import Camera

Progress = Callable[[str, int, int], None]


@dataclass
class Augmented:
    """What a call did.

    Attributes:
        written: number of copies written.
        kept: number of copies that an earlier call with the same settings had made.
        failed: a line for each picture that could not be used.
        skipped: suffix -> number of files in the folders that are no pictures.
        assumed: (transfer function, reason) -> number of copies written on that assumption.
        clipped: number of floating-point pictures with values outside [0, 1], which a sensor cuts.
        unlabelled: number of pictures without labels, where labels were to be copied.
    """

    written: int = 0
    kept: int = 0
    failed: list[str] = field(default_factory=list)
    skipped: Counter[str] = field(default_factory=Counter)
    assumed: Counter[tuple[str, str]] = field(default_factory=Counter)
    clipped: int = 0
    unlabelled: int = 0


def augment_files(
    inputs: Sequence[str | Path],
    output: str | Path,
    camera: "Camera | Sequence[Camera]",
    *,
    seed: int = 0,
    p: float = 1.0,
    copies: int = 1,
    bits: int | None = None,
    labels: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> Augmented:
    """Write a noisy copy of every picture below `output`.

    Args:
        inputs: pictures, and folders that are searched whole; a folder's inner paths are kept below `output`.
        output: folder for the copies; may hold copies of an earlier call, which are kept if camera, seed,
            options and original are the same.
        camera: the camera whose noise is added; of several, each copy gets one, all equally likely.
        seed: the same seed gives the same bytes.
        p: probability that a copy gets noise; the others are the original's bytes.
        copies: of each picture; with more than one, `a.png` becomes `a_1.png`, `a_2.png`, ...
        bits: depth of the data in 16-bit words where it is less: 10, 12 or 14.
        labels: copy YOLO labels (.txt) too, to where ultralytics looks for them.
        progress: called with (description, files done, files in all).
        options: passed to `SensorNoise`, e.g. transfer="srgb" or gain_db=(0, 24). transfer="auto" decides by
            each file; see `visaug.augment.image_io.transfer`.

    Returns:
        What was done. Pictures that cannot be used are named in it and do not stop the others.

    Raises:
        InputError: no pictures, none that can be used, two with the same place in `output`, or an output that
            would overwrite an original.
    """
    from visaug.augment.sensor_noise import SensorNoise

    output = Path(output)
    if not 0 <= p <= 1:
        raise InputError(f"{p} is not a probability", field="p", expected="0 to 1")
    if copies < 1:
        raise InputError(f"{copies} copies", field="copies", expected="1 or more")
    if bits is not None and not 1 <= bits <= 16:
        raise InputError(f"{bits} bit", field="bits", expected="1 to 16")
    jobs = plan_jobs([Path(path) for path in inputs], output, copies, labels)
    noise = SensorNoise(camera, **options)
    settings = {"cameras": [one.to_yaml() for one in noise.cameras], "seed": seed, "p": p, "bits": bits}
    settings |= {key: str(value) for key, value in options.items()}
    done = Augmented(skipped=jobs.skipped)
    with Journal(output, settings) as journal:
        for number, (name, source) in enumerate(jobs.sources.items()):
            if progress:
                progress("augmenting", number, len(jobs.sources))
            try:
                if journal.holds(name, source):
                    done.kept += 1
                else:
                    _make(source, output / name, noise, _seed_of(seed, name), p, bits, done)
                    journal.add(name, source)
                if labels:
                    _copy_label(source, output / name, done)
            except InputError as mistake:
                done.failed.append(str(mistake))
    if progress:
        progress("augmenting", len(jobs.sources), len(jobs.sources))
    if not done.written + done.kept:
        more = f" (and {len(done.failed) - 1} more)" if len(done.failed) > 1 else ""
        raise InputError(f"no picture could be used: {done.failed[0]}{more}")
    return done


def _make(
    source: Path, target: Path, noise: "SensorNoise", seed: int, p: float, bits: int | None, done: Augmented
) -> None:
    """One copy."""
    picture = read_picture(source)
    generator = torch.Generator().manual_seed(seed)
    if float(torch.rand((), generator=generator, dtype=torch.float64)) >= p:
        with whole_file(target) as temporary:
            shutil.copyfile(source, temporary)
        done.written += 1
        return
    try:
        noisy = add_noise(picture, noise, seed, bits)
    except InputError as mistake:
        raise InputError(mistake.problem, file=source, expected=mistake.expected) from None
    with whole_file(target) as temporary:
        write_picture(temporary, noisy)
    done.written += 1
    chosen = noise.transfer != "auto"
    done.assumed[(noise.transfer, "as given") if chosen else (picture.transfer, picture.reason)] += 1
    if picture.pixels.dtype.kind == "f":
        light = picture.pixels[..., : picture.colours]
        done.clipped += bool((light < 0).any() or (light > 1).any())


def add_noise(picture: Picture, noise: "SensorNoise", seed: int, bits: int | None = None) -> Picture:
    """The picture with noise on its colour channels; alpha, depth and size stay.

    Args:
        picture: floating-point values outside [0, 1] are cut first, as a sensor does.
        noise: whose transfer "auto" means the picture's own.
        seed: of the noise.
        bits: depth of the data in 16-bit words.
    """
    pixels, colours = picture.pixels, picture.colours
    light = pixels[..., :colours]
    top = _white(light, bits)
    clean = torch.from_numpy((light.astype(np.float64) / top).clip(0, 1).astype(np.float32))
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        torch.manual_seed(seed)
        batch = clean.permute(2, 0, 1)[None].contiguous()
        noisy = noise.apply_draws(batch, noise.draw(1), transfer=picture.transfer)[0].permute(1, 2, 0)
    result = pixels.copy()
    values = noisy.double().numpy() * top
    if pixels.dtype.kind != "f":
        values = values.round().clip(0, top)
    result[..., :colours] = values.astype(pixels.dtype)
    return picture.with_pixels(result)


def _white(light: np.ndarray, bits: int | None) -> float:
    """The value of white.

    Raises:
        InputError: values above that of `bits`, or floats that are all whole and exceed 1, as a picture of 0 to 255 has
            them: light in [0, 1] would have fractions.
    """
    if light.dtype.kind == "f":
        there = light[np.isfinite(light)]
        if there.max(initial=0) > 1 and np.array_equal(there, np.round(there)):
            raise InputError(
                f"holds whole numbers up to {there.max():g} as floating point",
                expected="values in [0, 1]: divide by the value of white (255 for 8-bit data)",
            )
        return 1.0
    if bits is None or light.dtype != np.uint16:
        return float(np.iinfo(light.dtype).max)
    top = 2**bits - 1
    if light.max(initial=0) > top:
        raise InputError(f"contains the value {light.max()}", expected=f"at most {top}, for {bits}-bit data")
    return float(top)


def _copy_label(source: Path, target: Path, done: Augmented) -> None:
    label = find_label(source)
    if label is None:
        done.unlabelled += 1
        return
    place = label_place(target)
    if place.resolve() == label.resolve():
        raise InputError("would be overwritten", file=label, expected="another output folder")
    content = label.read_bytes()
    if not place.is_file() or place.read_bytes() != content:
        with whole_file(place) as temporary:
            temporary.write_bytes(content)


def _seed_of(seed: int, name: str) -> int:
    digest = hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") >> 1
