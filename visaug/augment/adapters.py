"""A camera's noise where other libraries expect it: DataLoader workers, torchvision v2, albumentations.

All of these take 8-bit and 16-bit images too, and give them back in their own depth.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from visaug.augment.sensor_noise import SensorNoise, Source
from visaug.errors import InputError

DEPTHS = {torch.uint8: 8, torch.uint16: 16}


def to_unit(image: Tensor, bits: int | None) -> Tensor:
    """Whole numbers of `bits` (as the type has, where None) as float32 in [0, 1]; floats as they are."""
    if image.dtype.is_floating_point:
        return image
    if image.dtype not in DEPTHS:
        raise InputError(f"an image has type {image.dtype}", expected="float, uint8 or uint16")
    return image.float() / (2 ** (bits or DEPTHS[image.dtype]) - 1)


def from_unit(image: Tensor, dtype: torch.dtype, bits: int | None) -> Tensor:
    """The inverse of `to_unit`, rounded."""
    if dtype.is_floating_point:
        return image.to(dtype)
    return (image * (2 ** (bits or DEPTHS[dtype]) - 1)).round().to(dtype)


class ImageNoise:
    """A plain callable on one image, for a dataset's `transform`.

    Follows `torch.manual_seed`; every DataLoader worker has a stream of its own, the same at every run.

    Args:
        camera, options: see `SensorNoise`.
        p: probability that an image is taken by the camera.
        bits: depth of images of whole numbers, where it is less than their type's: 10, 12 or 14 bit in uint16.

    Shape:
        tensor (C, H, W), or NumPy array (H, W) or (H, W, C); uint8, uint16 or float in [0, 1] -> the same.
    """

    def __init__(
        self, camera: Source | Sequence[Source], p: float = 1.0, bits: int | None = None, **options: Any
    ):
        self.noise = SensorNoise(camera, **options)
        self.p, self.bits = p, bits

    def __call__(self, image: Any) -> Any:
        if torch.rand(()) >= self.p:
            return image
        if isinstance(image, np.ndarray):
            return self._array(image)
        return self._tensor(image)

    def _tensor(self, image: Tensor) -> Tensor:
        with torch.no_grad():
            noisy = self.noise(to_unit(image, self.bits)[None])[0]
        return from_unit(noisy, image.dtype, self.bits)

    def _array(self, image: np.ndarray) -> np.ndarray:
        planes = image[..., None] if image.ndim == 2 else image
        tensor = torch.from_numpy(np.ascontiguousarray(planes.transpose(2, 0, 1)))
        return self._tensor(tensor).numpy().transpose(1, 2, 0).reshape(image.shape)


def __getattr__(name: str) -> Any:
    makers = {"TorchvisionNoise": _torchvision_noise, "AlbumentationsNoise": _albumentations_noise}
    if name not in makers:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = makers[name]()
    globals()[name] = value
    return value


def _torchvision_noise() -> type:
    from torchvision.transforms import v2

    class TorchvisionNoise(v2.Transform):
        """A camera's noise as a torchvision v2 transform: images and videos change, boxes and masks do not.

        Args:
            camera, p, bits, options: see `ImageNoise`.
        """

        _transformed_types = (v2.functional.is_pure_tensor, _image_type(), _video_type())

        def __init__(
            self, camera: Source | Sequence[Source], p: float = 1.0, bits: int | None = None, **options: Any
        ):
            super().__init__()
            self.noise = SensorNoise(camera, **options)
            self.p, self.bits = p, bits

        def make_params(self, flat_inputs: list[Any]) -> dict[str, Any]:
            """One decision, and one draw, for all images of a sample."""
            return {"take": bool(torch.rand(()) < self.p), "draws": self.noise.draw(1)}

        def transform(self, inpt: Any, params: dict[str, Any]) -> Any:
            if not params["take"]:
                return inpt
            from torchvision import tv_tensors

            images = inpt.as_subclass(Tensor)
            batch = images.reshape(-1, *images.shape[-3:])
            draws = params["draws"]
            if len(batch) > 1:  # frames of a video: one camera, noise of their own
                keys = self.noise.draw(len(batch))["keys"]
                draws = {name: value.expand(len(batch)) for name, value in draws.items()} | {"keys": keys}
            with torch.no_grad():
                noisy = self.noise.apply_draws(to_unit(batch, self.bits), draws)
            whole = from_unit(noisy, images.dtype, self.bits).reshape(images.shape)
            return tv_tensors.wrap(whole, like=inpt)  # pyright: ignore[reportCallIssue]

    return _at_home(TorchvisionNoise)


def _image_type() -> type:
    from torchvision import tv_tensors

    return tv_tensors.Image


def _video_type() -> type:
    from torchvision import tv_tensors

    return tv_tensors.Video


def _albumentations_noise() -> type:
    import albumentations

    class AlbumentationsNoise(albumentations.ImageOnlyTransform):
        """A camera's noise as an albumentations transform, e.g. for ultralytics' `augmentations=[...]`.

        Its random numbers come from albumentations' own generator, which a pipeline seeds for each worker.

        Args:
            camera, options: see `SensorNoise`.
            p: probability for each image.
            bits: see `ImageNoise`.
        """

        class InitSchema(albumentations.ImageOnlyTransform.InitSchema):
            camera: Any
            bits: int | None
            options: dict[str, Any] | None

        def __init__(
            self,
            camera: Source | Sequence[Source],
            p: float = 1.0,
            bits: int | None = None,
            options: dict[str, Any] | None = None,
        ):
            super().__init__(p=p)
            self.camera, self.bits, self.options = camera, bits, options
            self.noise = ImageNoise(camera, bits=bits, **(options or {}))

        def apply(self, img: np.ndarray, seed: int, **params: Any) -> np.ndarray:
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(seed)
                return self.noise(img)

        def get_params(self) -> dict[str, Any]:
            return {"seed": self.py_random.getrandbits(62)}

        def get_transform_init_args_names(self) -> tuple[str, ...]:
            return ("camera", "bits", "options")

    return _at_home(AlbumentationsNoise)


def _at_home(made: type) -> type:
    """Lets a class made in a function be pickled by its name, as DataLoader's workers need."""
    made.__qualname__ = made.__name__
    return made
