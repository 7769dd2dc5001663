"""Laws of every effect in the catalogue, and of a user's own; what its parameters mean in a camera file.

Statistical laws allow 5 standard errors on fixed seeds: for some 300 comparisons a correct program would fail one of them, once
and for all, with probability 2e-4.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from visaug.camera import Camera, draw
from visaug.camera.paths import path_of
from visaug.core.errors import InputError
from visaug.core.sampling import Stream
from visaug.effects import Effect, Parameter, Stage, catalogue, load_file, registered
from visaug.effects.testing import LAWS, LawBroken, broken_laws, check_effect, instruments

# Tests of other folders take what the catalogue has when they are collected: the own effect is for these laws alone.
with registered():
    OWN = load_file(Path(__file__).with_name("own_effect.py"))
    EFFECTS = list(catalogue().values())
WITH_NUMBERS = [effect for effect in EFFECTS if any(not p.options for p in effect.parameters.values())]


@pytest.fixture(autouse=True)
def _with_own():
    with registered(*OWN):
        yield


def every(effects, **kwargs):
    return pytest.mark.parametrize("effect", effects, ids=lambda effect: effect.name, **kwargs)


@every(EFFECTS)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_law(law, effect):
    law(effect)


class Good(Effect):
    name = "good"
    stage = Stage.READOUT
    summary = "A random offset for each pixel."
    equation = "V <- V + r, r ~ N(0, sigma^2)"
    source = "made up for the tests"
    sigma_e = Parameter(1.0, unit="e-", high=100.0, strength=True, trials=(1.0, 5.0), source="made up")

    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e * stream.normal("pixel")

    def moments(self, mean, p, context):
        return mean, p.sigma_e**2


class Silent(Good):
    summary = ""


class Unrepeatable(Good):
    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e * torch.randn_like(signal)


class NeverZero(Good):
    def apply(self, signal, p, stream, context):
        return signal + (p.sigma_e + 1e-3) * stream.normal("pixel")


class OfItsBatch(Good):
    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e * stream.normal("pixel") * signal.mean() / signal.mean((1, 2, 3), True)


class Forgetful(Good):
    """A random walk from frame to frame that begins anew with each batch."""

    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e * stream.normal("frame").cumsum(0)


class OfItsWindow(Good):
    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e * torch.linspace(0, 1, signal.shape[-1])


class TenPercent(Good):
    def apply(self, signal, p, stream, context):
        return signal + 1.1 * p.sigma_e * stream.normal("pixel")


class Detached(Good):
    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e.detach() * stream.normal("pixel")


BREAKERS = {
    Silent: "says_what_it_is",
    Unrepeatable: "same_seed_same_output",
    NeverZero: "zero_strength_is_identity",
    OfItsBatch: "batch_is_its_images",
    Forgetful: "sequence_goes_on",
    OfItsWindow: "crop_is_part_of_the_whole",
    TenPercent: "moments_are_as_declared",
    Detached: "gradients_are_right",
}


def test_an_effect_that_keeps_the_laws_passes():
    check_effect(Good)


def test_every_law_is_broken_by_some_effect():
    assert set(BREAKERS.values()) == {law.__name__ for law in LAWS}


@pytest.mark.parametrize(("effect", "law"), BREAKERS.items(), ids=BREAKERS.values())
def test_the_law_that_is_broken_is_named(effect, law):
    assert law in broken_laws(effect)
    with pytest.raises(LawBroken):
        next(one for one in LAWS if one.__name__ == law)(effect)
    with pytest.raises(InputError, match=f"effect good: .*{law}"):
        check_effect(effect)


@every(WITH_NUMBERS)
def test_values_out_of_bounds_are_refused(effect):
    for name, p in effect.parameters.items():
        beyond = [] if p.options else [bound + out for bound, out in ((p.low, -0.01), (p.high, 1.0))]
        for value in ("nonsense", float("nan"), *filter(math.isfinite, beyond)):
            with pytest.raises(InputError, match=path_of(effect.name, name).split(".")[-1]):
                Camera.load(content(effect, {name: value}))


def content(effect: type[Effect], given: dict) -> dict:
    """What a camera.yaml with this effect and these parameters holds."""
    camera = {"resolution": [48, 64], "gain_e_per_dn": 0.5, "bit_depth": 12}
    if not effect.base:
        return {**camera, "effects": [{"name": effect.name, **given}]}
    for name, value in given.items():
        first, _, second = path_of(effect.name, name).partition(".")
        if second:
            camera.setdefault(first, {})[second] = value
        else:
            camera[first] = value
    return camera


@every(WITH_NUMBERS)
def test_camera_file_round_trip(effect, tmp_path):
    for choice in instruments.choices(effect):
        given = instruments.values(effect, **choice)
        camera = Camera.load(content(effect, given))
        for name, value in given.items():
            held = {**camera.values(), **camera.choices()}[path_of(effect.name, name)]
            assert held == value
        file = tmp_path / "camera.yaml"
        file.write_text(camera.to_yaml())
        again = Camera.load(file)
        assert again.values() == camera.values()
        assert again.choices() == camera.choices()
        assert again.effect_names == ([] if effect.base else [effect.name])
        assert yaml.safe_load(again.to_yaml()) == yaml.safe_load(camera.to_yaml())


@every(WITH_NUMBERS)
def test_random_draws_stay_within_bounds(effect):
    given = instruments.values(effect)
    paths = {path_of(effect.name, name): p for name, p in effect.parameters.items() if not p.options}
    spread = {path: {"std": 0.6 * (min(p.high, 1e4) - max(p.low, -1e4))} for path, p in paths.items()}
    camera = Camera.load({**content(effect, given), "randomize": spread})
    drawn = draw(camera, 500, np.random.default_rng(3))
    for path, p in paths.items():
        low, high = float(drawn[path].min()), float(drawn[path].max())
        slack = 1e-6 * max(abs(low), abs(high))  # float32
        assert p.low - slack <= low < high <= p.high + slack


@every(EFFECTS)
@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs CUDA")
def test_same_on_the_gpu(effect):
    image = instruments.scene(effect)
    on_cpu = instruments.run(effect, image, instruments.context())
    context = instruments.context()
    for name in instruments.CONTEXT:
        setattr(context, name, getattr(context, name).cuda())
    values = instruments.values(effect)
    p = instruments.tensors(
        {k: v if isinstance(v, str) else torch.full((1, 1, 1, 1), v).cuda() for k, v in values.items()}
    )
    stream = Stream([1, 2, 3], [9, 9, 9], 1, context.window, "cuda")
    on_gpu = instruments.apply(effect, image.cuda(), p, stream, context).cpu()
    # A count or a threshold may fall to the other side of a step in a pixel of a thousand.
    equal = torch.isclose(on_cpu, on_gpu, rtol=1e-5, atol=1e-3)
    assert equal.double().mean() > 0.999


@pytest.mark.parametrize("given", ["row_noise", None, 3])
def test_only_classes_of_effects_are_checked(given):
    with pytest.raises(InputError, match="is no class of an effect"):
        check_effect(given)
