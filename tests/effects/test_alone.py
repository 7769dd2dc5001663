"""An effect that is constructed and called without a camera."""

import numpy as np
import pytest
import torch
from scipy import stats

import visaug
from visaug import InputError
from visaug.effects import (
    DSNU,
    DarkCurrent,
    QuantumEfficiency,
    RowNoise,
    RTSNoise,
    Saturation,
    SystemGain,
    Vignetting,
    catalogue,
)
from visaug.effects.effect import Values
from visaug.effects.parameter import unused
from visaug.effects.testing import instruments


def test_row_noise_has_its_standard_deviation_and_is_constant_along_a_row():
    noise = RowNoise(sigma_e=2.5)(torch.full((4000, 3), 100.0), seed=4) - 100
    assert torch.equal(noise, noise[:, :1].expand(-1, 3))
    # The standard deviation of 4000 normal numbers is known to 1.1 %: 5 % is 4.5 standard errors, 1e-5 of false alarms.
    assert noise[:, 0].std().item() == pytest.approx(2.5, rel=0.05)


def test_the_law_of_a_deterministic_effect():
    signal = torch.full((1, 1, 20, 20), 1000.0)
    warm = DarkCurrent(a_e_per_s=3.0, b_per_c=0.07)(signal, exposure_s=4.0, temperature_c=30.0)
    assert warm[0, 0, 7, 7].item() == pytest.approx(1000 + 4 * 3 * 2.718281828**2.1, rel=1e-5)
    light = Vignetting(corner_loss=0.3)(signal)
    assert light.amax().item() == pytest.approx(1000, rel=1e-2)
    assert light[0, 0, 0, 0].item() == pytest.approx(1000 * (1 - 0.3 * (9.5 / 10) ** 2), rel=1e-4)


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        (SystemGain(gain_e_per_dn=2.0, black_level_dn=10.0), 60.0),
        (SystemGain(gain_e_per_dn=2.0, gain_db=6.0), 50.0),
        (Saturation(full_well_e=70.0), 70.0),
        (QuantumEfficiency(value=0.25), 25.0),
    ],
)
def test_own_parameters_count(effect, expected):
    assert effect(torch.full((2, 2), 100.0)).tolist() == [[expected] * 2] * 2


def test_each_image_has_its_own_gain():
    out = SystemGain(gain_e_per_dn=(1.0, 4.0))(torch.full((50, 1, 2, 2), 100.0), seed=2)
    assert out.amin() >= 25
    assert out.amax() <= 100
    assert len(out.unique()) == 50


@pytest.mark.parametrize(
    ("effect", "condition"),
    [
        (SystemGain, "gain_e_per_dn"),
        (SystemGain, "black_level_dn"),
        (Saturation, "full_well_e"),
        (QuantumEfficiency, "quantum_efficiency"),
        (DarkCurrent, "dark_current_e"),
    ],
)
def test_a_condition_beside_the_parameters_that_state_it_is_refused(effect, condition):
    with pytest.raises(InputError, match=rf"{condition}: follows from parameters of {effect.name}; expected"):
        effect()(torch.full((2, 2), 100.0), **{condition: 0.5})


@pytest.mark.parametrize("effect", catalogue().values(), ids=list(catalogue()))
def test_every_parameter_is_read_under_some_choice(effect, monkeypatch):
    """A parameter that `apply` never asks for has no effect, whatever it is."""
    read = set()

    class Watched(Values):
        def __getattribute__(self, name):
            read.add(name)
            return super().__getattribute__(name)

    monkeypatch.setattr("visaug.effects.effect.Values", Watched)
    signal = instruments.scene(effect, channels=3)  # of colours, which some parameters need
    for choice in instruments.choices(effect):
        for sequence in (False, True):
            given = instruments.values(effect, **choice)
            idle = unused(effect.parameters, given)
            effect(**{key: value for key, value in given.items() if key not in idle})(
                signal, sequence=sequence
            )
    unread = {"gain_db"} if effect is SystemGain else set()  # it names the gain at which the other is given
    assert set(effect.parameters) - read == unread


def test_seeds():
    signal = torch.full((2, 1, 16, 16), 50.0)
    noise = RowNoise(sigma_e=1.0)
    assert torch.equal(noise(signal, seed=1), noise(signal, seed=1))
    assert not torch.equal(noise(signal, seed=1), noise(signal, seed=2))
    assert not torch.equal(noise(signal)[0], noise(signal)[1])
    pattern = DSNU(pixel_e=2.0)
    assert torch.equal(pattern(signal, seed=1)[0], pattern(signal, seed=2)[1])  # a fixed pattern
    assert not torch.equal(pattern(signal, camera_seed=1), pattern(signal, camera_seed=2))


