"""Changes of the training images by an arm of a study, as configured."""

from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from visaug_train import batch_noise
from visaug_train.sections import ConfigSection, Pair, Share


class Vis(ConfigSection):
    """The sensor noise. What is not said here is as in `visaug.VISNoise`; left out, the camera's own."""

    # a file or shipped name, or a list of these: a population, of which each image gets one
    camera: str | list[str]
    p: Share = 1.0
    resolution: Literal["network", "sensor"] = "network"
    fixed_pattern: Literal["image", "camera"] = "image"
    transfer: Literal["auto", "linear", "srgb"] = "linear"
    black_level: Literal["subtract", "keep"] = "subtract"
    gain_db: float | Pair | None = None
    exposure: float | Pair | None = None
    strength: float | None = None
    full_scale_photons: float | None = None
    set: dict[str, float | str] = Field({})  # values of the camera by path, which are then not randomised
    # added to the camera. A number may be a pair [low, high], drawn uniformly for each image; `p` is the share of the images
    # that have the effect.
    effects: list[dict[str, Any]] = Field([])
    # white noise that the images carry already (1 is full scale); its variance is taken off the read noise, at the gain of `set`
    # or `gain_db`, of a pair at its middle
    white_std_present: Share = 0.0

    @property
    def cameras(self) -> list[str]:
        return [self.camera] if isinstance(self.camera, str) else self.camera

    @field_validator("camera")
    @classmethod
    def _some_camera(cls, camera: str | list[str]) -> str | list[str]:
        if not camera:
            raise ValueError("is empty; expected a camera's file or shipped name, or a list of these")
        return camera

    @field_validator("effects")
    @classmethod
    def _effects_have_names(cls, effects: list[dict[str, Any]]) -> list[dict[str, Any]]:
        names = [entry.get("name") for entry in effects]
        for number, entry in enumerate(effects):
            if not isinstance(entry.get("name"), str):
                raise ValueError(f"entry {number} has no name; expected {{name: row_noise, sigma_e: 2}}")
            p = entry.get("p", 1.0)
            if isinstance(p, bool) or not isinstance(p, int | float) or not 0 <= p <= 1:
                raise ValueError(f"{entry['name']}.p: expected a share in [0, 1], got {p!r}")
            if names.count(entry["name"]) > 1:
                raise ValueError(f"{entry['name']} is listed twice; expected each effect once")
        return effects


class White(Vis):
    """White Gaussian noise of a camera's variance.

    `variance: eq6` is the paper's eq. 6 at the image's mean level, of a camera whose values `set` can change; the other keys
    of `vis` have no part in it and are refused. `sensor` is the variance, image by image, of the
    sensor noise that a `vis` with these keys would add: the two arms then differ in the noise's structure alone.
    """

    variance: Literal["eq6", "sensor"] = "eq6"

    @model_validator(mode="after")
    def _eq_6_takes_values_alone(self) -> "White":
        if self.variance == "eq6":
            taken = {"variance", "camera", "p", "set", "white_std_present"}
            for key in self.model_fields_set - taken:
                if getattr(self, key) != type(self).model_fields[key].default:
                    raise ValueError(
                        f"{key} has no part in eq. 6; expected `variance: sensor`, or values of the camera by `set`, such as "
                        "`set: {gain_db: 30}`"
                    )
        return self


class Arm(ConfigSection):
    """What a run does to its training images, in the order of the fields: optics, sensor, additions to the picture, occlusions.

    `like` names an arm whose values are used where none are given.
    """

    like: str | None = None
    why: str | None = None
    sun_flare: batch_noise.SunFlare | None = None
    motion_blur: batch_noise.RandomMotionBlur | None = None
    blur: batch_noise.GaussianBlur | None = None
    vis: Vis | None = None
    white: White | None = None
    gaussian: batch_noise.GaussianNoise | None = None
    iso_noise: batch_noise.IsoNoise | None = None
    brightness_contrast: batch_noise.BrightnessContrast | None = None
    randconv: batch_noise.RandConv | None = None
    corruptions: batch_noise.Corruptions | None = None
    erase: batch_noise.RandomErase | None = None
    # the last epochs of a run, trained without all of this, as close_mosaic does for mosaics
    clean_epochs: int = Field(default=0, ge=0)
    training: dict[str, Any] = Field({})

    @property
    def camera_files(self) -> list[str]:
        """The cameras whose values decide this arm's noise."""
        return [name for part in (self.vis, self.white) if part is not None for name in part.cameras]
