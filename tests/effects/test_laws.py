"""Laws of every effect in the catalogue, and of a user's own.

Statistical laws are asked within 5 standard errors on fixed seeds: for some 300 comparisons a correct
program would fail one of them, once and for all, with probability 2e-4.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from tests.effects import bench
from visaug.camera import Camera, draw
from visaug.camera.paths import path_of
from visaug.core.errors import InputError
from visaug.effects import Effect, Stage, catalogue, load_file

OWN = load_file(Path(__file__).with_name("own_effect.py"))
EFFECTS = list(catalogue().values())
BEYOND = [effect for effect in EFFECTS if not effect.base]
WITH_NUMBERS = [effect for effect in EFFECTS if any(not p.options for p in effect.parameters.values())]


def names(text: str) -> set[str]:
    return set(text.split())


# A pixel of these depends on its surroundings, so the edge of a crop is another edge.
LOOK_AROUND = names(
    """
    point_spread veiling_glare lens_flare smear blooming interpixel_crosstalk brighter_fatter
    charge_transfer_inefficiency cosmic_rays motion_blur defocus diffraction sharpening jpeg
    """
)
NO_GRADIENT = names(
    "dead_pixels cosmic_rays bit_truncation missing_codes rts_noise picture_quantization jpeg"
)
# Their output moves in steps, so only its expectation has a derivative.
STEPWISE = {"photon_shot_noise", "quantization"}
COUNTED = {"image_lag"}  # along a sequence, where what stays is a count
STEPS = {"read_noise": 1e-2}  # relative steps of differences; its numbers are float32, others' are not
REMEMBER = {"image_lag", "rts_noise", "light_drift", "black_level_drift"}


def every(effects, **kwargs):
    return pytest.mark.parametrize("effect", effects, ids=lambda effect: effect.name, **kwargs)


def choices(effect: type[Effect]) -> list[dict[str, str]]:
    """No choice made, then each word of each choice."""
    return [{}] + [
        {name: word} for name, p in effect.parameters.items() for word in p.options if word != p.default
    ]


def run(effect, signal, context, keys=(1, 2, 3), cameras=None, **given):
    p = bench.tensors(bench.values(effect, **given), signal.dtype)
    return bench.apply(effect, signal, p, bench.stream(context, keys, cameras, signal.shape[1]), context)


def test_catalogue_is_complete():
    base = names(
        """
        photon_shot_noise quantum_efficiency prnu dsnu dark_current read_noise system_gain
        quantization saturation
        """
    )
    beyond = names(
        """
        vignetting point_spread veiling_glare lens_flare dark_current_nonuniformity hot_pixels
        dead_pixels rts_noise amplifier_glow cosmic_rays image_lag interpixel_crosstalk
        brighter_fatter blooming smear nonlinearity charge_transfer_inefficiency
        clock_induced_charge row_noise column_noise flicker_noise periodic_banding tap_mismatch
        row_parity black_level_drift light_drift bit_truncation missing_codes
        fixed_pattern_structure motion_blur defocus diffraction tone_curve sharpening
        picture_quantization jpeg
        """
    )
    own = {effect.name for effect in OWN}
    assert {effect.name for effect in EFFECTS if effect.base} == base
    assert {effect.name for effect in BEYOND} - own == beyond
    assert own == {"column_ramp"}


@every(EFFECTS)
def test_says_what_it_is(effect):
    assert effect.summary.endswith(".")
    assert effect.equation
    assert effect.source
    assert isinstance(effect.stage, Stage)
    assert effect.differentiable == (effect.name not in NO_GRADIENT)
    assert bool(effect.why_not) != effect.differentiable
    words = {word for p in effect.parameters.values() for word in p.options}
    for name, p in effect.parameters.items():
        assert p.name == name
        assert set(p.of) <= words
        assert p.unit, name
        assert p.source, name
        if p.options:
            assert p.default in p.options
            continue
        assert p.low <= p.default <= p.high
        assert all(p.low <= trial <= p.high for trial in p.trials)
        assert not p.integer or all(trial == int(trial) for trial in (p.default, *p.trials))
        if p.strength:
            assert p.low <= 0 <= p.high
            assert len(p.trials) >= 2
            assert all(p.trials)


@every(EFFECTS)
@pytest.mark.parametrize("channels", [1, 3])
def test_shape_and_repeat(effect, channels):
    """Same seed, same output, bit for bit; the input stays as it is; the output is finite and of its kind."""
    for choice in choices(effect):
        context = bench.context()
        image = bench.scene(effect, channels=channels)
        before = image.clone()
        first, again = (run(effect, image, context, **choice) for _ in range(2))
        assert torch.equal(image, before)
        assert torch.equal(first, again)
        assert first.shape == image.shape
        assert first.dtype == torch.float32
        assert first.isfinite().all()


@every([effect for effect in EFFECTS if effect.strengths()])
@pytest.mark.parametrize("sequence", [False, True])
def test_zero_strength_is_identity(effect, sequence):
    """Bit for bit, with the effect run (the chain would leave it out); each strength alone does something."""
    zero = dict.fromkeys(effect.strengths(), 0.0)
    for choice in choices(effect):
        image = bench.scene(effect)
        assert torch.equal(run(effect, image, bench.context(sequence=sequence), **zero, **choice), image)
        if effect.name == "image_lag" and not sequence:
            continue  # an image on its own is one of a steady scene, where as much comes as stays
        for strength in effect.strengths():
            alone = {name: bench.usual(effect.parameters[name]) if name == strength else 0.0 for name in zero}
            if effect.name == "cosmic_rays":
                alone[strength] = 1e4  # the bench is small
            if effect.name == "dead_pixels":
                alone[strength] = 0.1
            changed = run(effect, image, bench.context(sequence=sequence), **alone, **choice)
            assert not torch.equal(changed, image), strength


@every(EFFECTS)
def test_batch_equals_its_images_one_by_one(effect):
    """Images of two cameras, each with parameters of its own."""
    image = bench.scene(effect)
    keys, cameras = (1, 2, 3), (7, 8, 7)
    own = {name: bench.usual(effect.parameters[name]) for name in bench.numbers(effect)}
    spread = torch.tensor([1.0, 0.9, 0.8]).view(-1, 1, 1, 1)
    varied = {name: (value * spread).clamp_min(effect.parameters[name].low) for name, value in own.items()}
    together = run(effect, image, bench.context(), keys, cameras, **varied)
    for i in range(3):
        alone = run(
            effect, image[i : i + 1], bench.context(), keys[i : i + 1], cameras[i : i + 1],
            **{name: value[i : i + 1] for name, value in varied.items()},
        )  # fmt: skip
        # Sums over neighbours may be taken in another order; all else is equal to the bit.
        assert torch.allclose(together[i : i + 1], alone, rtol=1e-6, atol=1e-6 * float(alone.abs().max()))


@every(EFFECTS)
def test_sequence_goes_on_from_batch_to_batch(effect):
    image = bench.scene(effect)
    together = run(effect, image, bench.context(sequence=True))
    memory: dict[str, torch.Tensor] = {}
    for i in range(3):
        context = bench.context(sequence=True, memory=memory)
        alone = run(effect, image[i : i + 1], context, keys=(i + 1,))
        assert torch.allclose(together[i : i + 1], alone, rtol=1e-6, atol=1e-6 * float(alone.abs().max()))
    assert bool(memory) == (effect.name in REMEMBER)


@every([effect for effect in EFFECTS if effect.name not in LOOK_AROUND])
def test_crop_of_the_sensor_gets_the_crop(effect):
    rows, columns = range(5, 37), range(9, 50)
    for choice in choices(effect):
        image = bench.scene(effect)
        whole = run(effect, image, bench.context(), **choice)
        context = bench.context(window=(rows, columns))
        crop = run(effect, image[..., 5:37, 9:50], context, **choice)
        assert torch.equal(whole[..., 5:37, 9:50], crop)


@every([effect for effect in EFFECTS if effect.moments is not Effect.moments])
@pytest.mark.parametrize("reading", ["physical", "paper"])
def test_moments(effect, reading):
    """Mean and variance over frames and cameras, 2000 of each, for a constant input."""
    count, shape = 2000, (12, 12)
    context = bench.context(resolution=shape, reading=reading)
    level = torch.full((1, 1, *shape), bench.LEVEL[effect.stage])
    for choice in choices(effect):
        p = bench.tensors(bench.values(effect, **choice))
        declared = effect().moments(level, p, context)
        if declared is None:
            continue
        numbers = bench.stream(context, range(count), range(5000, 5000 + count))
        out = bench.apply(effect, level.expand(count, -1, -1, -1), p, numbers, context).double()
        deviation = out - declared[0]
        for sample in (deviation, deviation**2 - declared[1]):
            per_image = sample.mean((1, 2, 3))
            error = per_image.std() / count**0.5
            assert abs(per_image.mean()) < 5 * error + 1e-5 * bench.LEVEL[effect.stage], choice


@every([effect for effect in EFFECTS if effect.differentiable])
def test_gradients(effect):
    _check_gradients(effect, sequence=False)


@every([effect for effect in EFFECTS if effect.name in REMEMBER and effect.differentiable])
def test_gradients_along_a_sequence(effect):
    _check_gradients(effect, sequence=True)


def _check_gradients(effect, sequence):
    """To the image and every number, against central differences at the same random numbers."""
    count, step, slack = 3, STEPS.get(effect.name, 1e-6), 1e-3
    stepwise = effect.name in (STEPWISE | COUNTED if sequence else STEPWISE)
    if stepwise:
        count, step, slack = 24, 0.05, 0.02
    shape = (32, 44)
    image = bench.scene(effect, count, shape=shape, dtype=torch.float64)
    if effect.name == "quantization":
        image = image + torch.rand(
            image.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64
        )
    for choice in choices(effect):
        start = {**bench.values(effect, **choice), **bench.CONTEXT, "brightness": 1.0}
        for name in (*bench.numbers(effect), *bench.CONTEXT, "brightness"):
            value = torch.full((count, 1, 1, 1), start[name], dtype=torch.float64)
            sides = [value.clone().requires_grad_(), value * (1 + step), value * (1 - step)]
            here, up, down = (_losses(effect, image, {**start, name: side}, sequence) for side in sides)
            slope = torch.zeros(count, dtype=torch.float64)
            if here.requires_grad:
                slope = torch.autograd.grad(here.sum(), sides[0], allow_unused=True, materialize_grads=True)[
                    0
                ]
            difference = (up - down).detach() / (2 * step * start[name])
            if sequence:  # a frame's parameter also reaches later frames: only the sums compare
                slope, difference = slope.sum().view(1), difference.sum().view(1)
            gap = slope.flatten() - difference
            noise = 5 * gap.std() / count**0.5 if stepwise and not sequence else 0
            allowed = noise + slack * abs(difference.mean()) + 1e-9 / abs(start[name])
            assert abs(gap.mean()) <= allowed, (name, choice)


def _losses(effect, image, named, sequence):
    """One number an image that feels mean, place and square of the output."""
    outside = {name: named[name] for name in bench.CONTEXT}
    context = bench.context(image.shape[-2:], sequence=sequence, dtype=image.dtype, **outside)
    p = bench.tensors({name: named[name] for name in effect.parameters}, image.dtype)
    numbers = bench.stream(context, range(len(image)))
    out = bench.apply(effect, image * named["brightness"], p, numbers, context) / bench.LEVEL[effect.stage]
    weight = torch.linspace(0.5, 1.5, out.shape[-1]) * torch.linspace(1.3, 0.7, out.shape[-2])[:, None]
    return (weight * out.double() + 0.3 * out.double() ** 2).mean((1, 2, 3))


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
    for choice in choices(effect):
        given = bench.values(effect, **choice)
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
    given = bench.values(effect)
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
    image = bench.scene(effect)
    on_cpu = run(effect, image, bench.context())
    context = bench.context()
    for name in bench.CONTEXT:
        setattr(context, name, getattr(context, name).cuda())
    values = bench.values(effect)
    p = bench.tensors(
        {k: v if isinstance(v, str) else torch.full((1, 1, 1, 1), v).cuda() for k, v in values.items()}
    )
    stream = bench.Stream([1, 2, 3], [9, 9, 9], 1, context.window, "cuda")
    on_gpu = bench.apply(effect, image.cuda(), p, stream, context).cpu()
    # A count or a threshold may fall to the other side of a step in a pixel of a thousand.
    equal = torch.isclose(on_cpu, on_gpu, rtol=1e-5, atol=1e-3)
    assert equal.double().mean() > 0.999
