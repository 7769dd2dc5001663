"""Laws that every effect keeps, each a function that raises `LawBroken`.

Statistical laws allow five standard errors on fixed seeds: a correct effect breaks one of some ten comparisons with a
probability of 6e-6.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from torch import Tensor

from visaug.effects.effect import Effect, Stage
from visaug.effects.testing import instruments

Law = Callable[[type[Effect]], None]
SIGMAS = 5.0  # standard errors that a statistical law allows
# relative steps of central differences: of float64 laws, and of those with float32 numbers
STEPS = (1e-6, 1e-2)
SLACK = 1e-3  # relative difference of a gradient and a central difference
FRAMES = 2000  # frames, each of a camera of its own, whose moments are compared with the declared ones


class LawBroken(AssertionError):
    """An effect breaks a law; the message says which values differ."""


def require(held: bool, problem: str) -> None:
    """Raises `LawBroken` with `problem` where `held` is false."""
    if not held:
        raise LawBroken(problem)


def says_what_it_is(effect: type[Effect]) -> None:
    """A summary, the law, its source; a unit and a source for each parameter; trial values for each strength."""
    is_searched = effect.proposed and not effect.base and effect.stage < Stage.PICTURE
    why = "nothing says where the effect vanishes, and a diagnosis cannot try it"
    require(bool(effect.strengths()) or not is_searched, f"no parameter has strength=True: {why}")
    for key in ("summary", "equation", "source"):
        require(bool(getattr(effect, key)), f"{key} is empty")
    require(isinstance(effect.stage, Stage), "stage is no Stage")
    fits = bool(effect.why_not) != effect.differentiable
    require(fits, "an effect without gradients says why_not, and no other effect does")
    words = {word for p in effect.parameters.values() for word in p.options}
    for name, p in effect.parameters.items():
        require(set(p.of) <= words, f"{name}: `of` names an option that no parameter has")
        require(bool(p.unit) and bool(p.source), f"{name}: unit or source is empty")
        if p.strength and not p.options:
            require(p.low <= 0 <= p.high, f"{name}: a strength must be able to be 0")
            enough = len(p.trials) >= 2 and all(p.trials)
            require(enough, f"{name}: a strength needs two trials that are not 0")


def same_seed_same_output(effect: type[Effect]) -> None:
    """Bit for bit, for one and three channels; the input stays as it is; the output is finite float32 of its shape."""
    for channels in (1, 3):
        for choice in instruments.choices(effect):
            image = instruments.scene(effect, channels=channels)
            before = image.clone()
            first, again = (instruments.run(effect, image, instruments.context(), **choice) for _ in range(2))
            require(torch.equal(image, before), "the input is changed in place")
            require(torch.equal(first, again), f"two calls with one seed differ {choice or ''}")
            require(first.shape == image.shape and first.dtype == torch.float32, "shape or dtype is changed")
            require(bool(first.isfinite().all()), f"the output is not finite {choice or ''}")


def zero_strength_is_identity(effect: type[Effect]) -> None:
    """Bit for bit; and each strength alone changes the signal."""
    if not (zero := dict.fromkeys(effect.strengths(), 0.0)):
        return
    image = instruments.scene(effect)
    # factors of a usual strength: rare events do not reach a small image at that
    stronger = (1.0, 10.0, 100.0, 1e4)
    for choice in instruments.choices(effect):
        run = partial(instruments.run, effect, image, **choice)
        for sequence in (False, True):
            out, names = run(context=instruments.context(sequence=sequence), **zero), ", ".join(zero)
            require(torch.equal(out, image), f"the signal changes although {names} = 0 {choice or ''}")
        for name in zero:
            p = effect.parameters[name]
            tried = [min(max(factor * float(instruments.usual(p)), p.low), p.high) for factor in stronger]
            alone = ({**zero, name: value, "context": instruments.context(sequence=True)} for value in tried)
            changed = any(not torch.equal(run(**each), image) for each in alone)
            require(changed, f"{name} alone changes nothing {choice or ''}")


def batch_is_its_images(effect: type[Effect]) -> None:
    """Images of two cameras, each with parameters of its own, are the same together and one by one."""
    image = instruments.scene(effect)
    keys, cameras = (1, 2, 3), (7, 8, 7)
    spread = torch.tensor([1.0, 0.9, 0.8]).view(-1, 1, 1, 1)
    usual = {name: float(instruments.usual(effect.parameters[name])) for name in instruments.numbers(effect)}
    varied = {name: (spread * value).clamp_min(effect.parameters[name].low) for name, value in usual.items()}
    together = instruments.run(effect, image, instruments.context(), keys, cameras, **varied)
    for i in range(3):
        one = {name: value[i : i + 1] for name, value in varied.items()}
        of = slice(i, i + 1)
        alone = instruments.run(effect, image[of], instruments.context(), keys[of], cameras[of], **one)
        require(_close(together[of], alone), f"image {i} of a batch differs from the image alone")


def sequence_goes_on(effect: type[Effect]) -> None:
    """A sequence given in one batch equals the same sequence given frame by frame with one memory."""
    image = instruments.scene(effect)
    together = instruments.run(effect, image, instruments.context(sequence=True))
    memory: dict[str, Tensor] = {}
    for i in range(3):
        context = instruments.context(sequence=True, memory=memory)
        alone = instruments.run(effect, image[i : i + 1], context, keys=(i + 1,))
        equal = _close(together[i : i + 1], alone)
        require(equal, f"frame {i} of a sequence depends on how it is cut into batches")


def crop_is_part_of_the_whole(effect: type[Effect]) -> None:
    """A window of the sensor gets the window of the whole output; not asked of an effect that is not `local`."""
    if not effect.local:
        return
    rows, columns = range(5, 37), range(9, 50)
    for choice in instruments.choices(effect):
        image = instruments.scene(effect)
        whole = instruments.run(effect, image, instruments.context(), **choice)
        context = instruments.context(window=(rows, columns))
        crop = instruments.run(effect, image[..., 5:37, 9:50], context, **choice)
        equal = torch.equal(whole[..., 5:37, 9:50], crop)
        require(equal, f"a window differs from the whole sensor {choice or ''}")


def moments_are_as_declared(effect: type[Effect]) -> None:
    """Mean and variance over frames and cameras for a constant input, where the effect declares them."""
    if effect.moments is Effect.moments:
        return
    shape, level = (12, 12), instruments.LEVEL[effect.stage]
    signal = torch.full((1, 1, *shape), level)
    for reading in ("physical", "paper"):
        context = instruments.context(resolution=shape, reading=reading)
        for choice in instruments.choices(effect):
            p = instruments.tensors(instruments.values(effect, **choice))
            if (declared := effect().moments(signal, p, context)) is None:
                continue
            numbers = instruments.stream(context, range(FRAMES), range(5000, 5000 + FRAMES))
            out = instruments.apply(effect, signal.expand(FRAMES, -1, -1, -1), p, numbers, context).double()
            deviation = out - declared[0]
            for name, sample in (("mean", deviation), ("variance", deviation**2 - declared[1])):
                per_image = sample.mean((1, 2, 3))
                error, gap = float(per_image.std()) / FRAMES**0.5, abs(float(per_image.mean()))
                said = f"the {name} is {gap:.3g} off, standard error {error:.2g}; {reading} {choice or ''}"
                require(gap < SIGMAS * error + 1e-5 * level, said)


def gradients_are_right(effect: type[Effect]) -> None:
    """To the image, every number and the conditions, against central differences at the same random numbers."""
    if effect.differentiable:
        for sequence in (False, True) if remembers(effect) else (False,):
            for choice in instruments.choices(effect):
                _check_gradients(effect, choice, sequence)


def remembers(effect: type[Effect]) -> bool:
    """Whether frames of a sequence depend on those before them."""
    memory: dict[str, Tensor] = {}
    instruments.run(effect, instruments.scene(effect), instruments.context(sequence=True, memory=memory))
    return bool(memory)


def _check_gradients(effect: type[Effect], choice: dict[str, str], sequence: bool) -> None:
    count, slack, steps = (24, 0.02, (0.05,)) if effect.stepwise else (3, SLACK, STEPS)
    image = instruments.scene(effect, count, shape=(32, 44), dtype=torch.float64)
    if effect.stepwise:  # a signal of whole numbers would lie on the steps
        source = torch.Generator().manual_seed(2)
        image = image + torch.rand(image.shape, generator=source, dtype=torch.float64)
    start = {**instruments.values(effect, **choice), **instruments.CONTEXT, "brightness": 1.0}
    for name in (*instruments.numbers(effect), *instruments.CONTEXT, "brightness"):
        value = torch.full((count, 1, 1, 1), float(start[name]), dtype=torch.float64)
        inner = value.clone().requires_grad_()
        here = _losses(effect, image, {**start, name: inner}, sequence)
        slope = torch.zeros_like(value)
        if here.requires_grad:
            (slope,) = torch.autograd.grad(here.sum(), inner, allow_unused=True, materialize_grads=True)
        gaps = []
        for step in steps:
            moved = ({**start, name: value * f} for f in (1 + step, 1 - step))
            up, down = (_losses(effect, image, each, sequence).detach() for each in moved)
            difference, gradient = (up - down) / (2 * step * float(start[name])), slope.flatten()
            if sequence:  # a frame's parameter also reaches later frames: only the sums compare
                difference, gradient = difference.sum().view(1), gradient.sum().view(1)
            gap = gradient - difference
            noise = SIGMAS * float(gap.std()) / count**0.5 if effect.stepwise and not sequence else 0.0
            allowed = noise + slack * abs(float(difference.mean())) + 1e-9 / abs(float(start[name]))
            gaps.append(abs(float(gap.mean())) - allowed)
        require(min(gaps) <= 0, f"the gradient to {name} is {min(gaps):.3g} off {choice or ''}")


def _losses(effect: type[Effect], image: Tensor, named: dict[str, Any], sequence: bool) -> Tensor:
    """One number an image that depends on mean, place and square of the output."""
    outside = {name: named[name] for name in instruments.CONTEXT}
    resolution = image.shape[-2], image.shape[-1]
    context = instruments.context(resolution, sequence=sequence, dtype=image.dtype, **outside)
    p = instruments.tensors({name: named[name] for name in effect.parameters}, image.dtype)
    numbers = instruments.stream(context, range(len(image)))
    out = instruments.apply(effect, image * named["brightness"], p, numbers, context)
    out = out.double() / instruments.LEVEL[effect.stage]
    weight = torch.linspace(0.5, 1.5, out.shape[-1]) * torch.linspace(1.3, 0.7, out.shape[-2])[:, None]
    return (weight * out + 0.3 * out**2).mean((1, 2, 3))


def _close(one: Tensor, other: Tensor) -> bool:
    """Sums over neighbours may be taken in another order; all else is equal to the bit."""
    return torch.allclose(one, other, rtol=1e-6, atol=1e-6 * float(other.abs().max()))


LAWS: tuple[Law, ...] = (
    says_what_it_is,
    same_seed_same_output,
    zero_strength_is_identity,
    batch_is_its_images,
)
LAWS += (sequence_goes_on, crop_is_part_of_the_whole, moments_are_as_declared, gradients_are_right)
