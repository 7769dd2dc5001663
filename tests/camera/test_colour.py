"""The colour path against an independent camera in NumPy."""

import itertools

import numpy as np
import pytest
import torch
from scipy.ndimage import convolve

from tests.camera import bayer, on_gpu
from visaug import InputError, VISNoise, simulate
from visaug.augment import SensorNoise
from visaug.camera import Camera, colour, fast, shipped
from visaug.camera.colour import ColourPath
from visaug.effects import Defocus
from visaug.frames import FrameRecord, FrameSet

MATRIX = [[1.7, -0.5, -0.2], [-0.3, 1.55, -0.25], [0.05, -0.65, 1.6]]
BALANCE = [1.9, 1.0, 1.5]
COLOUR = {"cfa": "GRBG", "white_balance": BALANCE, "matrix": MATRIX}
CAMERA = {
    "resolution": [96, 96],
    "bit_depth": 12,
    "gain_e_per_dn": 1.6,
    "black_level_dn": 100,
    "quantum_efficiency": 0.55,
    "read_noise": {"sigma_e": 4.2, "shape": 0.14},
    "effects": [{"name": "row_noise", "sigma_e": 3.5}],
}


def camera(**changes) -> Camera:
    return Camera.load({**CAMERA, "colour": {**COLOUR, **changes.pop("colour", {})}, **changes})


@pytest.mark.parametrize("method", ["bilinear", "malvar"])
@pytest.mark.parametrize(
    ("cfa", "origin"), list(itertools.product(["RGGB", "BGGR", "GRBG", "GBRG"], [(0, 0), (3, 2), (5, 7)]))
)
def test_path_there_and_back_is_numpys(cfa, origin, method):
    """Odd sizes, in torch and compiled: the same to float32."""
    path = ColourPath(cfa, BALANCE, MATRIX, method, origin)
    colours = bayer.cfa_map(cfa, (17, 23), origin)
    pictures = torch.rand(2, 3, 17, 23)
    plane = bayer.light(pictures.double().numpy(), colours, BALANCE, MATRIX)
    raw = torch.rand(2, 1, 17, 23)
    expected = [bayer.developed(r[0].double().numpy(), colours, BALANCE, MATRIX, method) for r in raw]
    for gradients in (False, True):  # which takes the compiled loops, or torch
        pictures.requires_grad_(gradients)
        raw.requires_grad_(gradients)
        np.testing.assert_allclose(path.plane(pictures).detach()[:, 0], plane, atol=2e-6)
        np.testing.assert_allclose(path.develop(raw).detach(), np.stack(expected), atol=2e-6)


@pytest.mark.parametrize("method", ["bilinear", "malvar"])
def test_white_stays_white_and_smooth_colours_come_back(method):
    path = ColourPath("RGGB", BALANCE, MATRIX, method)
    white = torch.ones(1, 3, 12, 14)
    torch.testing.assert_close(path.develop(path.plane(white)), white)
    y, x = torch.meshgrid(torch.arange(20) / 100, torch.arange(24) / 100, indexing="ij")
    picture = torch.stack([0.5 + x, 0.4 + 0.5 * y, 0.6 - x + y])[
        None
    ]  # linear: interpolation is exact within
    back = path.develop(path.plane(picture))
    torch.testing.assert_close(back[..., 2:-2, 2:-2], picture[..., 2:-2, 2:-2], atol=1e-5, rtol=0)


def test_light_is_never_negative():
    """Pure green needs negative red in this camera: it is cut, and comes back as the nearest that light makes."""
    green = torch.tensor([0.0, 1.0, 0.0]).view(1, 3, 1, 1).expand(1, 3, 8, 8)
    wide = [[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]]
    path = ColourPath("RGGB", (1, 1, 1), wide)
    assert path.plane(green).min() == 0
    assert path.mosaic(path.light(green)).min() == 0


# Five levels and two colours. Each statistic is asked within 5 standard errors of the difference, estimated over 40 images of each
# camera: of 2 x 6 x 18 comparisons right code fails one with probability 1e-3 at most, once and for all (fixed seeds).
SCENES = [(0.03,) * 3, (0.1,) * 3, (0.3,) * 3, (0.6,) * 3, (0.8,) * 3, (0.5, 0.35, 0.2)]
IMAGES = 40


