"""A camera's noise as a perturber of NRTK (github.com/Kitware/nrtk, 1.x): any of its factories and sweeps can use it."""

from collections.abc import Iterable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import torch

from visaug.augment.images import ImageNoise
from visaug.core.errors import InputError

try:
    from nrtk.interfaces import PerturbImage
except ImportError:
    raise InputError("nrtk is not installed", expected="pip install nrtk") from None


class CameraPerturber(PerturbImage):
    """The noise of a measured camera on an image; its boxes stay.

    Args:
        camera: a camera file or the name of a camera.
        gain_db: gain in dB; the camera's own where left out.
        exposure: share of the saturating light that reaches the sensor, 1e-6 to 1; the image is brightened again.
        strength: factor on the standard deviation of all noise, 0 to 100.
        seed: of the noise; the same image then gets the same noise. None draws anew.
        transfer: "auto", "linear" or "srgb", see `SensorNoise`.

    Raises:
        InputError: an option or an image that is not valid.

    Examples:
        >>> from visaug.augment.nrtk_noise import CameraPerturber  # doctest: +SKIP
        >>> noisy, boxes = CameraPerturber("sony_imx174", gain_db=24.0)(image=image)  # doctest: +SKIP
    """

    def __init__(
        self,
        camera: str,
        gain_db: float | None = None,
        exposure: float | None = None,
        strength: float = 1.0,
        seed: int | None = None,
        transfer: str = "auto",
    ) -> None:
        super().__init__()
        if not isinstance(camera, str | Path):  # which a configuration can hold
            expected = "a camera file or the name of a camera"
            raise InputError(f"is a {type(camera).__name__}", field="camera", expected=expected)
        options = {"gain_db": gain_db, "exposure": exposure, "strength": strength, "transfer": transfer}
        self._config = {"camera": str(camera), "seed": seed, **options}
        self._noise = ImageNoise(camera, **options)

    def perturb(
        self, *, image: np.ndarray, boxes: Iterable[Any] | None = None, **kwargs: Any
    ) -> tuple[np.ndarray, Iterable[Any] | None]:
        """The noisy image, of the same shape and type, and a copy of the boxes."""
        seed = self._config["seed"]
        with torch.random.fork_rng(devices=[], enabled=seed is not None):
            if seed is not None:
                torch.manual_seed(seed)
            return self._noise(image), deepcopy(boxes)

    def get_config(self) -> dict[str, Any]:
        """What the constructor takes, as JSON can hold it."""
        return dict(self._config)