@pytest.mark.parametrize("effect", catalogue().values(), ids=list(catalogue()))
def test_every_effect_runs_alone_and_shows_how_it_was_made(effect):
    made = effect()
    signal = torch.full((3, 12, 16), 300.0, dtype=torch.float64)
    out = made(signal)
    assert out.shape == signal.shape
    assert out.dtype == signal.dtype
    assert torch.isfinite(out).all()
    assert getattr(visaug.effects, effect.__name__) is effect
    again = eval(repr(made), {effect.__name__: effect, "inf": float("inf")})
    assert again.values() == made.values()


def test_a_parameter_that_the_options_leave_without_effect_is_refused():
    """Of every effect with such parameters; their defaults are taken."""
    with pytest.raises(InputError, match="kept: has no effect in rts_noise as it is; expected levels: two"):
        RTSNoise(levels="three", kept=0.6)
    assert RTSNoise(levels="three", kept=0.0).values()["levels"] == "three"
    tried = 0
    for effect in catalogue().values():
        for choice in instruments.choices(effect):
            for key in unused(effect.parameters, instruments.values(effect, **choice)):
                with pytest.raises(InputError, match=f"{key}: has no effect in {effect.name}"):
                    effect(**choice, **{key: instruments.usual(effect.parameters[key])})
                signal, made = instruments.scene(effect, channels=3), effect(**choice)
                before = made(signal)
                made.given = {**made.given, key: instruments.usual(effect.parameters[key])}
                assert torch.equal(made(signal), before)  # it has no effect indeed
                tried += 1
    assert tried > 10


def test_a_camera_says_which_parameter_has_no_effect(caplog):
    effect = {"name": "rts_noise", "levels": "three", "kept": 0.6}
    visaug.Camera.load({"resolution": [8, 8], "gain_e_per_dn": 1.0, "effects": [effect]})
    assert caplog.messages == ["rts_noise.kept = 0.6 has no effect; expected levels: two"]
    caplog.clear()
    visaug.Camera.load({"resolution": [8, 8], "gain_e_per_dn": 1.0, "effects": [{**effect, "levels": "two"}]})
    assert caplog.messages == []


def test_mistakes():
    with pytest.raises(InputError, match="sigma: is not a parameter of row_noise; expected one of sigma_e"):
        RowNoise(sigma=1.0)
    with pytest.raises(InputError, match=r"row_noise.sigma_e: -1 is out of range"):
        RowNoise(sigma_e=-1)
    with pytest.raises(InputError, match="exposure: is not a condition"):
        RowNoise()(torch.zeros(4, 4), exposure=1.0)
    with pytest.raises(InputError, match=r"signal has shape \(4,\)"):
        RowNoise()(torch.zeros(4))


def test_whole_numbers_become_real_ones_and_arrays_are_refused():
    electrons = torch.full((64, 64), 254, dtype=torch.uint8)
    noisy = visaug.effects.RowNoise(sigma_e=5.0)(electrons, seed=1)
    assert noisy.dtype == torch.float32
    assert noisy.max() > 256  # not wrapped; of 64 rows none is beyond with probability 3e-12
    with pytest.raises(InputError, match="ndarray"):
        visaug.effects.RowNoise(sigma_e=5.0)(electrons.numpy())  # pyrefly: ignore[bad-argument-type]


def test_a_range_is_drawn_for_each_image():
    """sqrt of the mean square of U(0.5, 2): 1.32; the ends are covered. 2000 rows of 200 images give each sigma to 1.6 %."""
    signal = torch.full((200, 1, 2000, 1), 100.0)
    noise = RowNoise(sigma_e=(0.5, 2.0))
    sigma = (noise(signal, seed=3) - 100).std((1, 2, 3))
    assert 0.45 < sigma.min().item() < 0.6
    assert 1.85 < sigma.max().item() < 2.15
    # Kolmogorov-Smirnov, one false alarm in 10,000
    assert stats.kstest(sigma.numpy(), stats.uniform(0.5, 1.5).cdf).pvalue > 1e-4
    assert torch.equal(noise(signal[:3], seed=3), noise(signal, seed=3)[:3])


