"""Values, context and random numbers for the `apply` of one effect, away from the chain."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from visaug.core.sampling import Stream
from visaug.effects.effect import Context, Effect, Stage, Values
from visaug.effects.parameter import Parameter

LEVEL = {Stage.OPTICS: 3000.0, Stage.GENERATION: 800.0, Stage.CHARGE: 800.0, Stage.READOUT: 800.0}
LEVEL |= {Stage.DIGITAL: 700.0, Stage.PICTURE: 0.4}
CONTEXT = {"exposure_s": 0.5, "temperature_c": 25.0, "gain_e_per_dn": 1.7, "black_level_dn": 64.0}
CONTEXT |= {"full_well_e": 3000.0, "quantum_efficiency": 0.6, "dark_current_e": 12.0}


def usual(parameter: Parameter) -> float | str:
    """A value at which the effect shows, away from round numbers, where a law may have a kink."""
    if parameter.options:
        return parameter.default
    trial = parameter.trials[-1 if parameter.strength else 0] if parameter.trials else parameter.default
    if parameter.integer:
        return float(trial)
    value = {0.0: 0.1, float("inf"): 1000.0}.get(trial, float(trial))
    return next(v for v in (1.037 * value, 0.963 * value) if parameter.low <= v <= parameter.high)


def values(effect: type[Effect], **given) -> dict[str, float | str]:
    return {name: given.get(name, usual(parameter)) for name, parameter in effect.parameters.items()}


def numbers(effect: type[Effect]) -> list[str]:
    """Names of the continuous parameters."""
    return [name for name, p in effect.parameters.items() if not p.options and not p.integer]


def tensors(named: dict[str, Any], dtype: torch.dtype = torch.float32) -> Values:
    """Words stay words, numbers become (B, 1, 1, 1)."""

    def tensor(value: Any) -> Any:
        known = isinstance(value, str | Tensor)
        return value if known else torch.tensor([value], dtype=dtype).view(-1, 1, 1, 1)

    return Values(**{name: tensor(value) for name, value in named.items()})


def context(
    resolution: tuple[int, int] = (48, 64),
    window: tuple[range, range] | None = None,
    reading: str = "physical",
    sequence: bool = False,
    memory: dict[str, Tensor] | None = None,
    dtype: torch.dtype = torch.float32,
    **given: Any,
) -> Context:
    window = window or (range(resolution[0]), range(resolution[1]))
    return Context(
        **vars(tensors({**CONTEXT, **given}, dtype)),
        bit_depth=12,
        reading=reading,
        resolution=resolution,
        window=window,
        sequence=sequence,
        memory={} if memory is None else memory,
    )


def apply(effect: type[Effect], signal: Tensor, p: Values, stream: Stream, context: Context) -> Tensor:
    """The signal after the effect. As in the chain, its context knows the camera's dark current."""
    if effect.name == "dark_current":
        heat = torch.exp(p.b_per_c * context.temperature_c)
        context = replace(context, dark_current_e=context.exposure_s * p.a_e_per_s * heat)
    return effect().apply(signal, p, stream, context)


def choices(effect: type[Effect]) -> list[dict[str, Any]]:
    """No choice made, then each word of each categorical parameter."""
    words = [(name, p, word) for name, p in effect.parameters.items() for word in p.options]
    return [{}] + [{name: word} for name, p, word in words if word != p.default]


def run(
    effect: type[Effect],
    signal: Tensor,
    context: Context,
    keys: Sequence[int] = (1, 2, 3),
    cameras: Sequence[int] | None = None,
    **given: Any,
) -> Tensor:
    """The signal after the effect at its usual values, or at those given."""
    p = tensors(values(effect, **given), signal.dtype)
    return apply(effect, signal, p, stream(context, keys, cameras, signal.shape[1]), context)


def stream(context: Context, keys=(1, 2, 3), cameras=None, channels=1) -> Stream:
    return Stream(list(keys), list(cameras or [9] * len(keys)), channels, context.window)


def scene(effect: type[Effect], batch=3, channels=1, shape=(48, 64), dtype=torch.float32) -> Tensor:
    """A textured image around the stage's level, some spots above full well; whole DN after the converter."""
    generator = torch.Generator().manual_seed(5)
    level = LEVEL[effect.stage]
    image = level * (0.5 + torch.rand(batch, channels, *shape, generator=generator, dtype=dtype))
    image[..., 10:13, 20:23] *= 6
    image[..., 25, 41] *= 9
    if effect.stage == Stage.PICTURE:
        return image.clamp(0, 0.95)  # a curve has a kink at 1
    return image.round().clamp(0, 4095) if effect.stage == Stage.DIGITAL else image
