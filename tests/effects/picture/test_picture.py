"""Effects on the developed picture against Pillow, SciPy and the published formulas."""

import io

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.ndimage import correlate1d, gaussian_filter
from scipy.stats import norm

from visaug.camera import Camera
from visaug.core.errors import InputError
from visaug.effects import JPEG, PictureQuantization, Sharpening, ToneCurve


@pytest.fixture(scope="module")
def picture():
    """Smooth colours, an edge, and noise; 8 bit; sides that are no multiples of 8."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:75, :101] / 100
    smooth = np.stack([0.2 + 0.6 * x, 0.5 + 0.3 * np.sin(9 * y), 0.7 - 0.5 * x * y], axis=-1)
    smooth[20:40, 30:60] += 0.2
    noisy = smooth + 0.03 * rng.standard_normal(smooth.shape)
    return (noisy.clip(0, 1) * 255).round().astype(np.uint8)


def by_pillow(array, **options):
    file = io.BytesIO()
    Image.fromarray(array).save(file, "JPEG", **options)
    return np.asarray(Image.open(file)).astype(int)


def by_us(array, **options):
    planes = torch.from_numpy(array).float() / 255
    planes = planes[None] if array.ndim == 2 else planes.permute(2, 0, 1)
    out = (JPEG(**options)(planes) * 255).round().int().numpy()
    return out[0] if array.ndim == 2 else out.transpose(1, 2, 0)


@pytest.mark.parametrize("quality", [20, 75, 92, 100])
@pytest.mark.parametrize(("chroma", "subsampling"), [("half", 2), ("full", 0)])
def test_jpeg_is_that_of_libjpeg(picture, quality, chroma, subsampling):
    """libjpeg's transforms round on the way, and a coefficient at a half may fall to the other side: a difference far below what
    compression itself changes.
    """
    theirs = by_pillow(picture, quality=quality, subsampling=subsampling)
    ours = by_us(picture, quality=quality, chroma=chroma)
    gap = np.abs(ours - theirs)
    change = np.abs(
        theirs - picture.astype(int)
    ).mean()  # 5 to 7 levels, or 0.5 at full chroma and quality 100
    assert gap.mean() < 0.2 * change or quality == 100
    assert gap.mean() < 1
    assert (gap > 3).mean() < 0.05


@pytest.mark.parametrize("quality", [30, 85])
def test_gray_jpeg_is_that_of_libjpeg(picture, quality):
    gray = picture[..., 0].copy()
    gap = np.abs(by_us(gray, quality=quality) - by_pillow(gray, quality=quality))
    assert gap.mean() < 0.6
    assert (gap > 3).mean() < 0.04


def test_jpeg_lets_gradients_through(picture):
    x = (torch.from_numpy(picture).float() / 255).permute(2, 0, 1).requires_grad_()
    JPEG(quality=60)(x).sum().backward()
    inner = x.grad[:, 8:-16, 8:-16]
    assert inner.mean() == pytest.approx(1, abs=0.02)


def test_tone_curves():
    y = torch.linspace(0, 1, 1001).view(1, -1)
    np.testing.assert_allclose(ToneCurve(gamma=1.8)(y), y.numpy() ** (1 / 1.8), atol=1e-4)
    assert torch.allclose(ToneCurve(gamma=1.0)(y), y, rtol=1e-6, atol=0)
    # IEC 61966-2-1: 18 % gray is 0.4614 (117.6 of 255), 0.002 lies on the straight part.
    srgb = ToneCurve(curve="srgb")(torch.tensor([[0.18, 0.002, 1.0]]))
    np.testing.assert_allclose(srgb[0], [0.461356, 0.02584, 1.0], atol=1e-5)
    assert ToneCurve(gamma=2.2)(torch.zeros(1, 1)).item() == 0


def test_tone_curve_has_a_finite_gradient_at_black():
    x = torch.zeros(2, 2, requires_grad=True)
    ToneCurve(gamma=2.2)(x).sum().backward()
    assert torch.isfinite(x.grad).all()


def test_tone_curve_from_a_table(tmp_path):
    table = np.array([0.0, 0.4, 0.7, 0.9, 1.0], np.float32)
    np.save(tmp_path / "curve.npy", table)
    content = "resolution: [8, 8]\ngain_e_per_dn: 1\neffects:\n  - {name: tone_curve, map: curve.npy}\n"
    (tmp_path / "camera.yaml").write_text(content)
    camera = Camera.load(tmp_path / "camera.yaml")
    assert Camera.load(tmp_path / "camera.yaml").to_yaml() == camera.to_yaml()
    values = torch.rand(1, 1, 8, 8)
    out = camera.finish(values, None)
    np.testing.assert_allclose(out, np.interp(values, np.linspace(0, 1, 5), table), atol=1e-6)
    np.save(tmp_path / "curve.npy", table * 2)
    with pytest.raises(InputError, match="above 1"):
        Camera.load(tmp_path / "camera.yaml")


@pytest.mark.parametrize(("amount", "radius"), [(0.6, 0.5), (1.2, 2.0)])
def test_sharpening_is_an_unsharp_mask(picture, amount, radius):
    plane = picture[..., 1] / 255
    reach = int(4 * radius + 1)
    weights = np.diff(norm.cdf(np.arange(-reach, reach + 2) - 0.5, scale=radius))
    weights /= weights.sum()
    blurred = correlate1d(correlate1d(plane, weights, 0, mode="nearest"), weights, 1, mode="nearest")
    expected = np.clip(plane + amount * (plane - blurred), 0, 1)
    np.testing.assert_allclose(
        Sharpening(amount=amount, radius_px=radius)(torch.tensor(plane)), expected, atol=1e-5
    )
    if radius > 1:  # of a wide Gaussian the pixels' share is its value: SciPy's own
        np.testing.assert_allclose(
            blurred, gaussian_filter(plane, np.sqrt(radius**2 + 1 / 12), mode="nearest"), atol=1e-3
        )


def test_picture_quantization(picture):
    y = torch.linspace(0, 1, 4001).view(1, -1)
    out = PictureQuantization(bits=5)(y)
    np.testing.assert_allclose(out, np.rint(y.double().numpy() * 31) / 31, atol=1e-6)
    assert len(out.unique()) == 32
