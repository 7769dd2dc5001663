"""VISNoise: what goes in and comes out, draws and their replay, ways in.

False alarms: bounds are five standard errors or more, below 1e-5 for each test.
"""

import json

import pytest
import torch
from scipy import constants

from visaug import Camera, InputError, VISNoise
from visaug.augment import (
    SensorNoise,
    draws_from_json,
    draws_to_json,
    irradiance_to_photons,
    linear_to_srgb,
    srgb_to_linear,
)
from visaug.camera import shipped
from visaug.core.sampling import Stream, derive_key

CONTENT = {
    "name": "test camera",
    "resolution": [48, 64],
    "gain_e_per_dn": 0.19,
    "quantum_efficiency": 0.61,
    "black_level_dn": 240,
    "read_noise": {"sigma_e": 2.37, "shape": -0.1},
    "prnu": {"column": 0.002, "row": 0.0015, "pixel": 0.006},
    "dsnu": {"column_e": 1.4, "row_e": 0.3, "pixel_e": 1.1},
}
RANDOM = {"gain_db": {"std": 2.0}, "read_noise.sigma_e": 0.2}


def camera(**changes) -> Camera:
    return Camera.load({**CONTENT, **changes})


def eight_bit(*shape: int) -> torch.Tensor:
    return torch.randint(20, 200, shape, generator=torch.Generator().manual_seed(3)) / 255


@pytest.fixture(params=[True, False], ids=["fast", "exact"])
def fast(request):
    return request.param


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
@pytest.mark.parametrize("channels", [1, 3])
def test_shape_and_type_are_kept(dtype, channels, fast):
    images = eight_bit(2, channels, 20, 30).to(dtype)
    noisy = VISNoise(camera(), fast=fast)(images)
    assert (noisy.shape, noisy.dtype, noisy.device) == (images.shape, images.dtype, images.device)
    assert noisy.min() >= 0
    assert noisy.max() <= 1
    assert not torch.equal(noisy, images)


@pytest.mark.parametrize("effect", [None, "point_spread", "jpeg", "sharpening"])
def test_autocast_does_not_change_the_noise(effect):
    seen = camera() if effect is None else camera().with_effect(effect)
    noise, images = SensorNoise(seen), torch.rand(2, 1, 24, 32)
    draws = noise.draw(2)
    with torch.autocast("cpu", torch.bfloat16):
        within = noise.apply_draws(images, draws)
    assert torch.equal(within, noise.apply_draws(images, draws))


def test_single_image_keeps_its_axes():
    image = eight_bit(1, 20, 30)
    assert VISNoise(camera())(image).shape == (1, 20, 30)
    assert VISNoise(camera(), keepdim=False)(image).shape == (1, 1, 20, 30)


@pytest.mark.parametrize("gain_db", [-6.0, 0.0, 6.0])
@pytest.mark.parametrize("quantum_efficiency", [0.2, 0.9])
def test_gain_and_quantum_efficiency_leave_the_mean(gain_db, quantum_efficiency, fast):
    flat = torch.full((1, 1, 400, 400), 0.4)
    quiet = {"prnu": {}, "dsnu": {}}
    cam = camera(gain_db=gain_db, quantum_efficiency=quantum_efficiency, **quiet)
    noisy = VISNoise(cam, fast=fast)(flat)
    assert abs(noisy.mean() - 0.4) < 5 * noisy.std() / 400


def test_variance_is_that_of_the_linear_model(fast):
    # EMVA 1288: sigma_y^2 = K^2 (sigma_d^2 + mu_e) + 1/12; five standard errors of a variance are 5 sqrt(2/N)
    flat = torch.full((1, 1, 500, 500), 0.3)
    noisy = VISNoise(camera(prnu={}, dsnu={}), fast=fast)(flat) * (65535 - 240)
    electrons = 0.3 * (65535 - 240) * 0.19
    expected = (2.37**2 + electrons) / 0.19**2 + 1 / 12
    assert noisy.double().var().item() == pytest.approx(expected, rel=5 * (2 / 500**2) ** 0.5)


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_any_input_depth_has_the_same_noise(bits):
    levels = torch.round(torch.full((1, 1, 300, 300), 0.5) * (2**bits - 1)) / (2**bits - 1)
    noisy = VISNoise(camera(prnu={}, dsnu={}))(levels)
    assert abs(noisy.mean() - levels.mean()) < 5 * noisy.std() / 300
    range_dn = 65535 - 240
    expected = (2.37**2 + levels.mean() * range_dn * 0.19) ** 0.5 / 0.19 / range_dn
    assert noisy.std().item() == pytest.approx(expected.item(), rel=5 * (0.5 / 300**2) ** 0.5)


