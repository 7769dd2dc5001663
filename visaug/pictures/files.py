"""Groups of similar pictures in a set, and the processing recorded in their files."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from visaug.core.errors import InputError
from visaug.frames import FrameSet
from visaug.frames.limits import pillow_image
from visaug.frames.pixels import PICTURES


@dataclass(frozen=True)
class PictureSet:
    """Pictures of one size and one JPEG table."""

    frames: FrameSet  # the set they are from
    indices: tuple[int, ...]  # positions in the set
    # (8, 8) rounding steps of the DCT coefficients in 8-bit DN, 1 where the files are not JPEG
    steps: np.ndarray
    is_jpeg: bool
    top_dn: float  # the highest code

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def scale(self) -> float:
        """DN of the files per 1/255 of full scale."""
        return self.top_dn / 255

    def read(self, n: int) -> np.ndarray:
        """Picture `n`, (H, W) in 1/255 of full scale."""
        return self.frames.read(self.indices[n]).astype(np.float64) / self.scale


def largest_group(frames: FrameSet, warn: Callable[[str], object]) -> PictureSet:
    """The pictures of the commonest size and JPEG table; the others are reported."""
    every = [i for i, r in enumerate(frames.records) if r.kind == "image"]
    files = {i: _file(frames, i) for i in every}
    if not (groups := Counter(files.values())):
        raise InputError("holds no ordinary pictures", expected="pictures of scenes (PNG, TIFF, JPEG)")
    chosen, count = groups.most_common(1)[0]
    shape, table = chosen.shape, chosen.table
    if len(groups) > 1:
        sizes = len({file.shape for file in groups})
        what = f"{sizes} sizes" if sizes > 1 else f"{len(groups)} kinds of files (JPEG quality, colour)"
        warn(
            f"several_cameras: the pictures have {what}; the largest group is used, {count} of {len(every)} pictures of "
            f"{shape[0]} x {shape[1]}"
        )
    indices = [i for i in every if files[i] == chosen]
    if chosen.colour and table is not None and _channels_differ(frames, indices[0]):
        warn(
            "colour_jpeg: green is used where the channels differ, and JPEG is taken to have rounded it as it rounds "
            "luminance; it rounds colour more, so noise comes out too low and gain too high"
        )
    most = 300
    if len(indices) > most:
        indices = [indices[k] for k in np.unique(np.linspace(0, len(indices) - 1, most).astype(int))]
        warn(f"part_of_the_pictures: {most} of {count} pictures are used, evenly spaced by name")
    bits = frames.bit_depth or 8
    steps = np.ones((8, 8)) if table is None else np.array(table, float).reshape(8, 8)
    return PictureSet(frames, tuple(indices), steps, table is not None, float((1 << bits) - 1))


@dataclass(frozen=True)
class _File:
    """What a file's head tells: rows and columns, the JPEG luminance table row by row, whether it holds colour."""

    shape: tuple[int, int]
    table: tuple[int, ...] | None = None
    colour: bool = False


def _file(frames: FrameSet, i: int) -> _File:
    path = frames.path(i)
    if path is None or path.suffix.lower() not in PICTURES:
        return _File(frames.shape(i))
    try:
        with pillow_image(path) as picture:
            tables = getattr(picture, "quantization", None)
            colour = picture.mode not in ("L", "I", "I;16", "F", "1")
            return _File((picture.height, picture.width), tuple(tables[0]) if tables else None, colour)
    except OSError:
        return _File(frames.shape(i))  # raises the error of the file


def _channels_differ(frames: FrameSet, i: int) -> bool:
    path = frames.path(i)
    assert path is not None  # its head has been read
    with pillow_image(path) as picture:
        return bool(np.ptp(np.asarray(picture.convert("RGB")), axis=2).any())


def quality_of(steps: np.ndarray) -> tuple[float, float, float]:
    """Quality in the scale of the Independent JPEG Group whose table is nearest, and the range of as near ones."""
    from visaug.effects.picture.jpeg import LUMINANCE

    base = np.array([float(v) for v in LUMINANCE.split()]).reshape(8, 8)
    qualities = np.arange(1, 101)
    scale = np.where(qualities < 50, 5000 // qualities, 200 - 2 * qualities)
    tables = np.clip((scale[:, None, None] * base + 50) // 100, 1, 255)
    off = np.abs(np.log(tables / steps)).mean((1, 2))
    near = qualities[off <= off.min() + 1e-9]
    return float(near[len(near) // 2]), float(near[0]), float(near[-1])
