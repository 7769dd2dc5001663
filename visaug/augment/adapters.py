"""Camera noise as transforms of other libraries: DataLoader workers, torchvision v2, albumentations.

All of these accept PIL images, NumPy arrays or tensors with 8 bits, 16 bits or floats, as the library does, and return the
same type and depth; see `visaug.augment.images`.
"""

import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import get_worker_info

from visaug.augment.images import frames_draws, like, say_what_auto_means, take, to_tensor
from visaug.augment.sensor_noise import SensorNoise, Source
from visaug.camera import Camera
from visaug.errors import InputError
from visaug.sampling import derive_key


class ImageNoise:
    """A callable that adds camera noise to one image, for a dataset's `transform`.

    Random numbers follow `torch.manual_seed`. Each DataLoader worker has its own stream, and a seeded run is reproducible.

    Args:
        camera: see `SensorNoise`.
        p: probability that noise is applied to an image, 0 to 1.
        bits: number of bits used in uint16 data if fewer than 16: 10, 12 or 14.
        options: keywords of `SensorNoise`. With transfer="auto", 8-bit colour images are taken as sRGB, all others as
            linear.

    Shape:
        PIL image, tensor (C, H, W), or array (H, W) or (H, W, C); uint8, uint16 or float in [0, 1] -> the same. C is 1 or
        3, or 2 or 4 with an alpha channel, which is not changed.

    Raises:
        InputError: an option or an image that is not valid.

    Example:
        >>> import numpy as np
        >>> from visaug.augment import ImageNoise
        >>> ImageNoise("sony_imx174", transfer="srgb")(np.full((8, 8, 3), 120, np.uint8)).shape
        (8, 8, 3)
    """

    def __init__(
        self, camera: Source | Sequence[Source], p: float = 1.0, bits: int | None = None, **options: Any
    ):
        self.noise = SensorNoise(camera, **options)
        say_what_auto_means(self.noise)
        self.p, self.bits = _probability(p), _bits(bits)

    def __call__(self, image: Any) -> Any:
        tensor = to_tensor(image)
        if torch.rand(()) >= self.p:
            return image
        return like(take(self.noise, tensor[None], self.noise.draw(1), self.bits)[0], image)

    def clip(self, images: np.ndarray) -> np.ndarray:
        """Adds noise to the frames of one clip, (T, H, W) or (T, H, W, C): same fixed pattern, independent temporal noise."""
        if not len(images):
            return images
        batch = torch.stack([to_tensor(image) for image in images])
        noisy = take(self.noise, batch, frames_draws(self.noise, len(batch)), self.bits)
        return np.stack([like(one, image) for one, image in zip(noisy, images)])

    def __repr__(self) -> str:
        return f"ImageNoise({self.noise!r}, p={self.p}, bits={self.bits})"


def __getattr__(name: str) -> Any:
    makers = {"TorchvisionNoise": _torchvision_noise, "AlbumentationsNoise": _albumentations_noise}
    if name not in makers:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = makers[name]()
    globals()[name] = value
    return value


