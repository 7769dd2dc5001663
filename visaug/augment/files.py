"""Noisy copies of picture files: `visaug augment`.

A copy has its original's name, size, depth, number of channels and tags. Each file's noise depends on the seed
and the copy's name alone, so neither the order of files nor an interruption changes a byte.
"""

import hashlib
import os
import shutil
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from visaug.augment.image_io import SUFFIXES, Picture, read_picture, write_picture
from visaug.augment.images import check_bits, probability, used_bits
from visaug.augment.jobs import check_kept, find_label, label_place, plan_jobs
from visaug.augment.journal import JOURNAL as JOURNAL
from visaug.augment.journal import Journal, content_of, made_of, place_of, settings_of
from visaug.augment.label_images import why_labels
from visaug.augment.sensor_noise import SensorNoise
from visaug.core.errors import InputError, naming
from visaug.core.files import whole_file
from visaug.core.sampling import as_seed

if TYPE_CHECKING:
    from visaug.camera import Camera

Progress = Callable[[str, int, int], None]
AS_IT_IS = "/as it is"  # follows the hash of a copy without noise of a file that looks like labels


@dataclass
class Augmented:
    """What a call did."""

    written: int = 0  # copies
    kept: int = 0  # copies that an earlier call with the same settings had made
    replaced: int = 0  # written ones that replaced a copy of an earlier call, or with `force` another file
    failed: list[str] = field(default_factory=list)  # a line for each picture that could not be used
    # suffix -> files in the folders that are no pictures, and were not carried
    skipped: Counter[str] = field(default_factory=Counter)
    excluded: int = 0  # pictures that the patterns left out, and that were not carried
    # (transfer function, reason) -> copies written on that assumption
    assumed: Counter[tuple[str, str]] = field(default_factory=Counter)
    coloured: int = 0  # copies written of colour pictures with noise
    clipped: int = 0  # floating-point pictures with values outside [0, 1], which a sensor cuts
    unlabelled: int = 0  # pictures without YOLO labels, where YOLO labels were copied for others
    carried: int = 0  # other files that were copied as they are, with `labels`
    # reason -> files that look like labels and were copied without noise
    like_labels: Counter[str] = field(default_factory=Counter)
    # folders in which copies of this or an earlier call were passed over; see `visaug.augment.jobs.CopyPlan`
    outputs: list[Path] = field(default_factory=list)
    again: list[Path] = field(default_factory=list)  # inputs that hold nothing but copies of earlier calls


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
    include: Sequence[str] = (),
    exclude: Sequence[str] = (),
    force: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> Augmented:
    """Write a noisy copy of every picture below `output`.

    Args:
        inputs: pictures, and folders that are searched whole; a folder's inner paths are kept below `output`. Several
            inputs that hold files of one name are kept apart by the folders in which they differ.
        output: folder for the copies; may hold copies of an earlier call, which are kept if camera, seed, options,
            visaug itself and original are the same.
        camera: the camera whose noise is added; of several, each copy gets one, all equally likely.
        seed: the same seed gives the same bytes; it chooses the specimen of a fixed pattern that all copies share.
        p: probability that a copy gets noise; the others are the original's bytes.
        copies: of each picture; with more than one, `a.png` becomes `a_1.png`, `a_2.png`, ...
        bits: depth of the data in 16-bit words where it is less: 10, 12 or 14.
        labels: copy what belongs to the pictures too: YOLO labels (.txt) to where ultralytics looks for them, and every
            other file of the folders (COCO and BOP annotations, masks, depth) to its place. With several copies, the
            YOLO labels alone: other annotations name single pictures.
        include: patterns of the pictures that get noise, see `visaug.augment.jobs.matches`; empty means all.
        exclude: patterns of those that do not.
        force: add noise to files that look like labels too, and replace files that visaug did not write, or that were
            changed since.
        progress: called with (description, files done, files in all).
        options: passed to `SensorNoise`, e.g. transfer="srgb" or gain_db=(0, 24). transfer="auto" decides by
            each file; see `visaug.augment.image_io.picture`.

    Returns:
        What was done. Pictures that cannot be used are named in it and do not stop the others. A file that looks like
        labels is copied without noise, see `visaug.augment.label_images`.
    """
    output, seed = Path(output), as_seed(seed)
    p, bits = probability(p), used_bits(bits)
    if copies < 1:
        raise InputError(f"{copies} copies", field="copies", expected="1 or more")
    if output.suffix.lower() in SUFFIXES and not output.exists():
        raise InputError("is the name of a picture", file=output, expected="a folder for the copies")
    jobs = plan_jobs([Path(path) for path in inputs], output, copies, include, exclude)
    yolo = {name: label for name in jobs.sources if labels and (label := find_label(jobs.sources[name]))}
    own = {label.resolve() for label in yolo.values()}
    others = {name: other for name, other in jobs.others.items() if other.resolve() not in own}
    # files that go along as they are: all others, but for YOLO labels
    carried, left = (others, {}) if labels and copies == 1 else ({}, others)
    yolo = {_label_name(output, name): label for name, label in yolo.items()}
    check_kept(output, {**jobs.sources, **carried, **yolo})
    noise = SensorNoise(camera, seed=seed, **options)
    work = _Work(output, noise, seed, p, bits, force, settings_of(noise, seed, p, bits, options))
    with Journal(output, force) as journal:
        work.journal = journal
        journal.check_new([*jobs.sources, *carried])
        for name, label in yolo.items():
            work.check(name, label)
        for number, (name, source) in enumerate(jobs.sources.items()):
            if progress:
                progress("augmenting", number, len(jobs.sources))
            try:
                work.copy(name, source)
            except InputError as mistake:
                if labels and source.suffix.lower() == ".npy":  # boxes and identities, as Replicator has them
                    carried[name] = source
                elif (said := str(mistake)) not in work.done.failed:  # once for all copies of a picture
                    work.done.failed.append(said)
                continue
            if labels:
                work.copy_label(name, source)
        for name, source in carried.items():
            work.carry(name, source)
    done = work.done
    done.outputs, done.again = jobs.outputs, jobs.again
    for other in left.values():
        suffix = other.suffix.lower()
        if suffix in SUFFIXES:
            done.excluded += 1
        else:
            done.skipped[suffix or "without a suffix"] += 1
    if not work.labelled and done.carried:
        done.unlabelled = 0
    if progress:
        progress("augmenting", len(jobs.sources), len(jobs.sources))
    if not done.written + done.kept:
        more = f" (and {len(done.failed) - 1} more)" if len(done.failed) > 1 else ""
        raise InputError(f"no picture could be used: {done.failed[0]}{more}")
    return done


