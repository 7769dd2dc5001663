"""The chain: effects in the order of physics, from mean photons to DN."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import torch
from torch import Tensor

from visaug.camera import fused
from visaug.camera.paths import path_of
from visaug.core.sampling import Stream
from visaug.effects import Context, Effect, Stage
from visaug.effects.effect import Values, output_of

# In the paper's reading shot noise strikes the photons, before quantum efficiency and PRNU (eqs. 8 to 10).
PAPER_ORDER = {"photon_shot_noise": (Stage.OPTICS, 1000)}


def ordered(effects: list[Effect], reading: str) -> list[Effect]:
    """The effects in the order in which they act."""

    def place(effect: Effect) -> tuple[int, int]:
        moved = PAPER_ORDER.get(effect.name) if reading == "paper" else None
        return moved or (effect.stage, effect.order)

    return sorted(effects, key=place)


class Conditions(NamedTuple):
    """What an exposure is made under.

    Attributes:
        values: every number of the camera by path, (B, 1, 1, 1).
        choices: every choice by path.
        stream: its forks by the effects' names are the effects' random numbers, so adding an effect changes no other's.
        context: exposure, temperature, window and other conditions.
    """

    values: Mapping[str, Tensor]
    choices: Mapping[str, str]
    stream: Stream
    context: Context


def expose(
    effects: list[Effect],
    photons: Tensor,
    under: Conditions,
    watch: Callable[[Effect, Tensor], None] | None = None,
    mosaic: Callable[[Tensor], Tensor] | None = None,
) -> Tensor:
    """DN of one exposure for each image.

    Args:
        effects: in the order in which they act, see `ordered`.
        photons: (B, C, H, W) float32, mean photons per pixel behind an ideal lens.
        watch: called with each effect and the signal after it.
        mosaic: the colour filters, where there are any: they let one of three planes through to each pixel, after the optics.

    Returns:
        (B, C, H, W) float32, DN; of stage PICTURE nothing is applied.
    """
    signal = photons
    effects = [effect for effect in effects if effect.stage != Stage.PICTURE]
    if watch is None:
        acting = [effect for effect in effects if not _vanishes(effect, under)]
        runs = fused.runs(acting, signal, under.values, under.context)
    else:
        runs = [[effect] for effect in effects]
    for run in runs:
        if mosaic is not None and run[0].stage != Stage.OPTICS:
            signal, mosaic = mosaic(signal), None
        if len(run) > 1:
            own = {effect.name: parameters_of(effect, under) for effect in run}
            signal = fused.expose(own, signal, under.stream, under.context)
        else:
            signal = _applied(run[0], signal, under)
        if watch is not None:
            watch(run[0], signal)
    return signal


def finish(effects: list[Effect], picture: Tensor, under: Conditions) -> Tensor:
    """The picture (B, C, H, W), in [0, 1], after the effects of stage PICTURE."""
    for effect in effects:
        if effect.stage == Stage.PICTURE:
            picture = _applied(effect, picture, under)
    return picture


def _applied(effect: Effect, signal: Tensor, under: Conditions) -> Tensor:
    if _vanishes(effect, under):
        return signal
    return output_of(
        effect, signal, parameters_of(effect, under), under.stream.fork(effect.name), under.context
    )


def _vanishes(effect: Effect, under: Conditions) -> bool:
    """Whether an effect has no strength at these values."""
    strengths = [] if effect.name in under.context.maps else effect.strengths()
    return bool(strengths) and all(_is_zero(under.values[path_of(effect.name, name)]) for name in strengths)


def parameters_of(effect: Effect, under: Conditions) -> Values:
    """The values of an effect's parameters under their own names."""
    own = Values()
    for name, parameter in effect.parameters.items():
        path = path_of(effect.name, name)
        setattr(own, name, under.choices[path] if parameter.options else under.values[path])
    return own


def _is_zero(value: Tensor) -> bool:
    """True where an effect has no strength anywhere; one that is being fitted from zero still takes part."""
    if value.requires_grad or value.is_cuda or torch.compiler.is_compiling():
        return False
    return not bool(value.any())
