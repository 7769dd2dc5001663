"""The base class of effects: a name, a place in the chain, parameters with units and bounds, and `apply`."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from visaug.core.errors import InputError
from visaug.core.sampling import Stream, as_seed, derive_key
from visaug.effects.parameter import Parameter, check_value, plain, unused
from visaug.effects.parameter import Strength as Strength
from visaug.effects.parameter import choice as choice


class Values:
    """Values of an effect's parameters as attributes: tensors, and strings for options.

    A `types.SimpleNamespace` would do, but `torch.compile` cannot trace one.
    """

    def __init__(self, **values: Tensor | str):
        for name, value in values.items():
            setattr(self, name, value)

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...


class Stage(IntEnum):
    """Stages of the chain in physical order. Input and output of `apply` are in the unit of the stage."""

    OPTICS = 1  # mean photons per pixel, on their way to the sensor
    # mean electrons per pixel and exposure: photo-electrons and dark electrons, before shot noise
    GENERATION = 2
    CHARGE = 3  # electrons counted in the pixel: after shot noise, while stored, shared and transferred
    READOUT = 4  # electrons, as the voltage that stands for them: amplifiers and lines, before the converter
    DIGITAL = 5  # DN of the converter
    # the developed picture in [0, 1], encoded as it is shown; frames of a frame set end before it
    PICTURE = 6


@dataclass
class Context:
    """Operating conditions and geometry that an effect may use in addition to the signal.

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
        """The measured pattern of an effect within the window, (1, 1, H, W); None if the camera has none.

        Beyond the sensor the pattern is repeated.
        """
        if (whole := self.maps.get(effect)) is None:
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

    def places(self, direction: str, like: Tensor) -> tuple[Tensor, int]:
        """Numbers of the "columns" or of the "rows" on the sensor, and how many it has."""
        if direction == "columns":
            return self.columns(like), self.resolution[1]
        return self.rows(like), self.resolution[0]


@dataclass(frozen=True)
class FrameSummary:
    """Summaries of measured frames from which `Effect.looks` may derive starting values.

    Args:
        dark_e: (H, W) mean frame at the shortest dark exposure, minus its mean, electrons.
        rows: (H,) position at which each row begins, as a fraction of the sensor.
        columns: (W,) position at which each column begins, likewise.
        codes: all DN that occur in any frame, ascending.
        row_noise_e: (n, h) means of consecutive rows of n short dark frames, minus their mean over frames, electrons; n is 0 for
            a single frame.
        tracks: (n, 2) number of pixels, and sum of their electrons, of each place that is bright in a single dark frame.
        searched_mpx_s: 10^6 pixels times seconds that were searched for tracks.
        spilled_e: (n, 3) for each column of a known scene above the full well: electrons above the full well, and electrons
            found in the pixels above and below it.
        stuck: (n,) values of the pixels of `dark_e` that do not answer light: 0 is the black level, 1 the highest code, -1 code 0.
    """

    dark_e: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    codes: np.ndarray
    row_noise_e: np.ndarray
    tracks: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    searched_mpx_s: float = 0.0
    spilled_e: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    stuck: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def profiles(self) -> tuple[tuple[str, np.ndarray, np.ndarray], ...]:
        """Profiles of columns and of rows: direction, means (e-), positions."""
        return ("columns", self.dark_e.mean(0), self.columns), ("rows", self.dark_e.mean(1), self.rows)


# Conditions of an effect that is called without a camera.
CONDITIONS = {
    "exposure_s": Parameter(0.01, unit="s", high=1e5),
    "temperature_c": Parameter(20.0, unit="C", low=-150.0, high=150.0),
    "gain_e_per_dn": Parameter(1.0, unit="e-/DN", low=1e-6, high=1e6),
    "black_level_dn": Parameter(0.0, unit="DN", high=65535.0),
    "full_well_e": Parameter(math.inf, unit="e-"),
    "quantum_efficiency": Parameter(1.0, unit="e-/photon", low=1e-4, high=1.0),
    "dark_current_e": Parameter(0.0, unit="e-"),
    "bit_depth": Parameter(16, unit="bits", low=1, high=16, integer=True),
}


