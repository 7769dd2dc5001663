"""Light where it does not belong: blur, veil, flare."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.integrate import quad
from scipy.ndimage import correlate1d, gaussian_filter
from scipy.signal import fftconvolve
from scipy.stats import norm

from visaug.effects import catalogue
from visaug.effects.optics import spread

torch.manual_seed(5)
SCENE = torch.rand(3, 1, 61, 83) ** 6 * 5000


def point(rows=81, columns=101, at=(40, 50), photons=1e6):
    image = torch.zeros(1, 1, rows, columns)
    image[0, 0, at[0], at[1]] = photons
    return image


def integrated_gaussian(sigma: float) -> np.ndarray:
    """Over pixels, up to 4 standard deviations and the pixel in which they end."""
    reach = int(4 * sigma + 1)
    weights = np.diff(norm.cdf(np.arange(-reach, reach + 2) - 0.5, scale=sigma))
    return weights / weights.sum()


@pytest.mark.parametrize(("sigma", "aspect"), [(0.15, 1.0), (0.7, 1.0), (2.3, 1.0), (1.5, 0.6)])
def test_point_spread_is_a_gaussian_integrated_over_pixels(run_effect, sigma, aspect):
    out = run_effect("point_spread", SCENE, sigma_px=sigma, aspect=aspect)
    down, across = (integrated_gaussian(s) for s in (sigma * aspect, sigma))
    for image, blurred in zip(SCENE, out):
        expected = correlate1d(image[0].double().numpy(), down, axis=0, mode="nearest")
        expected = correlate1d(expected, across, axis=1, mode="nearest")
        np.testing.assert_allclose(blurred[0].numpy(), expected, rtol=2e-5, atol=1e-3)


def test_each_image_has_its_own_blur(run_effect):
    out = run_effect("point_spread", SCENE, sigma_px=[0.0, 0.8, 3.0])
    assert torch.equal(out[0], SCENE[0])
    torch.testing.assert_close(out[1:2], run_effect("point_spread", SCENE[1:2], sigma_px=0.8))


@pytest.mark.parametrize("effect", ["lens_flare", "veiling_glare"])
def test_equal_images_of_a_batch_are_computed_once_and_are_what_they_are_alone(
    run_effect, monkeypatch, effect
):
    counts, whole = [], spread.filtered
    monkeypatch.setattr(spread, "filtered", lambda s, transfer: counts.append(len(s)) or whole(s, transfer))
    one, other, third = SCENE.split(1)
    images = [one, one, other, one, third, third, third]
    out = run_effect(effect, torch.cat(images))
    assert counts == [4]
    for image, after in zip(images, out, strict=True):
        torch.testing.assert_close(after[None], run_effect(effect, image), rtol=1e-6, atol=1e-3)


def test_equal_images_with_their_own_parameters_stay_apart(run_effect):
    one = SCENE[:1]
    out = run_effect("veiling_glare", torch.cat([one, one]), share=[0.1, 0.4])
    for share, after in zip((0.1, 0.4), out, strict=True):
        torch.testing.assert_close(after[None], run_effect("veiling_glare", one, share=share))


def test_gradients_reach_the_own_parameter_of_every_one_of_equal_images(run_effect):
    """The derivative of each image's light is with respect to its own share, though images and shares are equal."""
    share = torch.full((2, 1, 1, 1), 0.2, requires_grad=True)
    out = run_effect("veiling_glare", torch.cat([SCENE[:1]] * 2), share=share)
    (out.square().mean((1, 2, 3)) * torch.tensor([1.0, 2.0])).sum().backward()
    assert share.grad is not None
    first, second = share.grad.flatten().tolist()
    assert first != 0
    assert second == pytest.approx(2 * first, rel=1e-5)


