"""The chain: effects in the order of physics, from mean photons to DN."""

from collections.abc import Callable, Hashable, Mapping
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from visaug.camera import fused
from visaug.camera.paths import path_of
from visaug.core.recurrent import Recurrent
from visaug.core.sampling import Stream
from visaug.effects import Context, Effect, Stage
from visaug.effects.effect import Values, is_surely, output_of

# In the paper's reading shot noise strikes the photons, before quantum efficiency and PRNU (eqs. 8 to 10).
PAPER_ORDER = {"photon_shot_noise": (Stage.OPTICS, 1000)}


def ordered(effects: list[Effect], reading: str) -> list[Effect]:
    """The effects in the order in which they act."""

    def place(effect: Effect) -> tuple[int, int]:
        moved = PAPER_ORDER.get(effect.name) if reading == "paper" else None
        return moved or (effect.stage, effect.order)

    return sorted(effects, key=place)


def is_own(effect: Effect | type[Effect]) -> bool:
    """Whether a user defined an effect: its output may depend on more than its parameters and the signal."""
    return not effect.__module__.startswith("visaug.")


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


class SharedSignals(NamedTuple):
    """Signals that exposures of several cameras have in common, up to where these differ.

    Attributes:
        signals: by what made them, see `name`.
        name: of the photons and of the conditions: the frames, their random numbers, and the camera without further effects.
        effects: the parameters of each further effect, as text.
    """

    signals: Recurrent
    name: Hashable
    effects: Mapping[str, str]

    def applied(
        self, run: list[Effect], signal: Tensor, apply: Callable[[Tensor], Tensor]
    ) -> tuple[Tensor, "SharedSignals"]:
        """The signal after a run of effects, and under which name the next run finds it: its old one where nothing changed."""
        name = (self.name, *((type(effect), self.effects.get(effect.name, "")) for effect in run))

        def make() -> tuple[Tensor, Hashable]:
            out = apply(signal)
            return out, self.name if torch.equal(out, signal) else name

        out, name = self.signals.get(name, make, signal.nbytes)
        return out, self._replace(name=name)


def expose(
    effects: list[Effect],
    photons: Tensor,
    under: Conditions,
    watch: Callable[[Effect, Tensor], None] | None = None,
    mosaic: Callable[[Tensor], Tensor] | None = None,
    shared: SharedSignals | None = None,
) -> Tensor:
    """DN of one exposure for each image.

    Args:
        effects: in the order in which they act, see `ordered`.
        photons: (B, C, H, W) float32, mean photons per pixel behind an ideal lens.
        watch: called with each effect and the signal after it.
        mosaic: the colour filters, where there are any: they let one of three planes through to each pixel, after the optics.
        shared: where other cameras expose the same photons with the same random numbers; for cameras without memory. From
            the first effect of a user's own on nothing is shared.

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
        if shared is not None and any(map(is_own, run)):
            shared, signal = None, signal.clone()  # which an effect may change, though it should not
        if shared is None:
            signal = _run(run, signal, under)
        else:
            signal, shared = shared.applied(run, signal, partial(_run, run, under=under))
        if watch is not None:
            watch(run[0], signal)
    return signal


def finish(effects: list[Effect], picture: Tensor, under: Conditions) -> Tensor:
    """The picture (B, C, H, W), in [0, 1], after the effects of stage PICTURE."""
    for effect in effects:
        if effect.stage == Stage.PICTURE:
            picture = _applied(effect, picture, under)
    return picture


def _run(run: list[Effect], signal: Tensor, under: Conditions) -> Tensor:
    if len(run) == 1:
        return _applied(run[0], signal, under)
    own = {effect.name: parameters_of(effect, under) for effect in run}
    return fused.expose(own, signal, under.stream, under.context)


def _applied(effect: Effect, signal: Tensor, under: Conditions) -> Tensor:
    if _vanishes(effect, under):
        return signal
    return output_of(
        effect, signal, parameters_of(effect, under), under.stream.fork(effect.name), under.context
    )


def _vanishes(effect: Effect, under: Conditions) -> bool:
    """Whether an effect has no strength at these values; one that is being fitted from zero still takes part."""
    strengths = [] if effect.name in under.context.maps else effect.strengths()
    return bool(strengths) and all(
        is_surely(under.values[path_of(effect.name, name)], 0.0) for name in strengths
    )


def parameters_of(effect: Effect, under: Conditions) -> Values:
    """The values of an effect's parameters under their own names."""
    own = Values()
    for name, parameter in effect.parameters.items():
        path = path_of(effect.name, name)
        setattr(own, name, under.choices[path] if parameter.options else under.values[path])
    return own