TEXTS = ("summary", "equation", "source", "why_not", "separates", "map_unit")


def is_surely(value: Tensor, number: float) -> bool:
    """Whether a parameter is this number in every image, so that what it would change need not be computed.

    False where telling would cost more than computing: of a value on a GPU, or while compiling. Also for one with a gradient.
    """
    if value.requires_grad or value.is_cuda or torch.compiler.is_compiling():
        return False
    return bool((value == number).all())


def _as_value(value: float, like: Tensor) -> Tensor:
    """A number in the form in which the chain passes it to an effect."""
    return torch.as_tensor(value, dtype=torch.float32, device=like.device).reshape(1, 1, 1, 1)


def _checked(parameter: Parameter, value: Any, path: str) -> Any:
    """The value, if the parameter may have it; an infinite one is a full well that is left out."""
    value = plain(value)
    if not parameter.default == math.inf == value:
        check_value(parameter, value, path)
    return value


def ends(value: Any) -> tuple[float, float] | None:
    """The ends of a value that is a range (low, high); None of any other."""
    if not isinstance(value, tuple | list) or len(value) != 2 or any(isinstance(one, str) for one in value):
        return None
    low, high = map(plain, value)
    if isinstance(low, int | float) and isinstance(high, int | float) and low > high:
        raise InputError(f"({low:g}, {high:g}) is no range", expected="(low, high) with low <= high")
    return low, high


def _drawn(value: Any, keys: list[int], name: str, like: Tensor) -> Tensor | str:
    """A value as the chain passes it to an effect: of a range each image's own, (B, 1, 1, 1)."""
    range_ = ends(value)
    if isinstance(value, str) or range_ is None:
        return value if isinstance(value, str) else _as_value(value, like)
    shares = [(derive_key(key, "parameter", name) % 2**53) / 2**53 for key in keys]
    low, high = range_
    drawn = [low + (high - low) * share for share in shares]
    return torch.tensor(drawn, dtype=torch.float32, device=like.device).view(-1, 1, 1, 1)