def test_a_monochrome_camera_adds_one_noise_to_all_channels(fast):
    gray, colour = eight_bit(1, 1, 40, 50).expand(1, 3, 40, 50), eight_bit(1, 3, 40, 50)
    noisy = VISNoise(camera(), fast=fast)(torch.cat([gray, colour]))
    assert torch.equal(noisy[0, 0], noisy[0, 1])
    assert torch.equal(noisy[0, 0], noisy[0, 2])
    noise = noisy[1] - colour[0]
    assert (noise - noise[:1]).abs().max() < 1e-6
    alone = VISNoise(camera(), fast=fast)
    one = alone(gray[:, :1])
    assert torch.equal(alone(gray, params=alone._params)[0, 1], one[0, 0])


def test_a_tint_changes_the_noise_no_more_than_the_image(fast):
    """The luminance of the tinted pixel alone is taken anew; the others keep their noise."""
    gray = torch.full((1, 3, 30, 30), 0.4)
    tinted = gray.clone()
    tinted[0, 2, 3, 4] += 0.01
    noise = VISNoise(camera(), fast=fast)
    before = noise(gray)
    after = noise(tinted, params=noise._params)
    changed = (before != after).any(1)[0].nonzero().tolist()
    assert changed == [[3, 4]]
    assert (after - before).abs().max() < 0.0101 + 3 / 65535 + 0.01 * 0.0722


def test_noise_of_a_colour_image_is_that_of_its_luminance():
    """Var = (mu_Y + sigma^2) G^-2, mu_Y the electrons of 0.2126 R + 0.7152 G + 0.0722 B (BT.709)."""
    colour = torch.tensor([0.6, 0.3, 0.1]).view(1, 3, 1, 1).expand(1, 3, 300, 300)
    noisy = VISNoise(camera(prnu={}, dsnu={}))(colour)
    full_e = (65535 - 240) * 0.19
    expected = (0.2126 * 0.6 + 0.7152 * 0.3 + 0.0722 * 0.1) / full_e + (2.37 / full_e) ** 2
    deviation = noisy.std((2, 3)).flatten() / expected**0.5
    assert (deviation - 1).abs().max() < 5 * (0.5 / 300**2) ** 0.5
    assert (noisy.mean((2, 3)) - colour[..., 0, 0]).abs().max() < 5 * expected**0.5 / 300


def test_channels_of_their_own_are_independent(fast):
    gray = torch.full((1, 3, 60, 60), 0.4)
    noise = (VISNoise(camera(), mono=False, fast=fast)(gray) - gray)[0].flatten(1)
    off = torch.corrcoef(noise)[0, 1:]
    assert off.abs().max() < 5 / 60


def test_black_level_is_taken_off_or_kept(fast):
    dark = torch.zeros(1, 1, 100, 100)
    cam = camera(dsnu={}, prnu={})
    kept = VISNoise(cam, black_level="keep", fast=fast)(dark) * 65535
    assert kept.mean().item() == pytest.approx(240, abs=5 * 12.5 / 100)
    assert VISNoise(cam, fast=fast)(dark).mean() * 65535 < 10


def test_srgb_images_are_noisy_in_linear_light():
    flat = torch.full((1, 1, 300, 300), 0.5)
    cam = camera(prnu={}, dsnu={})
    noisy = srgb_to_linear(VISNoise(cam, transfer="srgb")(flat))
    linear = srgb_to_linear(torch.tensor(0.5))
    assert abs(noisy.mean() - linear) < 5 * noisy.std() / 300
    assert linear_to_srgb(srgb_to_linear(flat)).allclose(flat, atol=1e-6)