def test_a_range_in_a_camera_is_drawn_for_each_image():
    camera = visaug.Camera.load("sony_imx174").with_effect("row_noise", sigma_e=(0.5, 2.0))
    assert camera.values()["row_noise.sigma_e"] == 1.25
    assert camera.spec.randomize["row_noise.sigma_e"] == {"uniform": [0.5, 2.0]}


@pytest.mark.parametrize("value", [(2.0, 0.5), (-1.0, 2.0), (0.5, "x"), (1.0, 2.0, 3.0)])
def test_a_range_that_is_none_is_refused(value):
    with pytest.raises(InputError):
        RowNoise(sigma_e=value)


@pytest.mark.parametrize("effect", catalogue().values(), ids=list(catalogue()))
def test_a_batch_of_none_stays_one(effect):
    for shape in ((0, 3, 8, 9), (2, 1, 0, 5)):
        for sequence in (False, True):
            assert effect()(torch.zeros(shape, dtype=torch.float64), sequence=sequence).shape == shape
    assert effect()(torch.zeros(0, 1, 4, 4, dtype=torch.uint8)).dtype == torch.float32


@pytest.mark.parametrize(
    "value", [np.float32(1.5), np.float64(1.5), np.array(1.5), torch.tensor(1.5)], ids=str
)
def test_numbers_of_numpy_and_torch_are_numbers(value):
    signal = torch.full((8, 8), 10.0)
    assert torch.equal(RowNoise(sigma_e=value)(signal), RowNoise(sigma_e=1.5)(signal))
    ranges = RowNoise(sigma_e=(value, 2 * value)), RowNoise(sigma_e=(1.5, 3.0))
    assert torch.equal(*(noise(signal) for noise in ranges))
    cameras = [visaug.Camera.load("sony_imx174").with_effect("row_noise", sigma_e=v) for v in (value, 1.5)]
    assert cameras[0].to_yaml() == cameras[1].to_yaml()
    assert torch.equal(*(SystemGain()(signal, bit_depth=bits) for bits in (np.int64(12), 12)))


def test_what_holds_no_number_for_a_parameter_is_refused():
    wanted = torch.nn.Parameter(torch.tensor(1.5))  # whose gradient would be lost
    for value in (True, wanted, np.array([1.0, 2.0]), torch.ones(2), "1.5", None):
        with pytest.raises(InputError, match="sigma_e"):
            RowNoise(sigma_e=value)
    with pytest.raises(InputError, match="inf is out of range"):
        Saturation(full_well_e=(100.0, float("inf")))
    assert Saturation(full_well_e=float("inf"))(torch.ones(2, 2)).sum() == 4


def test_a_pair_of_options_is_no_range():
    with pytest.raises(InputError, match=r"rts_noise.levels: \('two', 'three'\) is not a choice"):
        RTSNoise(levels=("two", "three"))
    with pytest.raises(InputError, match=r"levels: \('two', 'three'\) is not a choice"):
        visaug.Camera.load("sony_imx174").with_effect("rts_noise", levels=("two", "three"))


@pytest.mark.parametrize("three", [np.int64(3), np.uint8(3), torch.tensor(3)], ids=repr)
def test_a_seed_is_a_whole_number_of_any_type(three):
    signal = torch.full((2, 1, 8, 8), 10.0)
    assert torch.equal(RowNoise()(signal, seed=three), RowNoise()(signal, seed=3))
    assert torch.equal(DSNU(pixel_e=1.0)(signal, camera_seed=three), DSNU(pixel_e=1.0)(signal, camera_seed=3))
    for other in (3.0, "3", None):
        with pytest.raises(InputError, match=r"camera_seed: .* is not valid; expected a whole number"):
            RowNoise()(signal, camera_seed=other)


@pytest.mark.parametrize(
    "condition",
    [
        {"exposure_s": -1.0},
        {"temperature_c": float("nan")},
        {"gain_e_per_dn": 0.0},
        {"full_well_e": -5.0},
        {"quantum_efficiency": 60.0},
        {"bit_depth": 12.5},
        {"bit_depth": 32},
    ],
    ids=str,
)
def test_a_condition_out_of_range_is_refused(condition):
    with pytest.raises(InputError, match=next(iter(condition))):
        RowNoise()(torch.zeros(4, 4), **condition)


def test_no_number_has_no_count():
    light = torch.tensor([[100.0, float("nan")]])
    count = visaug.effects.PhotonShotNoise()(light)
    assert count.isnan().tolist() == [[False, True]]
    assert count[0, 0] > 0
