"""What an effect is: a name, a place in the chain, parameters with units and bounds, and `apply`."""

from dataclasses import dataclass, field
from enum import IntEnum
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from visaug.effects.parameter import Parameter, check_value
from visaug.errors import InputError
from visaug.sampling import Stream, derive_key


class Stage(IntEnum):
    """Places in the chain, in the order of physics. The signal's unit at each is the one that `apply` gets and gives."""

    OPTICS = 1  # mean photons per pixel, on their way to the sensor
    GENERATION = (
        2  # mean electrons per pixel and exposure: photo-electrons and dark electrons, before shot noise
    )
    CHARGE = 3  # electrons counted in the pixel: after shot noise, while stored, shared and transferred
    READOUT = 4  # electrons, as the voltage that stands for them: amplifiers and lines, before the converter
    DIGITAL = 5  # DN of the converter
    PICTURE = (
        6  # the developed picture in [0, 1], encoded as it is shown; frames of a frame set end before it
    )


@dataclass
class Context:
    """What an effect may need to know beyond the signal.

    All tensors are (B, 1, 1, 1) and broadcast against the signal (B, C, H, W).
    """

    exposure_s: Tensor
    temperature_c: Tensor
    gain_e_per_dn: Tensor  # at the gain in use, after gain_db
    black_level_dn: Tensor
    full_well_e: Tensor
    quantum_efficiency: Tensor
    dark_current_e: Tensor  # mean dark electrons of the exposure, t a exp(b T)
    bit_depth: int
    reading: str  # "physical" or "paper"
    resolution: tuple[int, int]  # rows, columns of the whole sensor
    window: tuple[range, range]  # rows and columns of it that the images show
    sequence: bool = False  # True: the batch is consecutive frames of one camera; False: unrelated images
    memory: dict[str, Tensor] = field(default_factory=dict)  # carried from batch to batch of a sequence
    maps: dict[str, Tensor] = field(default_factory=dict)  # measured patterns of the whole sensor, by effect

    @property
    def max_dn(self) -> int:
        return 2**self.bit_depth - 1

    def measured_map(self, effect: str, like: Tensor) -> Tensor | None:
        """The window's part of an effect's measured pattern, (1, 1, H, W); None where the camera has none.

        A window that reaches beyond the sensor sees the pattern repeated.
        """
        whole = self.maps.get(effect)
        if whole is None:
            return None
        whole = whole.to(like.device)
        rows, columns = (torch.arange(r.start, r.stop, device=like.device) for r in self.window)
        return whole[rows % whole.shape[0]][:, columns % whole.shape[1]][None, None]

    def rows(self, like: Tensor) -> Tensor:
        """Row numbers on the sensor, (1, 1, H, 1)."""
        return torch.arange(self.window[0].start, self.window[0].stop, device=like.device).view(1, 1, -1, 1)

    def columns(self, like: Tensor) -> Tensor:
        """Column numbers on the sensor, (1, 1, 1, W)."""
        return torch.arange(self.window[1].start, self.window[1].stop, device=like.device).view(1, 1, 1, -1)


@dataclass(frozen=True)
class Look:
    """What meets the eye in measured frames.

    Args:
        dark_e: (H, W) mean frame of the shortest dark exposure, less its mean, electrons.
        rows, columns: (H,), (W,), where each of its lines begins, as a share of the sensor.
        codes: every DN that comes in any frame, rising.
        row_noise_e: (n, h), means of consecutive rows of short dark frames, less those of all, electrons; n is 0 where it is one.
        tracks: (n, 2), pixels, and electrons in all of them, of each place that is bright in one dark frame alone.
        searched_mpx_s: 10^6 pixels times seconds that were searched for these.
        spilled_e: (n, 3), of each column of a known scene that holds more than the full well: the electrons that it holds more, and
            those that the pixels above it and below it were filled with.
    """

    dark_e: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    codes: np.ndarray
    row_noise_e: np.ndarray
    tracks: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    searched_mpx_s: float = 0.0
    spilled_e: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def profiles(self) -> tuple[tuple[str, np.ndarray, np.ndarray], ...]:
        """Of columns and of rows: which, their means (e-), and where they begin."""
        return ("columns", self.dark_e.mean(0), self.columns), ("rows", self.dark_e.mean(1), self.rows)


# What an effect meets where it is called without a camera.
CONDITIONS = {
    "exposure_s": 0.01,
    "temperature_c": 20.0,
    "gain_e_per_dn": 1.0,
    "black_level_dn": 0.0,
    "full_well_e": float("inf"),
    "quantum_efficiency": 1.0,
    "dark_current_e": 0.0,
    "bit_depth": 16,
}


def _as_value(value: float, like: Tensor) -> Tensor:
    """As the chain hands numbers to an effect."""
    return torch.as_tensor(value, dtype=torch.float32, device=like.device).reshape(1, 1, 1, 1)


