"""Motion, defocus and diffraction against direct integration of their kernels over pixels."""

import numpy as np
import pytest
import torch
from scipy.ndimage import convolve
from scipy.special import j1

torch.manual_seed(8)
SCENE = torch.rand(3, 1, 47, 58) ** 5 * 4000


def kernel_of(run_effect, name, side=61, **parameters):
    """What a point in the middle becomes, as shares."""
    point = torch.zeros(1, 1, side, side, dtype=torch.float64)
    point[..., side // 2, side // 2] = 1e6
    return (run_effect(name, point, **parameters)[0, 0] / 1e6).numpy()


def collected(x, y, side=61):
    """Shares of points (x right, y up) in px that fall on each pixel."""
    edges = np.arange(side + 1) - side / 2
    shares, _, _ = np.histogram2d(-y.ravel(), x.ravel(), bins=(edges, edges))
    return shares / x.size


@pytest.mark.parametrize(
    ("length", "angle"), [(6.3, 0.0), (6.3, 90.0), (11.7, 33.0), (8.0, -120.0), (2.4, 135.0)]
)
def test_motion_is_a_line_collected_by_pixels(run_effect, length, angle):
    """One million points evenly along the line: a pixel's share is known to 1e-6 of it."""
    along = ((np.arange(10**6) + 0.5) / 10**6 - 0.5) * length
    turn = np.deg2rad(angle)
    expected = collected(along * np.cos(turn) + 1e-9, along * np.sin(turn) + 1e-9)
    kernel = kernel_of(run_effect, "motion_blur", length_px=length, angle_deg=angle)
    np.testing.assert_allclose(kernel, expected, atol=2e-5)


@pytest.mark.parametrize("radius", [0.7, 1.6, 5.3])
def test_defocus_is_a_disc_collected_by_pixels(run_effect, radius):
    """A grid of 200 x 200 points in each pixel, right to 1e-3 of a pixel in the rim; so are the strips."""
    away = (np.arange(13 * 200) + 0.5) / 200 - 6.5
    x, y = np.meshgrid(away, away)
    inside = x**2 + y**2 < radius**2
    kernel = kernel_of(run_effect, "defocus", radius_px=radius)
    np.testing.assert_allclose(kernel, collected(x[inside], y[inside]), atol=2e-3 / (np.pi * radius**2))


@pytest.mark.parametrize("radius", [0.5, 1.1, 3.2])
def test_diffraction_is_an_airy_pattern_collected_by_pixels(run_effect, radius):
    """The pattern's integral over pixels by midpoints, 60 a pixel; the mirrored frame adds less than 1e-4 there."""
    fine = 60
    away = (np.arange(21 * fine) + 0.5) / fine - 10.5
    v = 3.8317059702 * np.hypot(away[:, None], away) / radius
    airy = (2 * j1(v) / v) ** 2 * 3.8317059702**2 / (4 * np.pi * radius**2)  # of unit volume
    expected = airy.reshape(21, fine, 21, fine).mean((1, 3))
    kernel = kernel_of(run_effect, "diffraction", side=201, radius_px=radius)[90:111, 90:111]
    np.testing.assert_allclose(kernel, expected, atol=2e-4)
    assert kernel.min() >= 0


@pytest.mark.parametrize(
    ("name", "given"),
    [("motion_blur", {"length_px": 5.5, "angle_deg": 25.0}), ("defocus", {"radius_px": 2.2})],
)
def test_the_scene_is_convolved_and_goes_on_beyond_its_edge(run_effect, name, given):
    kernel = kernel_of(run_effect, name, **given)[20:41, 20:41]
    out = run_effect(name, SCENE, **given)
    for image, blurred in zip(SCENE[:, 0].double().numpy(), out[:, 0].numpy()):
        np.testing.assert_allclose(blurred, convolve(image, kernel, mode="nearest"), rtol=1e-4, atol=0.02)


@pytest.mark.parametrize(
    ("name", "given"), [("motion_blur", "length_px"), ("defocus", "radius_px"), ("diffraction", "radius_px")]
)
def test_each_image_has_its_own_blur_and_a_flat_stays_flat(run_effect, name, given):
    out = run_effect(name, SCENE, **{given: [0.0, 1.7, 9.0]})
    assert torch.equal(out[0], SCENE[0])
    torch.testing.assert_close(out[1:2], run_effect(name, SCENE[1:2], **{given: 1.7}), rtol=1e-4, atol=0.02)
    flat = torch.full_like(SCENE, 321.0)
    torch.testing.assert_close(run_effect(name, flat, **{given: 6.0}), flat, rtol=1e-4, atol=0)


def test_diffraction_keeps_the_total(run_effect):
    out = run_effect("diffraction", SCENE, radius_px=4.0)
    torch.testing.assert_close(out.double().sum((1, 2, 3)), SCENE.double().sum((1, 2, 3)), rtol=1e-5, atol=0)
