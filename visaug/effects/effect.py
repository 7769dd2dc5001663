"""What an effect is: a name, a place in the chain, parameters with units and bounds, and `apply`."""

from dataclasses import dataclass, field
from enum import IntEnum
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from visaug.sampling import Stream


class Stage(IntEnum):
    """Places in the chain, in the order of physics. The signal's unit at each is the one that `apply` gets and gives."""

    OPTICS = 1  # mean photons per pixel, on their way to the sensor
    GENERATION = (
        2  # mean electrons per pixel and exposure: photo-electrons and dark electrons, before shot noise
    )
    CHARGE = 3  # electrons counted in the pixel: after shot noise, while stored, shared and transferred
    READOUT = 4  # electrons, as the voltage that stands for them: amplifiers and lines, before the converter
    DIGITAL = 5  # DN of the converter


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Args:
        default: the value where a camera file leaves it out.
        unit: e.g. "e-", "DN", "fraction", "px", "s", "e-/s"; "1" for a pure number.
        low, high: bounds; a value outside is refused, a random draw is truncated to them.
        source: paper, standard or datasheet that the parameter and its default come from.
        strength: True if the effect vanishes where this parameter is zero.
        trials: values at which a diagnosis first tries it, from weak to strong for a strength, all over the range for others.
        options: for a choice (no number): the allowed words. A choice has no bounds and is not randomised.
        integer: True where only whole numbers make sense; a random draw is rounded.
        of: words of the effect's choices that use this number; empty where all do. A fit leaves it alone under other words.
    """

    default: Any = 0.0
    unit: str = "1"
    low: float = 0.0
    high: float = float("inf")
    source: str = ""
    strength: bool = False
    trials: tuple = ()
    options: tuple[str, ...] = ()
    integer: bool = False
    of: tuple[str, ...] = ()
    name: str = field(default="", compare=False)

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, "name", name)


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
        row_noise_e: (n, H), means of the rows of each frame behind `dark_e`, less those of all, electrons; n is 0 where it is one.
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


class Effect:
    """One physical effect. A subclass states `name`, `stage`, `Parameter`s and `apply`; that is all a new effect takes.

    Class attributes:
        name: the name in a camera file and in reports.
        stage, order: place in the chain; within a stage, effects act in rising `order`.
        summary: one sentence; equation: the law, in plain text; source: where it is from.
        differentiable: whether gradients pass to the image and all continuous parameters; if not, `why_not` says why.
        base: True for the terms of the base chain, whose values stand at the top level of a camera file.
        separates: what to measure to tell this effect from its look-alikes, in words (optional).
        map_unit: unit of a measured map that may take the place of the effect's own spatial profile and strength
            (`map: file` in a camera file, `context.measured_map` in `apply`); empty where it takes none.
        map_low: least value that such a map may hold.
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
    map_unit: ClassVar[str] = ""
    map_low: ClassVar[float] = float("-inf")
    parameters: ClassVar[dict[str, Parameter]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        own = {key: value for key, value in vars(cls).items() if isinstance(value, Parameter)}
        cls.parameters = {**cls.parameters, **own}

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
