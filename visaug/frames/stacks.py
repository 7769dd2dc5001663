"""Tables that count the frames of a stack along its last axis, or name files whose planes are colours."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from visaug.core.errors import InputError
from visaug.frames.arrays import arrays_in
from visaug.frames.headers import frames_of
from visaug.frames.pixels import ARRAYS, HDF5, TIFFS, split_name, suffix_of
from visaug.frames.record import FrameRecord


def counted_along_the_last_axis(
    records: Sequence[FrameRecord], root: Path, warnings: list[str]
) -> list[FrameRecord]:
    """Records of a table whose indices are all those of a stack's last axis, and not of its first, pick along the last, and so do
    others whose frames then have the same size, where the table lists a part of them.

    ``a.npz#dark[0]`` to ``[9]`` of an array (96, 128, 10) are ten frames of 96 x 128, not ten of 128 x 10.
    """
    stacks: dict[tuple[str, str | None], dict[int, list[int]]] = {}
    for n, record in enumerate(records):
        file, key, index = split_name(record.file)
        if len(index) == 1 and isinstance(index[0], int) and suffix_of(root / file) in (*ARRAYS, *HDF5):
            stacks.setdefault((file, key), {}).setdefault(index[0], []).append(n)
    made = list(records)
    counted: list[tuple[str, str | None, tuple[int, ...], dict[int, list[int]]]] = []
    sizes: set[tuple[int, ...]] = set()  # of frames along a last axis
    shapes: dict[str, dict[str, tuple[int, ...]]] = {}
    for (file, key), places in stacks.items():
        try:
            held = shapes.setdefault(file, {}) or {name: shape for name, shape, _ in arrays_in(root / file)}
        except InputError:
            continue  # a file that is not there, or damaged, is named when it is read
        shapes[file] = held
        shape = held.get(key or "") or (next(iter(held.values())) if len(held) == 1 else ())
        if len(shape) != 3 or max(places) >= shape[2] or shape[0] <= shape[2]:
            continue
        if sorted(places) == list(range(shape[2])):
            sizes.add(shape[:2])
        counted.append((file, key, shape, places))
    for file, key, shape, places in counted:
        if shape[:2] not in sizes or shape[1:] in sizes:
            continue
        for index, members in places.items():
            for n in members:
                made[n] = replace(records[n], file=f"{file}#{key or ''}[:,:,{index}]")
        warnings.append(
            f"stack_axis_assumed: {file}#{key or ''} of shape {shape}: the table lists one frame for each place of the last axis; "
            "frames are read along it"
        )
    return made


def of_which_green_is_read(records: Sequence[FrameRecord], root: Path) -> list[str]:
    """A warning where a table names TIFF files of three or four samples a pixel."""
    named = (split_name(record.file) for record in records)
    files = {file: None for file, _, index in named if not index and suffix_of(root / file) in TIFFS}
    coloured = []
    for file in files:
        with suppress(InputError):  # a file that is not there, or damaged, is named when it is read
            (_, facts), *more = frames_of(root / file)
            if "colour_planes" in facts.get("said", {}) and not more:
                coloured.append(file)
    if not coloured:
        return []
    others = f" and {len(coloured) - 1} other files" if len(coloured) > 1 else ""
    said = f"{coloured[0]}{others} of several samples a pixel are read as colours, of which green alone is used. If they are three "
    return [f"colour_planes: {said}frames taken in turn, name each in the table: {coloured[0]}#[0]"]