def test_sensor_resolution_averages_the_noise():
    flat = torch.full((1, 1, 64, 64), 0.4)
    quiet = {"prnu": {}, "dsnu": {}, "resolution": [256, 256]}
    network = VISNoise(camera(**quiet))(flat).std()
    sensor = VISNoise(camera(**quiet), resolution="sensor")(flat).std()
    assert (network / sensor).item() == pytest.approx(4, rel=5 * 2 * (0.5 / 64**2) ** 0.5)


def test_seed_reproduces_and_images_differ(fast):
    images = torch.full((2, 1, 30, 30), 0.3)
    noise = VISNoise(camera(randomize=RANDOM), fast=fast)
    torch.manual_seed(5)
    first = noise(images)
    torch.manual_seed(5)
    assert torch.equal(noise(images), first)
    assert not torch.equal(noise(images), first)
    assert not torch.equal(first[0], first[1])
    own = [VISNoise(camera(), fast=fast, seed=7)(images) for _ in range(2)]
    assert torch.equal(*own)


def test_draws_replay_through_json_bit_by_bit(fast):
    images = eight_bit(3, 1, 30, 40)
    noise = VISNoise(camera(randomize=RANDOM), fast=fast)
    noisy = noise(images)
    text = json.dumps(draws_to_json(noise._params))
    assert {"gain_db", "read_noise.sigma_e"} <= json.loads(text).keys()
    assert torch.equal(noise(images, params=draws_from_json(json.loads(text))), noisy)


def test_a_batch_is_its_images(fast):
    images = eight_bit(3, 1, 30, 40)
    noise = VISNoise(camera(randomize=RANDOM), fast=fast)
    noisy, draws = noise(images), noise._params
    for i in range(3):
        one = {name: value[i : i + 1] for name, value in draws.items()}
        assert torch.equal(noise(images[i : i + 1], params=one), noisy[i : i + 1])


def test_random_values_have_their_spread():
    noise = SensorNoise(camera(randomize={"gain_db": {"std": 2.0}, "prnu.pixel": 1.0}))
    draws = noise.draw(4000)
    assert draws["gain_db"].std().item() == pytest.approx(2.0, rel=5 * (0.5 / 4000) ** 0.5)
    assert draws["prnu.pixel"].min() > 0  # truncated: none piles up at the bound


def test_population_uses_every_camera(fast):
    bright, dim = camera(black_level_dn=500), camera(black_level_dn=5000)
    noise = VISNoise([bright, dim], black_level="keep", fast=fast)
    noisy = noise(torch.zeros(40, 1, 16, 16)) * 65535
    level = torch.where(noise._params["camera"] == 0, 500.0, 5000.0)
    assert (noisy.mean((1, 2, 3)) - level).abs().max() < 100
    assert 5 < noise._params["camera"].sum() < 35  # 1e-6 outside


def test_what_one_camera_draws_is_not_the_others(fast):
    """Of a population: an image's numbers are those of its own camera, drawn or as they stand in its file."""
    drawn = {"read_noise.sigma_e": 0.1, "row_noise.sigma_e": 0.1, "full_well_e": 0.1}
    noisy = camera(
        read_noise={"sigma_e": 400.0},
        effects=[{"name": "row_noise", "sigma_e": 90.0}],
        full_well_e=9000.0,
        randomize=drawn,
    )
    rows = camera(read_noise={"sigma_e": 50.0}, effects=[{"name": "row_noise", "sigma_e": 7.0}])
    plain = camera(read_noise={"sigma_e": 10.0}, randomize={"gain_db": {"std": 1.0}})
    population = [rows, noisy, plain]
    noise = SensorNoise(population, fast=fast, seed=2, black_level="keep")
    draws = noise.draw(300)
    for number, own in enumerate(population):
        here = draws["camera"] == number
        for path in (*drawn, "gain_db"):
            values, nominal = draws[path][here], own.values().get(path)
            if path in own.spec.randomize:
                assert len(values.unique()) == len(values)
            elif nominal is not None:
                assert (values == torch.tensor(nominal)).all()
        alone = SensorNoise(own, fast=fast, seed=2, black_level="keep")
        spread, by_itself = (
            each.apply_draws(torch.zeros(40, 1, 24, 24), some).std((1, 2, 3)).median().item()
            for each, some in (
                (noise, {name: value[here][:40] for name, value in draws.items()}),
                (alone, alone.draw(40)),
            )
        )
        assert spread == pytest.approx(by_itself, rel=0.2)
    assert not any("read_noise" in path for path in SensorNoise([rows, camera()]).draw(2))