def test_gradients_reach_every_one_of_equal_images(run_effect):
    images = torch.cat([SCENE[:1]] * 2).requires_grad_()
    (run_effect("veiling_glare", images) * torch.tensor([1.0, 2.0]).view(2, 1, 1, 1)).sum().backward()
    torch.testing.assert_close(images.grad[1], 2 * images.grad[0])


@pytest.mark.parametrize("profile", ["gaussian", "exponential", "power_law"])
@pytest.mark.parametrize("width", [6.0, 40.0, 1e4])
def test_veil_keeps_the_energy_and_leaves_a_flat_flat(run_effect, profile, width):
    out = run_effect("veiling_glare", SCENE, share=0.1, width_px=width, profile=profile)
    torch.testing.assert_close(out.double().sum((1, 2, 3)), SCENE.double().sum((1, 2, 3)), rtol=1e-6, atol=0)
    flat = torch.full_like(SCENE, 700.0)
    torch.testing.assert_close(
        run_effect("veiling_glare", flat, share=0.3, width_px=width, profile=profile), flat
    )


def test_widest_veil_is_the_mean_of_the_scene(run_effect):
    out = run_effect("veiling_glare", SCENE, share=0.2, width_px=1e5)
    torch.testing.assert_close(out, 0.8 * SCENE + 0.2 * SCENE.mean((2, 3), keepdim=True), rtol=1e-4, atol=0.1)


def test_gaussian_veil_is_scipys(run_effect):
    out = run_effect("veiling_glare", SCENE, share=0.1, width_px=9.0, profile="gaussian")
    for image, veiled in zip(SCENE[:, 0].double().numpy(), out[:, 0].numpy()):
        wide = gaussian_filter(image, 9.0, mode="reflect", truncate=8)
        np.testing.assert_allclose(veiled, 0.9 * image + 0.1 * wide, rtol=1e-4, atol=0.05)


KERNELS = {
    "gaussian": lambda r, w: np.exp(-(r**2) / (2 * w**2)) / (2 * np.pi * w**2),
    "exponential": lambda r, w: np.exp(-r / w) / (2 * np.pi * w**2),
    "power_law": lambda r, w: w / (2 * np.pi * (r**2 + w**2) ** 1.5),
}


@pytest.mark.parametrize("profile", KERNELS)
def test_halo_of_a_point_has_the_stated_profile(run_effect, profile):
    """The kernel and its mirror images at the edges; pixels at 3 px and further, where it is smooth."""
    width, kernel = 6.0, KERNELS[profile]
    assert quad(lambda r: 2 * np.pi * r * kernel(r, width), 0, np.inf)[0] == pytest.approx(1)
    out = (
        run_effect("veiling_glare", point(), share=0.5, width_px=width, profile=profile)[0, 0]
        .double()
        .numpy()
    )
    y, x = np.mgrid[:81, :101]
    expected = np.zeros((81, 101))
    for m in range(-6, 7):  # rows and columns of mirrored sources
        for n in range(-6, 7):
            row = 81 * m + (40 if m % 2 == 0 else 80 - 40)
            column = 101 * n + (50 if n % 2 == 0 else 100 - 50)
            expected += 0.5e6 * kernel(np.hypot(y - row, x - column), width)
    far = np.hypot(y - 40, x - 50) > 3
    missing = 2e-2 if profile == "power_law" else 0  # sources beyond the sixth, of a slowly falling kernel
    np.testing.assert_allclose(out[far], expected[far], rtol=2e-2 + missing, atol=2)


@pytest.mark.parametrize("profile", KERNELS)
def test_with_a_black_surround_no_light_returns(run_effect, profile):
    rows, columns = SCENE.shape[-2:]
    y, x = np.mgrid[1 - rows : rows, 1 - columns : columns]
    kernel = KERNELS[profile](np.hypot(y, x), 6.0)
    out = run_effect("veiling_glare", SCENE, share=0.2, width_px=6.0, profile=profile, surround=0.0)
    for image, veiled in zip(SCENE[:, 0].double().numpy(), out[:, 0].double().numpy(), strict=True):
        own = fftconvolve(image, kernel)[rows - 1 : 2 * rows - 1, columns - 1 : 2 * columns - 1]
        np.testing.assert_allclose(veiled, 0.8 * image + 0.2 * own, rtol=1e-4, atol=0.05)


