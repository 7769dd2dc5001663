"""Electrons that come without light, and light that is collected on the way."""

import numpy as np
import pytest
import torch
from scipy import stats
from scipy.ndimage import distance_transform_cdt

DARK = torch.zeros(1, 1, 300, 400)


@pytest.mark.parametrize(
    ("distribution", "law"),
    [
        ("lognormal", stats.lognorm(s=np.sqrt(np.log(1 + 0.4**2)), scale=1 / np.sqrt(1 + 0.4**2))),
        ("gaussian", stats.norm(1, 0.4)),
        ("exponential", stats.expon(0.6, 0.4)),
    ],
)
def test_dark_current_differs_by_the_stated_law(run_effect, distribution, law):
    dark = torch.full_like(DARK, 20.0)
    out = run_effect("dark_current_nonuniformity", dark, spread=0.4, distribution=distribution)
    factors = out.double().flatten().numpy() / 20
    if distribution == "gaussian":  # no pixel has less than none
        assert factors.min() == 0
        factors, law = factors[factors > 0], stats.truncnorm(-2.5, np.inf, 1, 0.4)
    assert law.std() == pytest.approx(0.4, rel=0.05)
    assert stats.kstest(factors, law.cdf).pvalue > 1e-4  # the false-alarm rate


def test_dark_current_pattern_grows_with_the_dark_current(run_effect):
    def pattern(electrons):
        known = {"dark_current_e": electrons}
        return run_effect(
            "dark_current_nonuniformity", torch.full_like(DARK, electrons), known=known, spread=0.3
        )

    torch.testing.assert_close(pattern(80.0), 4 * pattern(20.0), rtol=1e-5, atol=1e-5)
    assert torch.equal(pattern(0.0), DARK)


@pytest.mark.parametrize("name", ["dark_current_nonuniformity", "hot_pixels"])
def test_pattern_of_a_crop_is_the_crop_of_the_cameras_pattern(run_effect, name):
    frames = torch.full((3, 1, 60, 80), 30.0)
    whole = run_effect(name, frames, keys=[1, 2, 3], cameras=[7, 7, 8])
    assert torch.equal(whole[0], whole[1])
    assert not torch.equal(whole[0], whole[2])
    window = (range(13, 50), range(6, 71))
    part = run_effect(
        name, frames[:1, :, 13:50, 6:71], keys=[9], cameras=[7], window=window, resolution=(60, 80)
    )
    assert torch.equal(part, whole[:1, :, 13:50, 6:71])


@pytest.mark.parametrize("tail", [0.5, 1.0, 2.0])
def test_hot_pixels_are_as_many_and_as_hot_as_stated(run_effect, tail):
    known = {"exposure_s": 0.5, "temperature_c": 30.0}
    density, rate, b = 0.01, 400.0, 0.05
    hot = run_effect(
        "hot_pixels", DARK, known=known, density=density, rate_e_per_s=rate, b_per_c=b, tail=tail
    )
    hot = hot[hot > 0].double().numpy()
    expected = 0.5 * rate * np.exp(b * 10)
    count = DARK.numel() * density
    assert abs(len(hot) - count) < 4 * np.sqrt(count)  # 4 sigma: 6e-5
    law = stats.weibull_min(1 / tail)  # (an exponential number)^tail
    assert stats.kstest(hot / expected * law.mean(), law.cdf).pvalue > 1e-4


def test_gradient_to_the_density_is_that_of_the_mean(run_effect):
    """The mean is density rate t: its derivative by the density is rate t, though pixels are discrete."""
    density = torch.tensor(0.02, requires_grad=True)
    run_effect("hot_pixels", DARK, density=density, rate_e_per_s=100.0).mean().backward()
    # one sum: 2400 hot pixels, each adding rate t / density: 4.5 standard errors are 9 %
    assert float(density.grad) == pytest.approx(50.0, rel=0.09)


