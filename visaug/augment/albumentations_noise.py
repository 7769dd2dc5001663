"""Camera noise as an albumentations transform; imports albumentations."""

import inspect
from collections.abc import Iterator, Mapping, Sequence
from itertools import count, repeat
from pathlib import Path
from typing import Any

import albumentations
import numpy as np
import torch
from torch.utils.data import get_worker_info

from visaug.augment.draws import draws_from_json, draws_to_json, nth_frame
from visaug.augment.images import ImageNoise, channel_order, probability
from visaug.augment.sensor_noise import SensorNoise, Source
from visaug.augment.under_ultralytics import hook
from visaug.camera import Camera
from visaug.camera.maps import named_maps, set_map
from visaug.core.sampling import derive_key


class AlbumentationsNoise(albumentations.ImageOnlyTransform):
    """Camera noise as an albumentations transform, e.g. for `augmentations=[...]` of ultralytics.

    Random numbers come from albumentations' generator, which the seed of a pipeline sets, combined with the seed of the
    DataLoader worker, so workers and epochs differ. Frames given as `images=` form a clip: they share the fixed pattern
    of one camera and have independent temporal noise; so do the images of one call, `image` and those of
    `additional_targets`. The transform can be serialized with `albumentations.to_dict`. It reaches ultralytics' workers and
    resumed trainings, see `visaug.augment.under_ultralytics`.

    Args:
        camera: see `SensorNoise`.
        p: probability that noise is applied to an image, 0 to 1.
        bits: see `ImageNoise`.
        order: "RGB" or "BGR", see `ImageNoise`. None is RGB, and BGR under ultralytics, which passes that.
        options: keywords of `SensorNoise`: transfer, gain_db, exposure, strength, fixed_pattern, ...

    Raises:
        InputError: an option or an image that is not valid.

    Examples:
        >>> import numpy as np
        >>> from visaug.augment import AlbumentationsNoise
        >>> AlbumentationsNoise("sony_imx174")(image=np.full((8, 8, 3), 120, np.uint8))["image"].shape
        (8, 8, 3)
    """

    default_order = "RGB"  # where `order` is None

    def __init__(
        self,
        camera: Source | Sequence[Source],
        p: float = 1.0,
        bits: int | None = None,
        order: str | None = None,
        **options: Any,
    ):
        super().__init__(p=probability(p))
        self.camera, self.bits, self.options = camera, bits, options
        self.order = None if order is None else channel_order(order)
        self.noise = ImageNoise(camera, bits=bits, **options)
        hook(arrive)

    def apply_with_params(self, params: dict[str, Any], *args: Any, **kwargs: Any) -> dict[str, Any]:
        functions = [(self._key2func.get(key), value) for key, value in kwargs.items() if value is not None]
        frames = sum(len(value) for function, value in functions if function == self.apply_to_images)
        several = frames + sum(function == self.apply for function, _ in functions) > 1
        # all images of this call share a camera and its fixed pattern
        draws = draws_from_json(params["draws"])
        each = (nth_frame(draws, number) for number in count()) if several else repeat(draws)
        return super().apply_with_params({**params, "each": each}, *args, **kwargs)

    def apply(self, img: np.ndarray, each: Iterator[dict[str, torch.Tensor]], **params: Any) -> np.ndarray:
        return self.noise.noised(img, next(each), self._order)

    def apply_to_images(
        self, images: np.ndarray, *args: Any, each: Iterator[dict[str, torch.Tensor]], **params: Any
    ) -> np.ndarray:
        return np.stack([self.apply(image, each) for image in images]) if len(images) else images

    def described(self) -> str:
        """In one line: camera, options, order of the channels, probability."""
        return f"{type(self).__name__}({self.noise.noise.described()}, order={self._order!r}, p={self.p})"

    @property
    def _order(self) -> str:
        return self.order or self.default_order

    def get_params(self) -> dict[str, Any]:
        word = self.py_random.getrandbits(62)
        worker = get_worker_info()  # workers start with copies of one generator
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(word if worker is None else derive_key(word, "worker", worker.seed) >> 2)
            return {"draws": draws_to_json(self.noise.noise.draw(1))}  # a replay has them again

    def get_transform_init_args(self) -> dict[str, Any]:
        """What makes the same transform again, as JSON takes it."""
        hook(arrive)  # ultralytics asks for this before its training, and may be loaded since
        camera = self.camera
        several = isinstance(camera, Sequence) and not isinstance(camera, str)
        plain = [_plain(one) for one in camera] if several else _plain(camera)
        return {"camera": plain, "bits": self.bits, "order": self.order, **self.options}


def arrive(trainer: Any) -> None:
    """A callback of ultralytics that does nothing: where it is unpickled, albumentations knows the class above."""


def _plain(camera: Source) -> str | dict[str, Any]:
    """A camera as JSON takes it: a name stays one, everything else becomes the content of its file, with whole paths of maps."""
    if isinstance(camera, str) and not Path(camera).is_file():
        return camera
    if isinstance(camera, Mapping):
        return dict(camera)
    loaded = Camera.load(camera)
    content = loaded.to_dict()
    for name, key in named_maps(loaded.spec).values():
        set_map(content, key, str(((loaded.folder or Path()) / name).absolute()))
    return content


def _signature() -> inspect.Signature:
    """The options by name. Without a schema albumentations passes keywords on as they are; its help shows the signature."""
    one = inspect.Parameter
    further = inspect.signature(SensorNoise).parameters.values()
    options = {"p": 1.0, "bits": None, "order": None}
    options |= {p.name: p.default for p in further if p.kind is one.KEYWORD_ONLY}
    named = [one(name, one.KEYWORD_ONLY, default=default) for name, default in options.items()]
    return inspect.Signature([one("camera", one.POSITIONAL_OR_KEYWORD), *named])


AlbumentationsNoise.__signature__ = _signature()
hook(arrive)