def _label_name(output: Path, name: str) -> str:
    """Where the YOLO labels of a copy go, from the output folder."""
    return os.path.relpath(label_place(output / name), os.path.abspath(output))


@dataclass
class _Work:
    """One call of `augment_files`: its settings, its journal and what it did."""

    output: Path
    noise: SensorNoise
    seed: int
    p: float
    bits: int | None
    force: bool
    settings: str
    journal: Journal = field(init=False)
    done: Augmented = field(default_factory=Augmented)
    labelled: int = 0

    def copy(self, name: str, source: Path) -> None:
        """A copy with noise; without for a file that looks like labels."""
        of = made_of(self.settings, name, source)
        if self.journal.holds(name, of) or (not self.force and self.journal.holds(name, of + AS_IT_IS)):
            self.done.kept += 1
            return
        picture = read_picture(source)
        why = None if self.force else why_labels(name, picture)
        if why is not None:
            self.done.like_labels[why] += 1
            self.write(name, of + AS_IT_IS, lambda temporary: shutil.copyfile(source, temporary))
            return
        place = f"{self.seed}/{name}".encode(errors="surrogateescape")
        seed = int.from_bytes(hashlib.blake2b(place, digest_size=8).digest(), "little") >> 1
        generator = torch.Generator().manual_seed(seed)
        if float(torch.rand((), generator=generator, dtype=torch.float64)) >= self.p:
            self.write(name, of, lambda temporary: shutil.copyfile(source, temporary))
            return
        with naming(source):
            noisy = add_noise(picture, self.noise, seed, self.bits)

        def into(temporary: Path) -> None:
            with naming(source):
                write_picture(temporary, noisy)

        self.write(name, of, into)
        chosen = self.noise.transfer != "auto"
        kind = (self.noise.transfer, "as given") if chosen else (picture.transfer, picture.reason)
        self.done.assumed[kind] += 1
        self.done.coloured += picture.colours == 3
        if picture.pixels.dtype.kind == "f":
            light = picture.light
            self.done.clipped += bool((light < 0).any() or (light > 1).any())

    def write(self, name: str, of: str, into: Callable[[Path], Any]) -> None:
        """A file that is whole or absent, and in the journal."""
        there = (self.output / name).exists()
        with whole_file(self.output / name) as temporary:
            into(temporary)
            self.journal.begin(name)  # not before: what cannot be written leaves no entry
        self.journal.add(name, of)
        self.done.written += 1
        self.done.replaced += there

    def copy_label(self, name: str, source: Path) -> None:
        """The YOLO labels of a picture."""
        if (label := find_label(source)) is None:
            self.done.unlabelled += 1
            return
        self.labelled += 1
        self.carry(_label_name(self.output, name), label)

    def carry(self, name: str, source: Path) -> None:
        """A file as it is."""
        if self.is_carried(name, source):
            return
        place = place_of(self.output, name)
        self.journal.begin(name)
        with whole_file(place) as temporary:
            shutil.copyfile(source, temporary)
        self.journal.add(name, "")
        self.done.carried += 1

    def check(self, name: str, source: Path) -> None:
        """Refuses a place at which something else lies that may not be replaced."""
        if not self.is_carried(name, source):
            self.journal.check(name)

    def is_carried(self, name: str, source: Path) -> bool:
        """Whether the file lies in its place as it is."""
        place = place_of(self.output, name)
        return place.is_file() and content_of(place) == content_of(source)