def test_glow_falls_from_its_corner_and_grows_with_the_exposure(run_effect):
    settings = {"rate_e_per_s": 30.0, "width": 0.2, "shape": 1.5, "place": "top_right", "b_per_c": 0.02}
    out = run_effect("amplifier_glow", DARK, known={"exposure_s": 2.0, "temperature_c": 30.0}, **settings)
    y, x = np.mgrid[0.5:300, 0.5:400]
    expected = 60 * np.exp(0.2) * np.exp(-((np.hypot(y, 400 - x) / (0.2 * 400)) ** 1.5))
    np.testing.assert_allclose(out[0, 0].numpy(), expected, rtol=1e-4, atol=1e-6)


def test_glow_of_an_edge_is_the_same_all_along_it(run_effect):
    out = run_effect("amplifier_glow", DARK, place="left", rate_e_per_s=10.0)
    assert torch.equal(out, out[:, :, :1].expand_as(out))
    assert (out[0, 0, 0].diff() < 0).all()


def test_glow_of_the_rim_falls_from_the_nearest_side(run_effect):
    out = run_effect("amplifier_glow", DARK, place="rim", rate_e_per_s=10.0, width=0.1)
    inside = np.ones((302, 402))
    inside[0], inside[-1], inside[:, 0], inside[:, -1] = 0, 0, 0, 0
    distance = distance_transform_cdt(inside, "chessboard")[1:-1, 1:-1] - 0.5  # of a pixel's centre
    settings = {"place": "left", "rate_e_per_s": 10.0, "width": 0.1}
    edge = run_effect("amplifier_glow", DARK, **settings)[0, 0, 0].numpy()
    np.testing.assert_allclose(out[0, 0].numpy(), np.interp(distance, np.arange(400) + 0.5, edge), rtol=1e-4)


def test_glow_belongs_to_the_sensor_not_to_the_crop(run_effect):
    window = (range(200, 300), range(100, 400))
    part = run_effect("amplifier_glow", DARK[..., 200:, 100:], window=window, resolution=(300, 400))
    torch.testing.assert_close(part, run_effect("amplifier_glow", DARK)[..., 200:, 100:])


def test_clock_induced_charge_does_not_know_the_exposure(run_effect):
    for exposure in (0.0, 10.0):
        out = run_effect("clock_induced_charge", DARK, known={"exposure_s": exposure}, mean_e=0.7)
        assert torch.equal(out, torch.full_like(DARK, 0.7))


@pytest.mark.parametrize("gradient", [1.0, -0.4])
def test_clock_induced_charge_by_transfers_keeps_its_mean(run_effect, gradient):
    out = run_effect("clock_induced_charge", DARK, mean_e=0.7, gradient=gradient)
    assert float(out.double().mean()) == pytest.approx(0.7, rel=1e-6)
    rows = out[0, 0, :, 0].double().numpy()
    np.testing.assert_allclose(np.diff(rows), 0.7 * gradient * 2 / 300, rtol=1e-3)
    assert torch.equal(out, out[..., :1].expand_as(out))


def test_smear_is_the_columns_mean_whatever_the_distance(run_effect):
    scene = torch.rand(2, 1, 50, 60, generator=torch.Generator().manual_seed(3)) * 1000
    out = run_effect("smear", scene, known={"exposure_s": [0.01, 0.1]}, transfer_s=5e-4)
    expected = scene.numpy() + np.array([0.05, 0.005]).reshape(2, 1, 1, 1) * scene.numpy().mean(
        2, keepdims=True
    )
    np.testing.assert_allclose(out.numpy(), expected, rtol=1e-5)


def test_the_two_shifts_of_a_smear_make_up_the_whole(run_effect):
    """What rows below and rows above give, and the pixel's own share, is what all rows give."""
    scene = torch.rand(1, 1, 50, 60, generator=torch.Generator().manual_seed(4)) * 1000
    both, below, above = (
        run_effect("smear", scene, transfer_s=0.1, passes=way) - scene for way in ("both", "below", "above")
    )
    torch.testing.assert_close(below + above + 0.2 * scene / 50, both, rtol=1e-4, atol=2e-3)
    star = torch.zeros(1, 1, 50, 60)
    star[..., 20, 30] = 1000.0
    trail = (run_effect("smear", star, transfer_s=0.1, passes="below") - star)[0, 0, :, 30]
    assert (trail[:21] == 0).all()
    assert torch.allclose(trail[21:], torch.tensor(4.0))  # 1000 x 0.2 / 50