def test_a_value_goes_to_the_cameras_of_a_population_that_have_it(fast):
    rows, plain = camera(effects=[{"name": "row_noise", "sigma_e": 1.0}]), camera()
    for population in ([rows, plain], [plain, rows]):
        noise = SensorNoise(population, values={"row_noise.sigma_e": 900.0}, fast=fast, seed=3)
        draws = noise.draw(12)
        noisy = noise.apply_draws(torch.full((12, 1, 64, 8), 0.3), draws).mean(3).std(2).flatten()
        with_rows = torch.tensor([one is rows for one in population])[draws["camera"]]
        assert noisy[with_rows].min() > 5 * noisy[~with_rows].max()
    with pytest.raises(InputError, match=r"column_noise\.sigma_e: is not a parameter of this camera"):
        SensorNoise([rows, plain], values={"column_noise.sigma_e": 1.0})


def test_same_on_batch_and_probability(fast):
    images = torch.full((200, 1, 8, 8), 0.5)
    same = VISNoise(camera(randomize=RANDOM), same_on_batch=True, fast=fast)(images[:4])
    assert torch.equal(same, same[:1].expand_as(same))
    half = VISNoise(camera(), p=0.5, fast=fast)(images)
    changed = (half != images).flatten(1).any(1).sum().item()
    assert 60 < changed < 140  # 2e-8 outside
    assert torch.equal(VISNoise(camera(), p=0.0, fast=fast)(images), images)


def test_kept_pattern_is_the_cameras_and_its_crop(fast):
    cam = camera(
        read_noise={"sigma_e": 0.5},
        dsnu={"pixel_e": 40.0, "row_e": 30.0, "column_e": 20.0},
        gain_e_per_dn=1.0,
    )
    dark = torch.zeros(60, 1, 40, 50)
    whole = VISNoise(cam, fixed_pattern="camera", seed=4, fast=fast, black_level="keep")(dark).mean(0)
    again = VISNoise(cam, fixed_pattern="camera", seed=4, fast=not fast, black_level="keep")(dark).mean(0)
    other = VISNoise(cam, fixed_pattern="camera", seed=5, fast=fast, black_level="keep")(dark).mean(0)
    options = {"fixed_pattern": "camera", "seed": 4, "fast": fast, "black_level": "keep"}
    crop = VISNoise(cam, origin=(10, 20), **options)(dark[..., :30, :30]).mean(0)
    assert (whole - again).abs().max() * 65535 < 1.0
    assert (whole - other).std() * 65535 > 40
    assert (whole[..., 10:, 20:] - crop).abs().max() * 65535 < 1.0


def test_kept_pattern_is_that_of_simulated_frames():
    cam = camera(read_noise={"sigma_e": 0.1}, gain_e_per_dn=1.0, dsnu={"pixel_e": 40.0})
    noise = SensorNoise(cam, fixed_pattern="camera", black_level="keep")
    image = noise(torch.zeros(1, 1, 48, 64)) * 65535
    stream = Stream([1], [derive_key(0, "camera")], 1, (range(48), range(64)))
    frame = cam.expose(torch.zeros(1, 1, 48, 64), stream)
    assert (image - frame).abs().max() < 1.5


def test_full_scale_photons_make_brightness_depend_on_the_gain(fast):
    flat = torch.full((1, 1, 100, 100), 0.5)
    cam = camera(prnu={}, dsnu={})
    mean = VISNoise(cam, full_scale_photons=10_000.0, fast=fast)(flat).mean().item()
    assert mean == pytest.approx(5000 * 0.61 / 0.19 / (65535 - 240), rel=1e-3)


