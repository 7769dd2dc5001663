"""Images made as small as the network takes them, in one way for training and for testing.

`area` averages all pixels that fall into one (as binning does: white noise falls by the factor of the reduction).
`linear` interpolates between the nearest pixels, which is what ultralytics does in training and in prediction: at a
whole odd factor it reads the centre pixel alone, so noise stays as it is and detail is aliased.
"""

from pathlib import Path

import cv2
import numpy as np

from visaug.errors import InputError
from visaug_train.geometry import Pinhole

METHODS = {"area": cv2.INTER_AREA, "linear": cv2.INTER_LINEAR}


def reduced(image: np.ndarray, size: tuple[int, int], how: str) -> np.ndarray:
    """An image (rows, columns[, C]) with `size` = (width, height) pixels."""
    if image.shape[1::-1] == tuple(size):
        return image
    return cv2.resize(image, size, interpolation=METHODS[how])


def fitting(camera: Pinhole, image_size: int) -> tuple[int, int]:
    """Width and height of the camera's images with `image_size` pixels on the longer side; never enlarged."""
    scale = min(1.0, image_size / max(camera.width, camera.height))
    return round(camera.width * scale), round(camera.height * scale)


def read_image(file: Path, camera: Pinhole, flags: int = cv2.IMREAD_UNCHANGED) -> np.ndarray:
    """An image file of this camera."""
    image = cv2.imread(str(file), flags)
    if image is None:
        raise InputError("cannot be read", file=file, expected="an image")
    if image.shape[:2] != (camera.height, camera.width):
        raise InputError(
            f"wrong camera: the image has {image.shape[1]} x {image.shape[0]} pixels",
            file=file,
            expected=f"{camera.width} x {camera.height}, as camera.json says",
        )
    return image