def statistics(pictures):
    """Per image: mean and sd of each channel, lag-1 along rows and columns, covariances of channels, of row means too."""
    left = pictures - pictures.mean((2, 3), keepdims=True)
    sd = left.std((2, 3))
    found = [*pictures.mean((2, 3)).T, *sd.T]
    for channel in range(3):
        plane, variance = left[:, channel], sd[:, channel] ** 2
        found.append((plane[:, :, 1:] * plane[:, :, :-1]).mean((1, 2)) / variance)
        found.append((plane[:, 1:] * plane[:, :-1]).mean((1, 2)) / variance)
    rows = left[..., 4:-4].mean(3)
    for i, j in ((0, 1), (1, 2), (0, 2)):
        found.append((left[:, i] * left[:, j]).mean((1, 2)))
        found.append((rows[:, i] * rows[:, j]).mean(1))
    return np.stack(found)


def numpy_pictures(scene, method, rng):
    """The chain as a textbook has it: Poisson electrons, Gaussian read and row noise, gain, black level, rounding, clipping."""
    cfa = bayer.cfa_map(COLOUR["cfa"], (96, 96))
    rgb = np.broadcast_to(np.array(scene)[:, None, None], (3, 96, 96))
    full_e = (4095 - 100) * 1.6
    pictures = []
    for _ in range(IMAGES):
        electrons = rng.poisson(bayer.light(rgb, cfa, BALANCE, MATRIX) * full_e)
        volts = electrons + rng.normal(0, 4.2, (96, 96)) + rng.normal(0, 3.5, (96, 1))
        dn = np.clip(np.rint(volts / 1.6 + 100), 0, 4095)
        raw = np.clip((dn - 100) / (4095 - 100), 0, 1)
        pictures.append(bayer.developed(raw, cfa, BALANCE, MATRIX, method))
    return np.stack(pictures)


@pytest.mark.parametrize("method", ["bilinear", "malvar"])
@pytest.mark.parametrize("quick", [True, False])
def test_noise_is_that_of_an_independent_colour_camera(method, quick):
    noise = SensorNoise(camera(colour={"demosaic": method}), seed=6, fast=quick)
    rng = np.random.default_rng(11)
    for scene in SCENES if quick else SCENES[2:3]:
        ours = noise(torch.tensor(scene).view(1, 3, 1, 1).expand(IMAGES, 3, 96, 96)).double().numpy()
        pair = statistics(ours), statistics(numpy_pictures(scene, method, rng))
        gap = pair[0].mean(1) - pair[1].mean(1)
        error = np.sqrt(sum(s.var(1, ddof=1) / IMAGES for s in pair))
        assert (np.abs(gap) < 5 * error).all(), (scene, gap / error)


def test_the_path_of_a_gpu_has_the_same_law(monkeypatch):
    """Its expressions run on the CPU, in torch operators: one level, as above."""
    monkeypatch.setattr(fast, "take", on_gpu.take)
    monkeypatch.setattr(colour, "_loops", lambda tensor: None)
    noise = SensorNoise(camera(), seed=9)
    ours = noise(torch.tensor((0.5, 0.35, 0.2)).view(1, 3, 1, 1).expand(IMAGES, 3, 96, 96)).double().numpy()
    theirs = numpy_pictures((0.5, 0.35, 0.2), "bilinear", np.random.default_rng(5))
    pair = statistics(ours), statistics(theirs)
    error = np.sqrt(sum(s.var(1, ddof=1) / IMAGES for s in pair))
    assert (np.abs(pair[0].mean(1) - pair[1].mean(1)) < 5 * error).all()


def test_gray_images_and_half_precision():
    """One channel is taken as gray, and gives the luminance of the colour picture; float16 in, float16 out."""
    gray = torch.full((3, 1, 31, 45), 0.4, dtype=torch.float16)
    noise = VISNoise(camera())
    out = noise(gray)
    assert out.shape == gray.shape
    assert out.dtype == torch.float16
    three = noise(gray.expand(-1, 3, -1, -1), params=noise._params).float()
    weights = torch.tensor([0.2126, 0.7152, 0.0722]).view(1, 3, 1, 1)
    torch.testing.assert_close(out.float(), (weights * three).sum(1, keepdim=True), atol=1e-3, rtol=0)
    assert (three[:, 0] - three[:, 1]).abs().max() > 0.01  # gray light, but chroma noise


