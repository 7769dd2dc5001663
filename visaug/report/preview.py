"""`visaug preview`: one picture through several cameras, as a contact sheet."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from visaug.core.errors import InputError, naming
from visaug.core.files import whole_file
from visaug.core.wording import printable

if TYPE_CHECKING:
    from visaug.camera import Camera

SOFTWARE = "visaug preview"  # in the PNG, by which a sheet is known
WORDS = {"srgb": "sRGB", "linear": "linear"}


def write_preview(
    picture: Path,
    cameras: "Sequence[Camera]",
    output: Path,
    *,
    seed: int = 0,
    bits: int | None = None,
    force: bool = False,
    **options: Any,
) -> str:
    """Write the sheet, a PNG; returns the transfer function that the picture was taken to have, and what was clipped, in words.

    An earlier sheet is replaced.

    Args:
        picture: any that `visaug augment` reads.
        cameras: one crop each.
        output: where the sheet goes.
        seed: of the noise.
        bits: depth of the data in 16-bit words.
        force: replace a file that is no sheet.
        options: passed to `SensorNoise`; gain and exposure that are not given are chosen so that noise is visible.

    Raises:
        InputError: no picture, or a file in the output's place that is no sheet.
    """
    import numpy as np

    from visaug.augment.image_io import read_picture
    from visaug.augment.preview import middle, sample, shown, visible
    from visaug.report.plots.preview import plot_preview

    if output.suffix.lower() != ".png":
        raise InputError("is no PNG", file=output, expected="a name ending in .png")
    if output.exists() and not force and not is_sheet(output):
        expected = "another name, or --force to replace it"
        raise InputError("exists, and is no sheet of visaug", file=output, expected=expected)
    if not picture.is_file():
        problem = "is a folder" if picture.is_dir() else "no such file"
        raise InputError(problem, file=picture, expected="one picture")
    image = read_picture(picture)
    if not np.isfinite(image.light).any():
        raise InputError("holds no pixel with light", file=picture, expected="a picture with numbers in it")
    window = middle(image, rows=300, columns=400)  # of the crop, at most
    samples = []
    for camera in cameras:
        noise, conditions = visible(image, camera, seed, **options)
        with naming(picture):
            samples.append(sample(image, noise, seed, window, bits, conditions))
    chosen = options.get("transfer", "auto")
    kind, reason = (chosen, "as given") if chosen != "auto" else (image.transfer, image.reason)
    transfer = f"{WORDS[kind]} ({reason})"
    if image.pixels.dtype.kind == "f" and ((image.light < 0) | (image.light > 1)).any():
        transfer += ", values outside [0, 1] clipped"
    title = (
        f"{printable(picture.name)}, taken as {transfer}: the middle at 1:1 and a part at 4x.\n"
        "Noise: standard deviation in 8-bit levels (0 to 255). (chosen): so that the noise is visible"
    )
    figure = plot_preview(title, shown(image, window, bits), samples)
    with whole_file(output) as temporary:
        figure.savefig(temporary, dpi=figure.dpi, metadata={"Software": SOFTWARE})
    return transfer


def is_sheet(path: Path) -> bool:
    """Whether `write_preview` made this file."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            return image.info.get("Software") == SOFTWARE
    except (OSError, SyntaxError):  # Pillow's, for what is no picture or a damaged one
        return False
