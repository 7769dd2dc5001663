"""Small data that come with the package: a rendered picture, and frames of a simulated camera with its data sheet."""

import shutil
from pathlib import Path

_EXAMPLE = Path(__file__).parent / "example"

__all__ = ["copy_example", "example_camera", "example_frames", "example_picture"]


def example_picture() -> Path:
    """A clean rendered picture of a spacecraft: PNG, 320 x 200, 8 bit, monochrome, sRGB.

    Examples:
        >>> from visaug.data import example_picture
        >>> example_picture().name
        'render.png'
    """
    return _EXAMPLE / "render.png"


def example_frames() -> Path:
    """A folder with 52 frames of 64 x 80 pixels: bias, darks and flats of a simulated camera.

    The camera has one effect that its data sheet (`example_camera`) does not tell. It was simulated in plain NumPy by
    `scripts/example_data.py` of the repository, which shares no code with the package.

    Examples:
        >>> import visaug
        >>> len(visaug.FrameSet.load(visaug.data.example_frames()))
        52
    """
    return _EXAMPLE / "frames"


def example_camera() -> Path:
    """The data sheet of the camera of `example_frames`, as a camera.yaml."""
    return _EXAMPLE / "data_sheet.yaml"


def copy_example(folder: str | Path) -> Path:
    """Copy picture, frames and data sheet into a new or empty folder, and return it.

    Raises:
        InputError: the folder holds something.
    """
    from visaug.core.files import whole_folder

    with whole_folder(folder) as new:
        shutil.copytree(_EXAMPLE, new, dirs_exist_ok=True)
    return Path(folder)