def test_values_keep_their_precision_in_a_module_of_half_precision():
    """A full well of 100,000 e- is infinite in float16, and white another level."""
    flat = torch.full((1, 1, 32, 32), 0.5)
    noises = [VISNoise(camera(), values={"full_well_e": 1e5, "gain_e_per_dn": 0.19}, seed=3) for _ in "ab"]
    assert torch.equal(torch.nn.Sequential(noises[0]).half()(flat), noises[1](flat))
    assert not noises[1].state_dict()


def test_irradiance_is_the_relation_of_emva_1288():
    # Release 4 Linear, eq. 4: mu_p = 50.34 A[um^2] t[ms] lambda[um] E[uW/cm^2]
    photons = irradiance_to_photons(2.0e-2, 0.525e-6, (3.45e-6) ** 2, 4e-3)  # 2 uW/cm^2
    assert photons == pytest.approx(50.34 * 3.45**2 * 4 * 0.525 * 2, rel=2e-4)
    energy = constants.h * constants.c / 0.525e-6
    assert photons == pytest.approx(2.0e-2 * (3.45e-6) ** 2 * 4e-3 / energy)


@pytest.mark.parametrize(
    ("field", "options"),
    [
        ("transfer", {"transfer": "gamma"}),
        ("mono", {"mono": "yes"}),
        ("mono", {"mono": 1}),
        ("full_scale_photons", {"full_scale_photons": 0.0}),
        ("full_scale_photons", {"full_scale_photons": -5.0}),
        ("gain_db", {"gain_db": (20, 10)}),
        ("gain_db", {"gain_db": (1, 2, 3)}),
        ("gain_db", {"gain_db": 500}),
        ("gain_db", {"gain_db": 3, "values": {"gain_db": 3.0}}),
        ("exposure", {"exposure": 0}),
        ("exposure", {"exposure": (0.5, 1.5)}),
        ("exposure", {"exposure": 1e-300}),
        ("strength", {"strength": -1}),
        ("strength", {"strength": 1e-300}),
        ("strength", {"strength": float("nan")}),
        ("p", {"p": 1.5}),
        ("p", {"p": -0.1}),
        ("gain", {"values": {"gain": 1.0}}),
    ],
)
def test_wrong_options_are_refused_by_name(field, options):
    with pytest.raises(InputError) as caught:
        VISNoise(camera(), **options)
    assert caught.value.field == field


@pytest.mark.parametrize("source", [[], None, 3])
def test_what_is_no_camera_is_refused(source):
    with pytest.raises(InputError, match="camera"):
        VISNoise(source)


@pytest.mark.parametrize("module", [SensorNoise, VISNoise])
@pytest.mark.parametrize(
    ("images", "says"),
    [
        (torch.full((1, 3, 8, 8), 120, dtype=torch.uint8), "uint8"),
        (torch.full((1, 3, 8, 8), 120.0), "120"),
        (torch.full((1, 3, 8, 8), -0.7), "-0.7"),
        (torch.rand(2, 30, 40, 3), "channels last"),
        (torch.rand(1, 3, 0, 8), "no pixels"),
        (None, "NoneType"),
        ([0.5, 0.5], "list"),
    ],
)
def test_what_is_no_batch_of_images_is_refused(module, images, says):
    with pytest.raises(InputError, match=says):
        module(camera())(images)


def test_values_a_little_outside_are_cut_and_nan_stays_at_its_pixel(fast):
    images = torch.full((1, 3, 20, 20), 0.5)
    images[..., 0, 0], images[..., 1, 1] = 1.2, -0.2
    images[0, 1, 2, 2] = float("nan")
    noisy = SensorNoise(camera(), fast=fast)(images)
    assert noisy[..., 0, 0].min() > 0.99
    assert noisy[..., 1, 1].max() < 0.01
    lost = noisy.isnan().any(1)[0]
    assert lost[2, 2]
    assert lost.sum() == 1