def _torchvision_noise() -> type:
    import PIL.Image
    from torchvision import tv_tensors
    from torchvision.transforms import v2

    class TorchvisionNoise(v2.Transform):
        """Camera noise as a torchvision v2 transform: images and videos change, boxes and masks do not.

        The frames of a video share the fixed pattern of one camera and have independent temporal noise.

        Args:
            camera: see `SensorNoise`.
            p: probability that noise is applied to a sample, 0 to 1.
            bits: see `ImageNoise`.
            options: keywords of `SensorNoise`.

        Raises:
            InputError: a sample without a PIL image, tensor or video, for example a NumPy array alone.

        Example:
            >>> import torch
            >>> from visaug.augment import TorchvisionNoise
            >>> TorchvisionNoise("sony_imx174")(torch.rand(1, 32, 32)).shape
            torch.Size([1, 32, 32])
        """

        _transformed_types = (
            v2.functional.is_pure_tensor,
            PIL.Image.Image,
            tv_tensors.Image,
            tv_tensors.Video,
        )

        def __init__(
            self, camera: Source | Sequence[Source], p: float = 1.0, bits: int | None = None, **options: Any
        ):
            super().__init__()
            self.noise = SensorNoise(camera, **options)
            say_what_auto_means(self.noise)
            self.p, self.bits = _probability(p), _bits(bits)

        def check_inputs(self, flat_inputs: list[Any]) -> None:
            if not v2._utils.has_any(flat_inputs, *self._transformed_types):
                kinds = ", ".join(sorted({type(one).__name__ for one in flat_inputs}))
                raise InputError(
                    f"a sample contains no image, only {kinds}",
                    expected="a PIL image, a tensor or a tv_tensor; put v2.ToImage() before the noise",
                )

        def make_params(self, flat_inputs: list[Any]) -> dict[str, Any]:
            """One decision, and one draw, for all images of a sample."""
            return {"take": bool(torch.rand(()) < self.p), "draws": self.noise.draw(1)}

        def transform(self, inpt: Any, params: dict[str, Any]) -> Any:
            if not params["take"]:
                return inpt
            if isinstance(inpt, PIL.Image.Image):
                return like(take(self.noise, to_tensor(inpt)[None], params["draws"], self.bits)[0], inpt)
            images = inpt.as_subclass(Tensor)
            batch = (images[None] if images.ndim == 2 else images).reshape(-1, *images.shape[-3:])
            draws = params["draws"]
            if len(batch) > 1:  # frames of a video: one camera, noise of their own
                keys = self.noise.draw(len(batch))["keys"]
                draws = {name: value.expand(len(batch)) for name, value in draws.items()} | {"keys": keys}
            noisy = take(self.noise, batch, draws, self.bits).reshape(images.shape)
            return tv_tensors.wrap(noisy, like=inpt)  # pyright: ignore[reportCallIssue]

    return _at_home(TorchvisionNoise)


def _albumentations_noise() -> type:
    import albumentations

    options = {
        name: parameter.default
        for name, parameter in inspect.signature(SensorNoise).parameters.items()
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY
    }
    own = {"p": 1.0, "bits": None}

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

        Example:
            >>> import numpy as np
            >>> from visaug.augment import AlbumentationsNoise
            >>> AlbumentationsNoise("sony_imx174")(image=np.full((8, 8, 3), 120, np.uint8))["image"].shape
            (8, 8, 3)
        """

        def __init__(
            self, camera: Source | Sequence[Source], p: float = 1.0, bits: int | None = None, **options: Any
        ):
            super().__init__(p=_probability(p))
            self.camera, self.bits, self.options = camera, bits, options
            self.noise = ImageNoise(camera, bits=bits, **options)

        def apply(self, img: np.ndarray, noise_seed: int, **params: Any) -> np.ndarray:
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(noise_seed)
                return self.noise(img)

        def apply_to_images(
            self, images: np.ndarray, *args: Any, noise_seed: int, **params: Any
        ) -> np.ndarray:
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

    # Without a schema albumentations passes keywords on as they are; the signature names them for its help.
    parameters = [
        inspect.Parameter("camera", inspect.Parameter.POSITIONAL_OR_KEYWORD),
        *(
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default)
            for name, default in {**own, **options}.items()
        ),
    ]
    AlbumentationsNoise.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return _at_home(AlbumentationsNoise)


def _plain(camera: Source) -> str | dict[str, Any]:
    """A camera as JSON takes it: a name stays one, everything else becomes the content of its file."""
    if isinstance(camera, str) and not Path(camera).is_file():
        return camera
    if isinstance(camera, Mapping):
        return dict(camera)
    return Camera.load(camera).to_dict()


def _probability(p: float) -> float:
    if not 0 <= p <= 1:
        raise InputError(f"{p} is not a probability", field="p", expected="0 to 1")
    return float(p)


def _bits(bits: int | None) -> int | None:
    if bits is not None and not 1 <= bits <= 16:
        raise InputError(f"{bits} bit", field="bits", expected="1 to 16, the depth of data in uint16 words")
    return bits


def _at_home(made: type) -> type:
    """Lets a class made in a function be pickled by its name, as DataLoader's workers need."""
    made.__qualname__ = made.__name__
    return made