class Effect:
    """A physical effect. A subclass defines `name`, `stage`, its `Parameter`s and `apply`; everything else is optional.

    Class attributes:
        name: name in a camera file and in reports.
        stage, order: place in the chain; within a stage, effects act by increasing `order`.
        aliases: other words of the field for it, for a search: "EMI", "ghosting".
        summary: one sentence; equation: the law, in plain text; source: its reference.
        differentiable: whether gradients reach the image and all continuous parameters; if not, `why_not` gives the reason.
        local: False if a pixel of the output depends on other pixels of the input, so that the edge of a window is another edge.
        stepwise: True if the output moves in steps, so that only its expectation has a derivative.
        base: True for the terms of the base chain, whose parameters are at the top level of a camera file.
        separates: the measurement that distinguishes this effect from similar ones, in words (optional).
        special_cases: values of parameters with which the effect is another one, and the name of that. A diagnosis names an
            effect only where the frames tell its parameters from these values: without that they do not show what sets it apart.
        proposed: whether a diagnosis tries the effect; effects of stage PICTURE are never tried, as frames do not contain them.
        map_unit: unit of a measured map that may replace the spatial profile and strength of the effect (`map: file` in a
            camera file, `context.measured_map` in `apply`); empty if it accepts none.
        map_low: lowest value that such a map may contain.
        map_is_table: True if the map is a list of numbers and not a pattern of the sensor.
    """

    name: ClassVar[str] = ""
    stage: ClassVar[Stage]
    order: ClassVar[int] = 50
    aliases: ClassVar[tuple[str, ...]] = ()
    summary: ClassVar[str] = ""
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    differentiable: ClassVar[bool] = True
    why_not: ClassVar[str] = ""
    local: ClassVar[bool] = True
    stepwise: ClassVar[bool] = False
    base: ClassVar[bool] = False
    separates: ClassVar[str] = ""
    special_cases: ClassVar[tuple[tuple[Mapping[str, Any], str], ...]] = ()
    proposed: ClassVar[bool] = True
    map_unit: ClassVar[str] = ""
    map_low: ClassVar[float] = float("-inf")
    map_is_table: ClassVar[bool] = False
    parameters: ClassVar[dict[str, Parameter]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        for key in TEXTS:  # a sentence may run over several lines
            if isinstance(text := vars(cls).get(key), str) and "\n" in text:
                setattr(cls, key, " ".join(text.split()))
        own = {key: value for key, value in vars(cls).items() if isinstance(value, Parameter)}
        cls.parameters = {**cls.parameters, **own}

    def __init__(self, **given: Any):
        """Makes an effect with the given parameters; others have their defaults.

        Args:
            given: parameter values by name: a number, or a pair (low, high) from which each image of a call draws its own,
                uniformly.

        Raises:
            InputError: the effect has no such parameter, a value is outside its bounds, or the chosen options do not use it.
        """
        for key, value in given.items():
            if key not in self.parameters:
                expected = f"one of {', '.join(self.parameters) or 'none'}"
                raise InputError(f"is not a parameter of {self.name}", field=key, expected=expected)
            parameter, path, both = self.parameters[key], f"{self.name}.{key}", ends(value)
            for one in both or ():
                check_value(parameter, one, path)
            given[key] = both or _checked(parameter, value, path)
        for key, option in unused(self.parameters, given).items():
            raise InputError(f"has no effect in {self.name} as it is", field=key, expected=option)
        self.given = given

    def __call__(
        self, signal: Tensor, seed: int = 0, camera_seed: int = 0, sequence: bool = False, **conditions: float
    ) -> Tensor:
        """Applies this effect alone, without a camera.

        Args:
            signal: (B, C, H, W), (C, H, W) or (H, W), in the unit of the effect's stage (`Stage`): photons, electrons or DN.
            seed: of the temporal noise; each image of a batch has its own stream.
            camera_seed: of the fixed pattern, which is common to all images of the call.
            sequence: True if the batch consists of consecutive frames, for effects with memory.
            conditions: operating conditions, with defaults exposure_s=0.01, temperature_c=20, gain_e_per_dn=1,
                black_level_dn=0, full_well_e=inf, quantum_efficiency=1, dark_current_e=0, bit_depth=16. Those that the
                effect's own parameters state, as the gain of `SystemGain`, are theirs.

        Returns:
            A tensor of the same shape and dtype; float32 for a signal of whole numbers, which noise is not.

        Raises:
            InputError: an unknown condition, one out of range, or one that the effect's own parameters state; a seed that
                is no whole number; a signal of another shape, or one that is no tensor.

        Examples:
            >>> import torch, visaug
            >>> electrons = torch.full((64, 64), 500.0)
            >>> noisy = visaug.effects.RowNoise(sigma_e=1.5)(electrons, seed=0)
            >>> noisy.shape
            torch.Size([64, 64])
        """
        if unknown := set(conditions) - set(CONDITIONS):
            problem = "is not a condition"
            raise InputError(problem, field=min(unknown), expected=f"one of {', '.join(CONDITIONS)}")
        if not isinstance(signal, Tensor):
            raise InputError(f"signal is a {type(signal).__name__}", expected="a torch.Tensor")
        if not 2 <= signal.ndim <= 4:
            expected = "(B, C, H, W), (C, H, W) or (H, W)"
            raise InputError(f"signal has shape {tuple(signal.shape)}", expected=expected)
        seed, camera_seed = as_seed(seed), as_seed(camera_seed, "camera_seed")
        dtype = signal.dtype if signal.is_floating_point() else torch.float32
        if signal.numel() == 0:
            return signal.to(dtype)
        batch = signal.float().reshape((1,) * (4 - signal.ndim) + tuple(signal.shape))
        keys = [derive_key(seed, "image", k) for k in range(len(batch))]
        p = Values(**{key: _drawn(value, keys, key, signal) for key, value in self.values().items()})
        known = {key: parameter.default for key, parameter in CONDITIONS.items()}
        for key, value in conditions.items():
            known[key] = _checked(CONDITIONS[key], value, key)
        rows, columns = batch.shape[2:]
        window = (range(rows), range(columns))
        bit_depth = int(known.pop("bit_depth"))
        numbers: dict[str, Any] = {key: _as_value(value, signal) for key, value in known.items()}
        numbers |= {"bit_depth": bit_depth, "reading": "physical", "sequence": sequence}
        context = Context(**numbers, resolution=(rows, columns), window=window)
        for name, value in self.conditions(p, context).items():
            if name in conditions:
                expected = f"{type(self).__name__}({', '.join(f'{key}=...' for key in self.parameters)})"
                raise InputError(f"follows from parameters of {self.name}", field=name, expected=expected)
            setattr(context, name, value)
        patterns = [derive_key(camera_seed, "camera")] * len(batch)
        stream = Stream(keys, patterns, batch.shape[1], window, signal.device)
        return output_of(self, batch, p, stream, context).reshape(signal.shape).to(dtype)

    def __repr__(self) -> str:
        given = ", ".join(f"{key}={value!r}" for key, value in self.values().items())
        return f"{type(self).__name__}({given})"

    def values(self) -> dict[str, Any]:
        """The value of every parameter, as given or the default."""
        return {key: self.given.get(key, parameter.default) for key, parameter in self.parameters.items()}

    def apply(self, signal: Tensor, p: Values, stream: Stream, context: Context) -> Tensor:
        """Returns the signal after the effect.

        Args:
            signal: (B, C, H, W) float32 in the unit of the stage; must not be modified in place.
            p: parameter values by name: tensors (B, 1, 1, 1), or a string for a categorical parameter.
            stream: random numbers of this effect; `stream.fixed` is the same in every frame of a camera.
            context: exposure, temperature, gain, window and other conditions.

        Returns:
            A tensor of the same shape and unit.
        """
        raise NotImplementedError

    def conditions(self, p: Values, context: Context) -> dict[str, Tensor]:
        """Conditions, by name, that follow from the effect's own parameters.

        They are used when the effect is called by itself; a camera computes its conditions from all its parameters.
        """
        return {}

    def moments(self, mean: Tensor, p: Values, context: Context) -> tuple[Tensor, Tensor] | None:
        """Theoretical mean and variance of the output, over noise and cameras, for a constant input `mean`; None if not known."""
        return None

    @classmethod
    def looks(cls, seen: FrameSummary) -> list[dict[str, Any]]:
        """Additional starting values for a diagnosis, by parameter, derived from the measured frames (optional)."""
        return []

    @classmethod
    def strengths(cls) -> tuple[str, ...]:
        """Names of the parameters that are all zero when the effect vanishes."""
        return tuple(name for name, parameter in cls.parameters.items() if parameter.strength)


class Noiseless(Effect):
    """An effect without random numbers, whose `apply` gives the moments: the mean is its output, the variance 0."""

    def moments(self, mean, p, context):
        no_numbers: Any = None
        return self.apply(mean, p, no_numbers, context), torch.zeros_like(mean)


class AdditiveNoise(Effect):
    """An effect that adds noise of mean 0 and standard deviation `sigma_e`."""

    def moments(self, mean, p, context):
        return mean, p.sigma_e**2


class Spreading(Effect):
    """An effect that only moves light, charge or values between pixels: a constant signal stays as it is."""

    local = False

    def moments(self, mean: Tensor, p: Values, context: Context) -> tuple[Tensor, Tensor] | None:
        return mean, torch.zeros_like(mean)


def output_of(effect: Effect, signal: Tensor, p: Values, stream: Stream, context: Context) -> Tensor:
    """What `effect.apply` returns, if it is a tensor of the signal's shape."""
    out, where = effect.apply(signal, p, stream, context), f"effect {effect.name}: apply: returns"
    if not isinstance(out, Tensor):
        raise InputError(f"{where} {type(out).__name__}", expected="the signal after the effect, a tensor")
    if out.shape != signal.shape:
        expected = f"that of the signal, {tuple(signal.shape)}"
        raise InputError(f"{where} shape {tuple(out.shape)}", expected=expected)
    return out
