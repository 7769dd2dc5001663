"""From a camera to noisy images: kornia, torchvision, albumentations, plain callables and files.

Nothing heavy loads until it is used: kornia with `VISNoise`, torchvision and albumentations with their adapters.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from visaug.augment.albumentations_noise import AlbumentationsNoise
    from visaug.augment.draws import draws_from_json, draws_to_json
    from visaug.augment.exposure import (
        image_to_photons,
        irradiance_to_photons,
        linear_to_srgb,
        srgb_to_linear,
    )
    from visaug.augment.images import ImageNoise
    from visaug.augment.sensor_noise import SensorNoise
    from visaug.augment.torchvision_noise import TorchvisionNoise
    from visaug.augment.visnoise import VISNoise

_HOME = {
    "AlbumentationsNoise": "albumentations_noise",
    "ImageNoise": "images",
    "SensorNoise": "sensor_noise",
    "TorchvisionNoise": "torchvision_noise",
    "VISNoise": "visnoise",
    "draws_from_json": "draws",
    "draws_to_json": "draws",
    "image_to_photons": "exposure",
    "irradiance_to_photons": "exposure",
    "linear_to_srgb": "exposure",
    "srgb_to_linear": "exposure",
}

__all__ = ["AlbumentationsNoise", "ImageNoise", "SensorNoise", "TorchvisionNoise", "VISNoise"]
__all__ += ["draws_from_json", "draws_to_json", "image_to_photons", "irradiance_to_photons"]
__all__ += ["linear_to_srgb", "srgb_to_linear"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'visaug.augment' has no attribute {name!r}")
    value = getattr(import_module(f"visaug.augment.{_HOME[name]}"), name)
    globals()[name] = value
    return value