@pytest.mark.parametrize("name", [name for name in sorted(shipped()) if Camera.load(name).spec.colour])
def test_shipped_colour_cameras_keep_the_brightness(name):
    """Whatever is drawn: a flat keeps its mean within 0.5 %, and white loses what the range cuts off its noise and no more.

    Of Gaussian noise that is cut at white, 0.4 standard deviations are lost, of that cut before and after the colour matrix at
    most 0.8. 200 images of 400 pixels: means have errors below 0.1 %.
    """
    noise = SensorNoise(name, seed=5)
    flat = noise(torch.full((200, 3, 20, 20), 0.5))
    assert (flat.mean((0, 2, 3)) - 0.5).abs().max() < 0.005 * 0.5
    lost = 1 - noise(torch.ones(200, 3, 20, 20)).mean((0, 2, 3))
    deviation = noise(torch.full((200, 3, 20, 20), 0.75)).std((2, 3)).mean(0) * (1 / 0.75) ** 0.5
    assert (lost > 0).all()
    assert (lost < 0.8 * deviation).all()


@pytest.mark.parametrize("quick", [True, False])
def test_a_nan_stays_with_its_neighbours(quick):
    """Red at a green pixel: bilinear interpolation hands it to the eight around it, the matrix to all channels."""
    picture = torch.full((1, 3, 20, 20), 0.5)
    picture[0, 0, 7, 8] = torch.nan
    lost = SensorNoise(camera(), seed=1, fast=quick)(picture).isnan().any(1)[0]
    rows, columns = (lost.nonzero() - torch.tensor([7, 8])).abs().amax(0).tolist()
    assert lost[7, 8]
    assert max(rows, columns) <= 2


def test_mono_forces_either():
    flat = torch.full((1, 3, 40, 50), 0.4)
    one = VISNoise(camera(), mono=True)(flat)
    assert torch.equal(one[:, 0], one[:, 2])
    three = (VISNoise(camera(), mono=False)(flat) - flat)[0].flatten(1)
    assert torch.corrcoef(three)[0, 1:].abs().max() < 5 / 2000**0.5
    without = {key: value for key, value in camera().to_dict().items() if key != "colour"}
    plain = SensorNoise(Camera.load(without), seed=3)
    assert torch.equal(plain(flat), SensorNoise(camera(), mono=True, seed=3)(flat))


def test_a_population_of_both_kinds():
    both = SensorNoise([camera(), {**CAMERA, "name": "gray"}], seed=2)
    flat = torch.full((16, 3, 20, 20), 0.5)
    draws = both.draw(16)
    noisy = both.apply_draws(flat, draws)
    gray = (noisy[:, 0] == noisy[:, 1]).flatten(1).all(1)
    assert torch.equal(gray, draws["camera"] == 1)


def test_optics_come_before_the_filters_and_the_picture_after():
    """A blur of red and blue stripes leaves no trace of the mosaic; JPEG is the last."""
    quiet = {"bit_depth": 16, "gain_e_per_dn": 500.0, "read_noise": {}, "black_level_dn": 0}
    stripes = torch.zeros(1, 3, 24, 24) + 0.2
    stripes[:, 0, :, ::2] = 0.6
    blurred = camera(**quiet, effects=[{"name": "defocus", "radius_px": 3.0}])
    clean = camera(**quiet, effects=[])
    light = (stripes[0, 0].double().numpy() - 0.2) / 0.4
    point = torch.zeros(1, 1, 11, 11)
    point[..., 5, 5] = 1
    kernel = Defocus(radius_px=3.0)(point)[0, 0].double().numpy()
    expected = stripes.clone()
    expected[0, 0] = torch.from_numpy(0.2 + 0.4 * convolve(light, kernel, mode="nearest")).float()
    ours = SensorNoise(blurred, seed=1)(stripes)
    torch.testing.assert_close(ours, SensorNoise(clean, seed=1)(expected), atol=2e-3, rtol=0)
    coded = camera(**quiet, effects=[{"name": "jpeg", "quality": 80}])
    draws = SensorNoise(clean, seed=1).draw(1)
    raw = SensorNoise(clean, seed=1).apply_draws(stripes, draws)
    assert torch.equal(SensorNoise(coded, seed=1).apply_draws(stripes, draws), coded.finish(raw))