def test_a_nan_does_not_hide_that_values_are_of_another_scale():
    images = torch.full((1, 1, 8, 8), 120.0)
    images[0, 0, 3, 3] = float("nan")
    with pytest.raises(InputError, match="120"):
        SensorNoise(camera())(images)
    assert SensorNoise(camera())(torch.full((1, 1, 2, 2), float("nan"))).isnan().all()


def test_the_repr_names_what_was_chosen():
    text = repr(VISNoise(camera(), seed=4, gain_db=(0, 12), strength=2, mono=False))
    for part in (
        "'test camera'",
        "transfer='auto'",
        "seed=4",
        "gain_db=(0.0, 12.0)",
        "strength=2",
        "mono=False",
    ):
        assert part in text
    assert "exposure" not in text
    assert "test camera" in repr(SensorNoise(camera()))


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"gain_e_per_dn": -1}, r"gain_e_per_dn: -1 is not valid; expected a number from 1e-06"),
        ({"gain_e_per_dn": float("nan")}, "gain_e_per_dn: nan"),
        ({"full_well_e": float("nan")}, "full_well_e: nan"),
        ({"quantum_efficiency": 1.5}, "quantum_efficiency: 1.5 is not valid; .* from 0.0001 to 1"),
        ({"read_noise.sigma_e": float("inf")}, "read_noise.sigma_e: inf"),
        ({"read_noise.sigma_e": "much"}, "'much' is not a number; expected a number from 0 to 10000 e-"),
        ({"read_noise.sigma_e": True}, "True is not a number"),
        ({"read_noise.sigma_e": None}, "None is not a number"),
        ({"read_noise.sigma_e": torch.tensor([1.0, -2.0])}, "read_noise.sigma_e: -2 is not valid"),
        ({"read_noise.sigma_e": torch.nn.Parameter(torch.tensor(-1.0))}, "read_noise.sigma_e: -1"),
        ({"read_noise.sigma_e": torch.zeros(2, 2)}, r"has shape \(2, 2\)"),
        ({"read_noise.sigma_e": torch.zeros(0)}, r"has shape \(0,\)"),
        ({"black_level_dn": 65535}, "black_level_dn: 65535 is not valid; .* to 65534"),
        ({"dead_pixels.density": 0.1}, "dead_pixels.density: is not a parameter"),
        (["gain_e_per_dn"], "values: .* expected a dict"),
    ],
)
def test_values_out_of_the_range_of_a_camera_file_are_refused(values, says):
    for kind in (SensorNoise, VISNoise):
        with pytest.raises(InputError, match=says):
            kind(camera(), values=values)


def test_values_at_the_ends_of_their_range_and_one_for_each_image_are_taken(fast):
    SensorNoise(camera(), values={"quantum_efficiency": torch.tensor(1e-4), "full_well_e": float("inf")})
    sigma = torch.tensor([0.0, 500.0, 0.0])
    noise = SensorNoise(camera(), values={"read_noise.sigma_e": sigma}, fast=fast)
    spread = noise(torch.full((3, 1, 24, 24), 0.5)).std((1, 2, 3))
    assert spread[1] > 2 * spread[0].maximum(spread[2])
    with pytest.raises(InputError, match="sigma_e: has 3 values for 2 images"):
        noise(torch.full((2, 1, 24, 24), 0.5))
    with pytest.raises(InputError, match="for several cameras"):
        SensorNoise([camera(), camera()], values={"read_noise.sigma_e": sigma})


@pytest.mark.parametrize("origin", [(-1, 0), (1, 2, 3), (0.5, 1), "ab", 5, (True, 1), (70000, 0)])
def test_an_origin_that_is_no_pixel_is_refused(origin):
    with pytest.raises(InputError, match=r"origin: .* expected \(row, column\)"):
        SensorNoise(camera(), origin=origin)


def test_an_origin_is_two_numbers_in_the_repr():
    assert "origin=(5, 5)" in repr(SensorNoise(camera(), origin=[5, 5]))  # a list, as JSON has it