def test_moments_are_those_of_a_flat_only_where_the_scene_goes_on_alike():
    glare, mean = catalogue()["veiling_glare"](), torch.full((1, 1, 4, 4), 1000.0)
    alike, black = (SimpleNamespace(surround=torch.full((1, 1, 1, 1), s)) for s in (1.0, 0.0))
    assert glare.moments(mean, alike, None)[0] is mean
    assert glare.moments(mean, black, None) is None


def test_light_of_the_surround_adds_to_that_of_the_frame(run_effect):
    """Half of the light at an edge comes from beyond it, three quarters in a corner."""
    flat = torch.full((3, 1, 80, 100), 1000.0)
    surround = torch.tensor([0.0, 0.5, 2.0]).view(3, 1, 1, 1)
    out = run_effect(
        "veiling_glare", flat, share=0.1, width_px=10.0, profile="gaussian", surround=surround
    ).double()
    # the middle of the first pixel is half a pixel within the edge
    inside = 0.5 + 0.5 * norm.pdf(0, scale=10.0)
    for s, image in zip((0.0, 0.5, 2.0), out[:, 0], strict=True):
        for place, part in (((0, 50), inside), ((0, 0), inside**2), ((40, 50), 1.0)):
            expected = 900 + 100 * (part + s * (1 - part))
            assert float(image[place]) == pytest.approx(expected, abs=0.1)


def test_ghost_lies_across_the_centre_and_carries_its_share(run_effect):
    source = point(at=(30, 40))  # 10 rows, 10 columns from the centre (40, 50)
    out = run_effect(
        "lens_flare", source, ghost_share=0.1, halo_share=0.0, ghost_scale=1.5, ghost_blur_px=1.5
    )
    out = out[0, 0].double().numpy()
    assert out[30, 40] == pytest.approx(0.9e6, rel=1e-3)
    y, x = np.mgrid[:81, :101]
    first = np.hypot(y - 55, x - 65) < 8.5  # at -1.5 times the source's place; the second at -2.7 times
    second = np.hypot(y - 67, x - 77) < 13
    near, far = out * first, out * (second & ~first)
    assert near.sum() == pytest.approx(0.07e6, rel=0.02)
    assert far.sum() == pytest.approx(0.03e6, rel=0.03)
    assert (near * y).sum() / near.sum() == pytest.approx(55, abs=0.1)
    assert (near * x).sum() / near.sum() == pytest.approx(65, abs=0.1)


def test_flare_keeps_the_energy_where_its_ghosts_stay_on_the_sensor(run_effect):
    source = point(at=(35, 45))
    out = run_effect("lens_flare", source, ghost_share=0.05, halo_share=0.1)
    assert float(out.double().sum()) == pytest.approx(1e6, rel=2e-3)


def test_flare_of_a_crop_is_the_crop_of_the_flare_of_what_it_holds(run_effect):
    """A source and its ghost inside the window: ghosts know the sensor's centre, not the window's."""
    source = point(at=(36, 47))
    rows, columns = range(20, 70), range(30, 90)
    settings = {"ghost_share": 0.1, "halo_share": 0.0}
    whole = run_effect("lens_flare", source, **settings)[..., 20:70, 30:90]
    part = run_effect(
        "lens_flare", source[..., 20:70, 30:90], window=(rows, columns), resolution=(81, 101), **settings
    )
    torch.testing.assert_close(part, whole, rtol=1e-4, atol=0.5)


def test_threshold_leaves_the_dim_scene_alone(run_effect):
    dim = SCENE.clamp_max(1000)
    assert torch.equal(run_effect("lens_flare", dim, threshold_photons=2000.0), dim)