def test_gradients_pass_the_whole_path():
    """Against central differences in the mean over 64 images: the mean follows the light."""
    noise = SensorNoise(camera(), seed=4, fast=False)
    level = torch.tensor(0.4, requires_grad=True)
    picture = (level * torch.tensor([1.0, 0.8, 0.6])).view(1, 3, 1, 1).expand(64, 3, 24, 24)
    out = noise.apply_draws(picture, noise.draw(64)).mean((0, 2, 3))
    for channel, share in enumerate((1.0, 0.8, 0.6)):
        (slope,) = torch.autograd.grad(out[channel], level, retain_graph=True)
        assert slope.item() == pytest.approx(share, abs=0.02)


def test_resolution_of_the_sensor_is_where_the_mosaic_lies():
    fine = camera(resolution=[96, 96])
    flat = torch.full((24, 3, 32, 32), 0.5)
    wide = SensorNoise(fine, seed=1, resolution="sensor")(flat)
    same = SensorNoise(fine, seed=1)(flat.repeat_interleave(3, 2).repeat_interleave(3, 3))
    expected = torch.nn.functional.avg_pool2d(same, 3)
    assert (wide.std() / expected.std()).item() == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("size", [(1, 1), (2, 40)])
def test_too_small_a_picture_is_refused(size):
    with pytest.raises(InputError, match="3 x 3 or more"):
        SensorNoise(camera())(torch.full((1, 3, *size), 0.5))


def test_other_numbers_of_channels_are_refused():
    with pytest.raises(InputError, match="5 channels"):
        SensorNoise(camera())(torch.full((1, 5, 8, 8), 0.5))
    with pytest.raises(InputError, match="black_level"):
        SensorNoise(camera(), black_level="keep")


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"cfa": "RGBG"}, "colour.cfa"),
        ({"cfa": "RGGB", "matrix": [[1, 0, 0.5], [0, 1, 0], [0, 0, 1]]}, "colour.matrix.*sums to 1.5"),
        ({"cfa": "RGGB", "matrix": [[1, 0, 0], [1, 0, 0], [0, 0, 1]]}, "colour.matrix.*no inverse"),
        ({"cfa": "RGGB", "matrix": [[1, 0], [0, 1]]}, "colour.matrix"),
        ({"cfa": "RGGB", "white_balance": [2, 0, 1]}, "colour.white_balance"),
        ({"cfa": "RGGB", "demosaic": "ahd"}, "colour.demosaic"),
        ({"cfa": "RGGB", "gamma": 2}, "colour.gamma: is not a key"),
        ({"white_balance": [2, 1, 1]}, "colour.cfa"),
    ],
)
def test_wrong_keys_are_refused_by_name(wrong, says):
    with pytest.raises(InputError, match=says):
        Camera.load({**CAMERA, "colour": wrong})


def test_file_round_trip(tmp_path):
    one = camera(colour={"demosaic": "malvar"})
    one.save(tmp_path / "camera.yaml")
    again = Camera.load(tmp_path / "camera.yaml")
    assert again.spec.colour == one.spec.colour
    assert again.to_yaml() == one.to_yaml()


def test_frames_of_a_set_are_the_converters_plane():
    """Neither the colour path nor JPEG act on them: the same frames as of a monochrome camera."""
    records = [FrameRecord(0, "a.npy", "bias", 0.01), FrameRecord(1, "b.npy", "flat", 0.01, photons=500.0)]
    plan = FrameSet.from_arrays(records, np.zeros((2, 96, 96), np.uint16), bit_depth=12)
    finished = camera(effects=[*CAMERA["effects"], {"name": "jpeg", "quality": 40}])
    ours, plain = (simulate(one, plan, seed=3) for one in (finished, Camera.load(CAMERA)))
    for k in range(2):
        np.testing.assert_array_equal(ours.read(k), plain.read(k))
