"""Camera noise as an albumentations transform; imports albumentations."""

import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import albumentations
import numpy as np
import torch
from torch.utils.data import get_worker_info

from visaug.augment.image_noise import ImageNoise, probability
from visaug.augment.sensor_noise import SensorNoise, Source
from visaug.camera import Camera
from visaug.core.sampling import derive_key


class AlbumentationsNoise(albumentations.ImageOnlyTransform):
    """Camera noise as an albumentations transform, e.g. for `augmentations=[...]` of ultralytics.

    Random numbers come from albumentations' generator, which the seed of a pipeline sets, combined with the seed of the
    DataLoader worker, so workers and epochs differ. Frames given as `images=` form a clip: they share the fixed pattern
    of one camera and have independent temporal noise. The transform can be serialized with `albumentations.to_dict`.

    Args:
        camera: see `SensorNoise`.
        p: probability that noise is applied to an image, 0 to 1.
        bits: see `ImageNoise`.
        options: keywords of `SensorNoise`: transfer, gain_db, exposure, strength, fixed_pattern, ...

    Raises:
        InputError: an option or an image that is not valid.

    Examples:
        >>> import numpy as np
        >>> from visaug.augment import AlbumentationsNoise
        >>> AlbumentationsNoise("sony_imx174")(image=np.full((8, 8, 3), 120, np.uint8))["image"].shape
        (8, 8, 3)
    """

    def __init__(
        self, camera: Source | Sequence[Source], p: float = 1.0, bits: int | None = None, **options: Any
    ):
        super().__init__(p=probability(p))
        self.camera, self.bits, self.options = camera, bits, options
        self.noise = ImageNoise(camera, bits=bits, **options)

    def apply(self, img: np.ndarray, noise_seed: int, **params: Any) -> np.ndarray:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(noise_seed)
            return self.noise(img)

    def apply_to_images(self, images: np.ndarray, *args: Any, noise_seed: int, **params: Any) -> np.ndarray:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(noise_seed)
            return self.noise.clip(images)

    def get_params(self) -> dict[str, Any]:
        word = self.py_random.getrandbits(62)
        worker = get_worker_info()  # workers start with copies of one generator
        return {"noise_seed": word if worker is None else derive_key(word, "worker", worker.seed) >> 2}

    def get_transform_init_args(self) -> dict[str, Any]:
        """What makes the same transform again, as JSON takes it."""
        camera = self.camera
        several = isinstance(camera, Sequence) and not isinstance(camera, str)
        plain = [_plain(one) for one in camera] if several else _plain(camera)  # type: ignore[arg-type]
        return {"camera": plain, "bits": self.bits, **self.options}


def _plain(camera: Source) -> str | dict[str, Any]:
    """A camera as JSON takes it: a name stays one, everything else becomes the content of its file."""
    if isinstance(camera, str) and not Path(camera).is_file():
        return camera
    if isinstance(camera, Mapping):
        return dict(camera)
    return Camera.load(camera).to_dict()


def _signature() -> inspect.Signature:
    """The options by name. Without a schema albumentations passes keywords on as they are; its help shows the signature."""
    options = [
        parameter
        for parameter in inspect.signature(SensorNoise).parameters.values()
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY
    ]
    own = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default)
        for name, default in (("p", 1.0), ("bits", None))
    ]
    camera = inspect.Parameter("camera", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    bare = [option.replace(annotation=inspect.Parameter.empty) for option in options]
    return inspect.Signature([camera, *own, *bare])


AlbumentationsNoise.__signature__ = _signature()  # type: ignore[attr-defined]