def add_noise(picture: Picture, noise: SensorNoise, seed: int, bits: int | None = None) -> Picture:
    """The picture with noise on its colour channels; alpha, depth and size stay.

    Args:
        picture: floating-point values outside [0, 1] are cut first, as a sensor does.
        noise: whose transfer "auto" means the picture's own.
        bits: depth of the data in 16-bit words.
    """
    pixels, colours = picture.pixels, picture.colours
    light = pixels[..., :colours]
    top = _white(picture, bits)
    clean = torch.from_numpy((light.astype(np.float64) / top).clip(0, 1).astype(np.float32))
    with torch.no_grad():
        draws = noise.draw(1, source=torch.Generator().manual_seed(seed))
        batch = clean.permute(2, 0, 1)[None].contiguous()
        noisy = noise.apply_draws(batch, draws, transfer=picture.transfer)[0].permute(1, 2, 0)
    result = pixels.copy()
    values = noisy.double().numpy() * top
    if pixels.dtype.kind != "f":
        values = values.round().clip(0, top)
    result[..., :colours] = values.astype(pixels.dtype)
    return picture.with_pixels(result)


def _white(picture: Picture, bits: int | None) -> float:
    """The value of white; floats that are all whole and exceed 1, as a picture of 0 to 255 has them, are refused."""
    light = picture.light
    check_bits(bits, "floating point" if light.dtype.kind == "f" else light.dtype.name)
    if light.dtype.kind == "f":
        there = light[np.isfinite(light)]
        if there.max(initial=0) > 1 and np.array_equal(there, np.round(there)):
            problem = f"holds whole numbers up to {there.max():g} as floating point"
            expected = "values in [0, 1]: divide by the value of white (255 for 8-bit data)"
            raise InputError(problem, expected=expected)
        return 1.0
    if bits is None:
        return float(np.iinfo(light.dtype).max)
    top = 2**bits - 1
    if light.max(initial=0) > top:
        expected = f"at most {top}, the highest value of {bits} bits, or another number of bits"
        raise InputError(f"contains the value {light.max()}", field="bits", expected=expected)
    return float(top)
