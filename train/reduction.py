"""Images made as small as the network takes them, in one way for training and for testing.

`area` averages all pixels that fall into one (as binning does: white noise falls by the factor of the reduction).
`linear` interpolates between the nearest pixels, which is what ultralytics does in training and in prediction: at a
whole odd factor it reads the centre pixel alone, so noise stays as it is and detail is aliased.
"""

import copy
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visaug.core.errors import InputError
from visaug.core.files import write_bytes
from visaug_train.geometry import Pinhole

Size = tuple[int, int]  # width and height, pixels
METHODS = {"area": cv2.INTER_AREA, "linear": cv2.INTER_LINEAR}


def reduced(image: np.ndarray, size: Size, how: str) -> np.ndarray:
    """An image (rows, columns[, C]) with `size` = (width, height) pixels."""
    if image.shape[1::-1] == tuple(size):
        return image
    return cv2.resize(image, size, interpolation=METHODS[how])


def variance_left(whole: int, size: int, how: str) -> float:
    """The share of the variance of white noise along one axis that reducing `whole` pixels to `size` leaves, mean over pixels."""
    weights = cv2.resize(np.eye(whole, dtype=np.float32), (whole, size), interpolation=METHODS[how])
    return float((weights**2).sum(axis=1).mean())


def reduced_camera(camera: dict[str, Any], whole: Size, size: Size, how: str) -> dict[str, Any]:
    """The content of a camera.yaml whose noise is that of the camera's images once these are reduced from `whole` to `size`.

    Noise of pixels, rows and columns is taken as white. Electrons per DN rise as the variance of shot noise falls. JPEG comes
    before the reduction and is left out.
    """
    columns, rows = (variance_left(a, b, how) for a, b in zip(whole, size, strict=True))
    pixels = rows * columns
    in_dn = {"pixel": pixels**0.5, "row": rows**0.5, "column": columns**0.5}
    content = copy.deepcopy(camera)
    content["resolution"] = [size[1], size[0]]
    content["gain_e_per_dn"] = camera["gain_e_per_dn"] / pixels
    content["read_noise"]["sigma_e"] *= in_dn["pixel"] / pixels
    for kind, factor in in_dn.items():
        if kind in content.get("prnu", {}):
            content["prnu"][kind] *= factor
        if f"{kind}_e" in content.get("dsnu", {}):
            content["dsnu"][f"{kind}_e"] *= factor / pixels
    effects = [effect for effect in content.get("effects", []) if effect["name"] != "jpeg"]
    for effect in effects:
        if effect["name"] in ("row_noise", "column_noise"):
            effect["sigma_e"] *= in_dn[effect["name"].split("_")[0]] / pixels
    return content | {"effects": effects}


def fitting(camera: Pinhole, image_size: int) -> Size:
    """Width and height of the camera's images with `image_size` pixels on the longer side; never enlarged."""
    scale = min(1.0, image_size / max(camera.width, camera.height))
    return round(camera.width * scale), round(camera.height * scale)


def read_pixels(file: Path, flags: int = cv2.IMREAD_GRAYSCALE) -> np.ndarray:
    """An image file as 8-bit gray, (rows, columns), or as OpenCV's `flags` say."""
    if (image := cv2.imread(str(file), flags)) is None:
        raise InputError("cannot be read", file=file, expected="an image")
    return image


def write_png(file: Path, image: np.ndarray) -> None:
    """Write an image whole."""
    write_bytes(file, cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 3])[1].tobytes())


def read_image(file: Path, camera: Pinhole, flags: int = cv2.IMREAD_UNCHANGED) -> np.ndarray:
    """An image file of this camera."""
    image = read_pixels(file, flags)
    if image.shape[1::-1] != camera.size:
        problem = f"wrong camera: the image has {image.shape[1]} x {image.shape[0]} pixels"
        expected = f"{camera.width} x {camera.height}, as camera.json says"
        raise InputError(problem, file=file, expected=expected)
    return image