class Effect:
    """One physical effect. A subclass states `name`, `stage`, `Parameter`s and `apply`; that is all a new effect takes.

    Class attributes:
        name: the name in a camera file and in reports.
        stage, order: place in the chain; within a stage, effects act in rising `order`.
        summary: one sentence; equation: the law, in plain text; source: where it is from.
        differentiable: whether gradients pass to the image and all continuous parameters; if not, `why_not` says why.
        base: True for the terms of the base chain, whose values stand at the top level of a camera file.
        separates: what to measure to tell this effect from its look-alikes, in words (optional).
        proposed: whether a diagnosis tries the effect of its own accord; never one of stage PICTURE, which frames do not show.
        map_unit: unit of a measured map that may take the place of the effect's own spatial profile and strength
            (`map: file` in a camera file, `context.measured_map` in `apply`); empty where it takes none.
        map_low: least value that such a map may hold.
        map_is_table: True where the map is a list of numbers and no pattern of the sensor.
    """

    name: ClassVar[str] = ""
    stage: ClassVar[Stage]
    order: ClassVar[int] = 50
    summary: ClassVar[str] = ""
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    differentiable: ClassVar[bool] = True
    why_not: ClassVar[str] = ""
    base: ClassVar[bool] = False
    separates: ClassVar[str] = ""
    proposed: ClassVar[bool] = True
    map_unit: ClassVar[str] = ""
    map_low: ClassVar[float] = float("-inf")
    map_is_table: ClassVar[bool] = False
    parameters: ClassVar[dict[str, Parameter]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        own = {key: value for key, value in vars(cls).items() if isinstance(value, Parameter)}
        cls.parameters = {**cls.parameters, **own}

    def __init__(self, **given: Any):
        """An effect with these parameters; those left out have their defaults.

        Raises:
            InputError: a parameter that the effect does not have, or a value outside its bounds.
        """
        for key, value in given.items():
            if key not in self.parameters:
                expected = f"one of {', '.join(self.parameters) or 'none'}"
                raise InputError(f"is not a parameter of {self.name}", field=key, expected=expected)
            if value != self.parameters[key].default:  # which may be infinite: a full well that is left out
                check_value(self.parameters[key], value, f"{self.name}.{key}")
        self.given = given

    def __call__(
        self, signal: Tensor, seed: int = 0, camera_seed: int = 0, sequence: bool = False, **conditions: float
    ) -> Tensor:
        """Applies this effect alone, with no camera around it.

        Args:
            signal: (B, C, H, W), (C, H, W) or (H, W), in the unit of the effect's stage (`Stage`): photons, electrons or DN.
            seed: of the random numbers of each image; image k of a batch gets its own stream.
            camera_seed: of the fixed pattern, which all images of the call share.
            sequence: True: the batch is consecutive frames, which effects with memory need.
            conditions: what the effect may ask of the camera: exposure_s (0.01), temperature_c (20), gain_e_per_dn (1),
                black_level_dn (0), full_well_e (infinite), quantum_efficiency (1), dark_current_e (0), bit_depth (16).

        Returns:
            A tensor of the same shape and dtype.

        Raises:
            InputError: a condition that is not known, or a signal of another shape.

        Example:
            >>> import torch, visaug
            >>> electrons = torch.full((64, 64), 500.0)
            >>> noisy = visaug.effects.RowNoise(sigma_e=1.5)(electrons, seed=0)
            >>> noisy.shape
            torch.Size([64, 64])
        """
        unknown = set(conditions) - set(CONDITIONS)
        if unknown:
            raise InputError(
                "is not a condition", field=min(unknown), expected=f"one of {', '.join(CONDITIONS)}"
            )
        if not 2 <= signal.ndim <= 4:
            raise InputError(
                f"signal has shape {tuple(signal.shape)}", expected="(B, C, H, W), (C, H, W) or (H, W)"
            )
        batch = signal.float().reshape((1,) * (4 - signal.ndim) + tuple(signal.shape))
        p = SimpleNamespace(
            **{
                key: value if isinstance(value, str) else _as_value(value, signal)
                for key, value in self.values().items()
            }
        )
        known = {**CONDITIONS, **conditions}
        window = (range(batch.shape[2]), range(batch.shape[3]))
        bit_depth = int(known.pop("bit_depth"))
        numbers: dict[str, Any] = {key: _as_value(value, signal) for key, value in known.items()}
        size = (batch.shape[2], batch.shape[3])
        context = Context(
            **numbers,
            bit_depth=bit_depth,
            reading="physical",
            resolution=size,
            window=window,
            sequence=sequence,
        )
        if {"a_e_per_s", "b_per_c"} <= set(
            self.parameters
        ):  # the dark current's own law gives the context its mean
            context.dark_current_e = (
                context.exposure_s * p.a_e_per_s * torch.exp(p.b_per_c * context.temperature_c)
            )
        keys = [derive_key(seed, "image", k) for k in range(len(batch))]
        stream = Stream(
            keys, [derive_key(camera_seed, "camera")] * len(batch), batch.shape[1], window, signal.device
        )
        return self.apply(batch, p, stream, context).reshape(signal.shape).to(signal.dtype)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({', '.join(f'{key}={value!r}' for key, value in self.values().items())})"
        )

    def values(self) -> dict[str, Any]:
        """Every parameter with the value in use: as given, or the default."""
        return {key: self.given.get(key, parameter.default) for key, parameter in self.parameters.items()}

    def apply(self, signal: Tensor, p: SimpleNamespace, stream: Stream, context: Context) -> Tensor:
        """The signal after the effect.

        Args:
            signal: (B, C, H, W) float32 in the stage's unit; must not be changed in place.
            p: the parameters' values by name: tensors (B, 1, 1, 1), or the word of a choice.
            stream: this effect's own random numbers; `stream.fixed` are the camera's, the same in every frame.
            context: exposure, temperature, gain, window and the like.

        Returns:
            A tensor of the same shape and unit.
        """
        raise NotImplementedError

    def moments(self, mean: Tensor, p: SimpleNamespace, context: Context) -> tuple[Tensor, Tensor] | None:
        """Mean and variance of the output over noise and cameras for a constant input `mean`; None where theory has none."""
        return None

    @classmethod
    def looks(cls, seen: Look) -> list[dict[str, Any]]:
        """Further values by parameter at which a diagnosis tries the effect, from a look at what was measured (optional)."""
        return []

    @classmethod
    def strengths(cls) -> tuple[str, ...]:
        """Names of the parameters that must all be zero for the effect to vanish."""
        return tuple(name for name, parameter in cls.parameters.items() if parameter.strength)