@pytest.mark.parametrize(
    "stored",
    [None, 5, "draws", {"a": 1}, {}, {"keys": 5}, {"keys": ["zz"]}, [1], [{"name": "a"}], [{"name": "a", "data": 5}],
     {"keys": ["1"], "camera": {"type": "no", "shape": [], "values": []}}],
)  # fmt: skip
def test_what_is_no_stored_draws_is_refused(stored):
    with pytest.raises(InputError, match="draws: these are no stored draws"):
        draws_from_json(stored)


def test_gradients_take_the_exact_chain():
    images = eight_bit(1, 1, 20, 20).requires_grad_()
    VISNoise(camera())(images).sum().backward()
    assert images.grad is not None
    assert images.grad.mean().item() == pytest.approx(1.0, abs=0.05)


def test_an_optimiser_recovers_the_read_noise():
    flat = torch.full((4, 1, 64, 64), 0.002)
    target = VISNoise(camera(prnu={}, dsnu={}), fast=False, black_level="keep")(flat).var()
    sigma = torch.nn.Parameter(torch.tensor(6.0))
    noise = VISNoise(camera(prnu={}, dsnu={}), values={"read_noise.sigma_e": sigma}, black_level="keep")
    optimiser = torch.optim.Adam(noise.parameters(), lr=0.3)
    for _ in range(60):
        optimiser.zero_grad()
        loss = (noise(flat).var() / target).log() ** 2
        loss.backward()
        optimiser.step()
    # The variance also holds 25 e-^2 of shot noise: 5 standard errors of it are 1.2 e-^2, hence 0.25 e- of sigma
    assert sigma.item() == pytest.approx(2.37, abs=0.6)


@pytest.mark.parametrize("name", sorted(shipped()))
@pytest.mark.parametrize(
    "options",
    [{}, {"black_level": "keep", "mono": True}, {"full_scale_photons": 20000.0}],
    ids=lambda o: next(iter(o), "plain"),
)
def test_gains_have_finite_derivatives_with_and_without_a_full_well(name, options):
    camera = Camera.load(name)
    values = {
        path: torch.nn.Parameter(torch.tensor(float(camera.values()[path])))
        for path in ("gain_e_per_dn", "gain_db")
    }
    SensorNoise(camera, values=values, seed=2, **options)(torch.full((1, 1, 8, 8), 0.5)).mean().backward()
    for value in values.values():
        assert torch.isfinite(value.grad)


def test_the_derivative_by_the_gain_is_that_of_a_difference():
    """Of the brightness at a fixed number of photons, with and without a full well behind the converter's end."""
    for well in ({}, {"full_well_e": 1e5}):
        one = camera(**well)
        draws = SensorNoise(one, seed=3).draw(1)

        def mean(gain, one=one, draws=draws):
            noise = SensorNoise(one, values={"gain_e_per_dn": gain}, full_scale_photons=9000.0, seed=3)
            return noise.apply_draws(torch.full((1, 1, 64, 64), 0.5), draws).mean()

        gain = torch.tensor(0.19, requires_grad=True)
        (found,) = torch.autograd.grad(mean(gain), gain)
        step = 0.02
        above, below = (mean(torch.tensor(0.19 + s, requires_grad=True)) for s in (step, -step))
        assert float(found) == pytest.approx(float((above - below).detach() / (2 * step)), rel=0.05)


@pytest.mark.parametrize("name", ["canon_5d4_iso800", "phone_at_night"])
def test_with_one_specimen_an_image_is_the_same_in_every_batch(name):
    """Also where the strength of its pattern is drawn for each image."""
    noise = SensorNoise(name, fixed_pattern="camera", seed=1, exposure=(0.05, 1.0), mono=True)
    images, draws = torch.rand(4, 1, 24, 32, generator=torch.Generator().manual_seed(3)), noise.draw(4)
    assert len(draws["prnu.pixel"].unique()) == 4
    together = noise.apply_draws(images, draws)
    for k in range(4):
        alone = noise.apply_draws(
            images[k : k + 1], {path: value[k : k + 1] for path, value in draws.items()}
        )
        assert torch.equal(alone[0], together[k])
