"""Changes of the training images by an arm of a study, as configured."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator

Share = Annotated[float, Field(ge=0, le=1)]


def ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"expected [low, high], got {list(pair)}")
    return pair


Pair = Annotated[tuple[float, float], AfterValidator(ordered)]  # low, high
Positive = Annotated[float, Field(gt=0, le=1e3)]
Seed = Annotated[int, Field(ge=0, lt=2**31)]  # ultralytics and NumPy take no other
Count = Annotated[int, Field(ge=0, le=100)]
NotNegative = Annotated[float, Field(ge=0, le=1e3)]
SharePair = Annotated[tuple[Share, Share], AfterValidator(ordered)]
PositivePair = Annotated[tuple[Positive, Positive], AfterValidator(ordered)]
Counts = Annotated[tuple[Count, Count], AfterValidator(ordered)]
Amounts = Annotated[tuple[NotNegative, NotNegative], AfterValidator(ordered)]


class ConfigSection(BaseModel):
    """A part of a config; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Blur(ConfigSection):
    """Gaussian blur."""

    p: Share = 0.1
    sigma_px: Amounts = (0.3, 1.0)


class Gaussian(ConfigSection):
    """White Gaussian noise."""

    p: Share = 0.5
    std: Amounts = Field((0.0, 0.02), description="of full scale, drawn per image")


class Vis(ConfigSection):
    """The sensor noise.

    Attributes:
        camera: a camera's file or shipped name, or a list of these: a population, of which each image gets one.
        set: values of the camera by path, which are then not randomised.
        effects: added to the camera. A number may be a pair [low, high], drawn uniformly for each image; `p` is the
            share of the images that have the effect.
        gain_db, exposure, strength, full_scale_photons: as in `visaug.VISNoise`; left out, the camera's own.
        white_std_present: white noise that the images carry already (1 is full scale); its variance is taken off the
            read noise.
    """

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
    set: dict[str, float | str] = {}
    effects: list[dict[str, Any]] = []
    white_std_present: Share = 0.0

    @property
    def cameras(self) -> list[str]:
        """The population's files or names."""
        return [self.camera] if isinstance(self.camera, str) else self.camera

    @field_validator("effects")
    @classmethod
    def _effects_have_names(cls, effects: list[dict[str, Any]]) -> list[dict[str, Any]]:
        for number, entry in enumerate(effects):
            if not isinstance(entry.get("name"), str):
                raise ValueError(f"entry {number} has no name; expected {{name: row_noise, sigma_e: 2}}")
            p = entry.get("p", 1.0)
            if isinstance(p, bool) or not isinstance(p, int | float) or not 0 <= p <= 1:
                raise ValueError(f"{entry['name']}.p: expected a share in [0, 1], got {p!r}")
        return effects


class White(Vis):
    """White Gaussian noise of a camera's variance.

    `variance: eq6` is the paper's eq. 6 at the image's mean level. `sensor` is the variance, image by image, of the
    sensor noise that a `vis` with these keys would add: the two arms then differ in the noise's structure alone.
    """

    variance: Literal["eq6", "sensor"] = "eq6"


class Erase(ConfigSection):
    """Random erasing (Z. Zhong et al., AAAI 2020): a rectangle of an image filled with uniform noise."""

    p: Share = 0.5
    area: SharePair = (0.02, 0.33)
    aspect: PositivePair = (0.3, 3.3)


class SunFlareOptions(ConfigSection):
    """A bright disc with a halo and ghosts on the line through the image's centre, as Albumentations' RandomSunFlare."""

    p: Share = 0.5
    radius: PositivePair = Field((0.05, 0.3), description="of the source's halo, of the image's longer side")
    ghosts: Counts = (3, 7)


class BrightnessContrastOptions(ConfigSection):
    """x -> (1 + c) x + b, with c and b uniform within the limits."""

    p: Share = 0.5
    brightness: float = Field(0.2, ge=0, le=1)
    contrast: float = Field(0.2, ge=0, le=1)


class MotionBlurOptions(ConfigSection):
    """Blur along a line of random length and angle."""

    p: Share = 0.5
    length_px: Amounts = (3.0, 7.0)


class IsoNoiseOptions(ConfigSection):
    """Albumentations' ISONoise on luminance: Poisson noise scaled by the image's own standard deviation, fading out
    towards white.
    """

    p: Share = 0.5
    intensity: Amounts = (0.1, 0.5)


class RandConvOptions(ConfigSection):
    """A random convolution (Z. Xu et al., ICLR 2021), mixed with the image: a x + (1 - a) k * x, a uniform."""

    p: Share = 0.5
    kernels: list[int] = [1, 3, 5, 7]

    @field_validator("kernels")
    @classmethod
    def _odd(cls, kernels: list[int]) -> list[int]:
        if not kernels or any(k < 1 or k % 2 == 0 for k in kernels):
            raise ValueError("expected odd sizes such as [1, 3, 5, 7]")
        return kernels


class CorruptionsOptions(ConfigSection):
    """One corruption for each image, in the manner of D. Hendrycks and T. Dietterich (ICLR 2019): contrast, pixelation,
    posterisation, impulse noise, speckle noise or defocus.
    """

    p: Share = 0.5
    severity: SharePair = Field((0.2, 1.0), description="0 does nothing, 1 is the strongest")


class Arm(ConfigSection):
    """What a run does to its training images.

    `like` names an arm whose values are used where none are given.
    """

    like: str | None = None
    why: str | None = None
    sun_flare: SunFlareOptions | None = None
    motion_blur: MotionBlurOptions | None = None
    blur: Blur | None = None
    vis: Vis | None = None
    white: White | None = None
    iso_noise: IsoNoiseOptions | None = None
    gaussian: Gaussian | None = None
    brightness_contrast: BrightnessContrastOptions | None = None
    randconv: RandConvOptions | None = None
    corruptions: CorruptionsOptions | None = None
    erase: Erase | None = None
    clean_epochs: int = Field(
        default=0,
        ge=0,
        description="the last epochs of a run, trained without all of this, as close_mosaic does for mosaics",
    )
    training: dict[str, Any] = {}

    @property
    def camera_files(self) -> list[str]:
        """The cameras whose values decide this arm's noise."""
        return [name for part in (self.vis, self.white) if part is not None for name in part.cameras]
