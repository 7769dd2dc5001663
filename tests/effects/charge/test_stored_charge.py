"""Charge while it is stored, shared and transferred."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from visaug.effects.charge.blooming import Blooming


def poisson(mean, shape=(4, 1, 400, 500), seed=1):
    return torch.from_numpy(np.random.default_rng(seed).poisson(mean, shape).astype(np.float32))


def covariance(frames, down, across):
    """Mean product of deviations of pixels so far apart."""
    d = frames.double().numpy() - frames.double().mean().item()
    rows, columns = d.shape[-2:]
    return float((d[..., : rows - down, : columns - across] * d[..., down:, across:]).mean())


# 800 000 pixels: a covariance's standard error is v / 894, a variance's sqrt(2) times that. 5 of them: 1e-6.
ERRORS = 5 / 894


def test_lag_of_one_frame(run_effect):
    """What comes has the mean and the variance of a binomial count."""
    frames = torch.zeros(4, 1, 400, 500)
    frames[1] = 1000.0
    out = run_effect("image_lag", frames, sequence=True, share=0.03).double()
    assert float(out[0].abs().max()) == 0.0
    assert float(out.min()) >= 0
    # 200 000 pixels, 5 standard errors: of the mean 0.06 e-, of the variance 0.016 of it; those of 0.9 e- in the last are fewer
    for frame, mean in ((out[1], 970.0), (out[2], 30.0 * 0.97), (out[3], 0.9)):
        assert float(frame.mean()) == pytest.approx(mean, abs=0.07)
    assert float(out[1].var()) == pytest.approx(1000 * 0.03 * 0.97, rel=0.02)


def test_lag_decays_over_frames_and_batches_and_loses_nothing(run_effect):
    memory, out = {}, []
    for start in (0, 3, 6):
        frames = torch.zeros(3, 1, 100, 100)
        if start == 0:
            frames[0] = 1000.0
        out.append(run_effect("image_lag", frames, sequence=True, memory=memory, share=0.1, decay=0.4))
    out = torch.cat(out).double()
    held, expected = 0.0, []
    for collected in (1000.0, *[0.0] * 8):
        stored = collected + 0.6 * held
        expected.append(0.9 * stored)
        held = 0.4 * held + 0.1 * stored
    # 10 000 pixels, standard deviation 10 e- at most: 5 standard errors
    np.testing.assert_allclose(out.mean((1, 2, 3)).numpy(), expected, atol=0.5)
    whole = out.sum(0) + memory["image_lag.held"][0]
    torch.testing.assert_close(whole, torch.full_like(whole, 1000.0))


def test_lag_keeps_the_noise_of_a_steady_flat(run_effect):
    frames = poisson(300, (8, 1, 400, 500))
    out = run_effect("image_lag", frames, sequence=True, share=0.1)
    late = out[5:].double()  # the first ones have less from before
    assert float(late.mean()) == pytest.approx(300, abs=5 * (300 / 6e5) ** 0.5)
    assert float(late.var()) == pytest.approx(300, rel=5 * (2 / 6e5) ** 0.5)


def test_a_full_photodiode_parts_with_all_but_a_share(run_effect):
    frames = torch.zeros(3, 1, 100, 100)
    frames[:2] = 60000.0
    settings = {"known": {"full_well_e": 11000.0}, "sequence": True, "share": 0.02}
    out = run_effect("image_lag", frames, **settings).double()
    # 10 000 pixels of standard deviation 15 e-: 5 standard errors are 0.75 e-
    np.testing.assert_allclose(out.mean((1, 2, 3)).numpy(), [10780.0, 10780.0, 220.0 * 0.98], atol=0.75)
    assert float(out[1].var()) == pytest.approx(11000 * 0.02 * 0.98, rel=0.08)
    node = run_effect("image_lag", frames, saturates="node", **settings)
    assert float(node[:2].min()) > 11000  # the node that is read clips it after the transfer


def test_lag_of_an_unrelated_image_is_that_of_a_steady_scene(run_effect):
    scene = poisson(300, (2, 1, 20, 20))
    torch.testing.assert_close(run_effect("image_lag", scene, share=0.05, decay=0.5), scene)


def test_cosmic_rays_are_as_many_as_the_exposure_brings(run_effect):
    """The charge of a track is the product of two exponential numbers, its length and its charge per px."""
    frames = torch.zeros(8, 1, 500, 500)
    settings = {"rate_per_mpx_s": 400.0, "length_px": 0.5, "charge_e_per_px": 1000.0}
    out = run_effect("cosmic_rays", frames, known={"exposure_s": 2.0}, **settings)
    expected = 8 * 0.25 * 400 * 2.0  # 1600 tracks
    total = float(out.double().sum()) / (1000.0 * 0.5)
    # that product has the second moment 4: relative error 2 / sqrt(1600), 4.5 of them 22 %
    assert total == pytest.approx(expected, rel=0.22)
    assert (out > 0).flatten(1).any(1).all()
    assert not torch.equal(out[0], out[1])  # never the same track in the next frame


def test_cosmic_rays_are_straight_lines_of_all_directions(run_effect):
    from scipy.ndimage import label

    frames = torch.zeros(4, 1, 800, 800)
    out = run_effect("cosmic_rays", frames, known={"exposure_s": 1.0}, rate_per_mpx_s=80.0, length_px=20.0)
    angles, widths = [], []
    for image in out[:, 0].numpy():
        tracks, count = label(image > 0, np.ones((3, 3)))
        for k in range(1, count + 1):
            place = np.argwhere(tracks == k)
            if len(place) < 15:
                continue
            spread, axes = np.linalg.eigh(np.cov(place.T))
            widths.append(np.sqrt(spread[0]))
            angles.append(np.arctan2(*axes[:, 1]) % np.pi)
    assert len(angles) > 40
    assert np.median(widths) < 0.5  # px across
    doubled = np.exp(2j * np.array(angles))
    assert abs(doubled.mean()) < 4 / np.sqrt(len(angles))  # Rayleigh's test: exp(-16) is its false-alarm rate


def test_a_short_frame_meets_cosmic_rays_while_it_is_read(run_effect):
    frames = torch.zeros(2, 1, 300, 300)
    known = {"exposure_s": 1e-5}
    assert not run_effect("cosmic_rays", frames, known=known, rate_per_mpx_s=500.0).any()
    assert run_effect("cosmic_rays", frames, known=known, rate_per_mpx_s=500.0, readout_s=1.0).any()


def test_cosmic_rays_touch_nothing_else(run_effect):
    scene = poisson(300, (2, 1, 200, 200))
    out = run_effect("cosmic_rays", scene, known={"exposure_s": 1.0}, rate_per_mpx_s=100.0)
    assert (out >= scene).all()
    assert 0 < (out > scene).float().mean() < 0.01


@pytest.mark.parametrize("mean", [1000.0, 8000.0])
def test_brighter_fatter_in_flats(run_effect, mean):
    flats = poisson(mean)
    share = 2e-3
    out = run_effect("brighter_fatter", flats, share_per_ke=share)
    assert float(out.double().sum()) == pytest.approx(float(flats.double().sum()), rel=1e-7)
    a = share / 1000 * mean
    inner = out[..., 1:-1, 1:-1]
    assert covariance(inner, 0, 0) == pytest.approx(mean * ((1 - 4 * a) ** 2 + 4 * a**2), rel=1.5 * ERRORS)
    for down, across in ((0, 1), (1, 0)):
        assert covariance(inner, down, across) == pytest.approx(mean * 2 * a * (1 - 4 * a), abs=mean * ERRORS)


def test_brighter_fatter_reaches_the_neighbour_after_next(run_effect):
    """Noise of a flat sees a kernel of a to each of the four next, tail a to the four after next: its autocorrelation."""
    mean, share, tail = 8000.0, 2e-3, 0.2
    flats = poisson(mean)
    out = run_effect("brighter_fatter", flats, share_per_ke=share, tail=tail)
    assert float(out.double().sum()) == pytest.approx(float(flats.double().sum()), rel=1e-7)
    a = share / 1000 * mean
    kept = 1 - 4 * a * (1 + tail)
    inner = out[..., 2:-2, 2:-2]
    variance = mean * (kept**2 + 4 * a**2 * (1 + tail**2))
    assert covariance(inner, 0, 0) == pytest.approx(variance, rel=1.5 * ERRORS)
    for down, across in ((0, 2), (2, 0)):
        expected = mean * (2 * tail * a * kept + a**2)
        assert covariance(inner, down, across) == pytest.approx(expected, abs=mean * ERRORS)


@pytest.mark.parametrize("beyond", [0.0, 1.0])
def test_a_full_well_turns_light_away_as_long_as_it_falls(run_effect, beyond):
    """Ten wells of light in small steps: each is turned away by what the pixel holds by then."""
    well, light, share = 10000.0, 100000.0, 1e-4
    held, out = 0.0, 0.0
    for _ in range(20000):
        step = light / 20000
        arrives = beyond if held >= well else 1.0
        out += share / 1000 * min(held, well) * step * arrives
        held += step
    spot = torch.zeros(1, 1, 5, 5)
    spot[0, 0, 2, 2] = light
    image = run_effect(
        "brighter_fatter", spot, known={"full_well_e": well}, share_per_ke=share, beyond=beyond
    )
    for row, column in ((1, 2), (3, 2), (2, 1), (2, 3)):
        assert float(image[0, 0, row, column]) == pytest.approx(out, rel=2e-3)
    assert float(image.sum()) == pytest.approx(light, rel=1e-6)


def test_brighter_fatter_of_one_row(run_effect):
    """Nothing lies above or below: charge goes along the row alone, and is kept."""
    row = torch.tensor([[[[100.0, 9000.0, 200.0, 50.0]]]])
    out = run_effect("brighter_fatter", row, share_per_ke=2e-3, tail=0.1)
    assert float(out.sum()) == pytest.approx(9350.0, rel=1e-6)
    assert out[0, 0, 0, 1] < 9000
    assert out[0, 0, 0, 3] > 50


def test_brighter_fatter_widens_bright_stars_alone(run_effect):
    y, x = np.mgrid[-12:13, -12:13]
    star = torch.from_numpy(np.exp(-(x**2 + y**2) / (2 * 1.5**2)).astype(np.float32))[None, None]

    def width(peak):
        out = run_effect("brighter_fatter", peak * star, share_per_ke=2e-3)[0, 0].double().numpy()
        assert out.min() >= 0
        return (out * x**2).sum() / out.sum()

    # sum of a (N_i^2 - N_j^2) / 2 over pairs, times the moment each moves: a peak / 2
    assert width(1.0) == pytest.approx(1.5**2, rel=1e-3)
    assert width(10000.0) - width(1.0) == pytest.approx(2e-6 * 10000 / 2, rel=0.02)


def queue(column, well, share):
    """Blooming pixel by pixel: each direction carries half of the excess on until it finds room."""
    column = column.astype(float).copy()
    excess = share * np.maximum(column - well, 0)
    column -= excess
    for order in (range(len(column)), reversed(range(len(column)))):
        carried = 0.0
        for i in order:
            carried += excess[i] / 2
            taken = min(carried, max(0.0, well - column[i])) if excess[i] == 0 else 0.0
            column[i] += taken
            carried -= taken
    return column


@pytest.mark.parametrize("share", [0.4, 1.0])
def test_blooming_is_the_queue_pixel_by_pixel(run_effect, share):
    rng = np.random.default_rng(8)
    scene = rng.uniform(0, 9000, (2, 1, 90, 20)).astype(np.float32)
    scene[rng.uniform(size=scene.shape) < 0.02] = 60000.0
    out = run_effect(
        "blooming", torch.from_numpy(scene), known={"full_well_e": [11000.0, 9500.0]}, share=share
    )
    for image, bloomed, well in zip(scene[:, 0], out[:, 0].numpy(), (11000.0, 9500.0)):
        for k in range(20):
            np.testing.assert_allclose(bloomed[:, k], queue(image[:, k], well, share), rtol=1e-5, atol=0.02)


def test_blooming_keeps_charge_and_is_symmetric(run_effect):
    scene = torch.full((1, 1, 101, 3), 1000.0)
    scene[0, 0, 50, 1] = 111000.0
    out = run_effect("blooming", scene, share=1.0)
    assert float(out.double().sum()) == pytest.approx(float(scene.double().sum()), rel=1e-7)
    torch.testing.assert_close(out, out.flip(-2))
    assert torch.equal(out[..., 0], scene[..., 0])
    assert int((out[0, 0, :, 1] > 10999).sum()) == 11  # the source, and 50 000 e- of room on either side
    below = scene.clamp_max(11000.0)
    assert torch.equal(run_effect("blooming", below, share=1.0), below)


def toppled(image: np.ndarray, well: float, share: float) -> np.ndarray:
    """The fullest pixel passes all it has above the full well to its neighbours, again and again.

    Which pixel comes first makes no difference to the end (Levine and Peres 2009).
    """
    charge = np.pad(image.astype(float) - share * np.maximum(image - well, 0), 1)
    moving = np.pad(share * np.maximum(image.astype(float) - well, 0), 1)
    inside = np.zeros(charge.shape, bool)
    inside[1:-1, 1:-1] = True
    while (excess := np.where(inside, moving, 0.0)).max() > 1e-3:
        i, j = np.unravel_index(excess.argmax(), excess.shape)
        carried, moving[i, j] = moving[i, j], 0.0
        for a, b in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
            taken = min(carried / 4, max(well - charge[a, b], 0.0)) if inside[a, b] else 0.0
            charge[a, b] += taken
            moving[a, b] += carried / 4 - taken
    return charge[1:-1, 1:-1]


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_isotropic_blooming_is_that_of_pixels_toppled_one_by_one(run_effect, share):
    """Two spots that meet, a border near one of them, two full wells; tolerance: what is no longer followed."""
    rng = np.random.default_rng(3)
    scene = rng.uniform(0, 3000, (2, 1, 24, 30)).astype(np.float32)
    scene[:, 0, 11, 12], scene[:, 0, 13, 17], scene[:, 0, 2, 24] = 3e5, 2e5, 5e4
    out = run_effect(
        "blooming",
        torch.from_numpy(scene),
        known={"full_well_e": [11000.0, 9500.0]},
        share=share,
        spread="isotropic",
    )
    for image, bloomed, well in zip(scene[:, 0], out[:, 0].numpy(), (11000.0, 9500.0)):
        np.testing.assert_allclose(bloomed, toppled(image, well, share), rtol=1e-5, atol=1.0)


def test_one_image_with_several_shares_blooms_with_each():
    """As the images of a batch, of which some overflow and some do not."""
    share = torch.tensor([0.0, 0.5, 1.0]).view(-1, 1, 1, 1)
    scene = torch.full((1, 1, 12, 12), 100.0)
    scene[..., 5, 6] = 9000.0
    context = SimpleNamespace(full_well_e=torch.full((1, 1, 1, 1), 1000.0))

    def bloomed(images, shares):
        return Blooming().apply(images, SimpleNamespace(share=shares, spread="isotropic"), None, context)

    together = bloomed(scene, share)
    assert torch.equal(together, bloomed(scene.expand(3, -1, -1, -1), share))
    assert torch.equal(together, torch.cat([bloomed(scene, one) for one in share.split(1)]))


def test_isotropic_blooming_fills_a_disc_and_keeps_the_charge(run_effect):
    """200 full wells fill pi r^2 pixels, r = 8; the border of the disc is no wider than two pixels."""
    scene = torch.zeros(1, 1, 41, 41)
    scene[..., 20, 20] = 200 * 11000.0
    out = run_effect("blooming", scene, share=1.0, spread="isotropic")[0, 0].double()
    assert float(out.sum()) == pytest.approx(200 * 11000.0, rel=1e-5)
    assert torch.allclose(out, out.T)
    assert torch.allclose(out, out.flip(0))
    y, x = torch.meshgrid(torch.arange(41) - 20, torch.arange(41) - 20, indexing="ij")
    away = (x**2 + y**2).sqrt()
    assert bool((out[away < 7] > 10999).all())
    assert bool((out[away > 9] < 1).all())


def test_a_level_above_the_full_well_keeps_the_share_that_finds_no_room(run_effect):
    level = torch.full((1, 1, 20, 20), 15000.0)
    for spread in ("column", "isotropic"):
        out = run_effect("blooming", level, share=0.25, spread=spread)
        torch.testing.assert_close(out, torch.full_like(out, 14000.0))


def test_transfer_leaves_a_trail_that_grows_with_the_transfers(run_effect):
    stars = torch.zeros(1, 1, 300, 2)
    stars[0, 0, 19, 0] = stars[0, 0, 199, 1] = 10000.0  # 20 and 200 transfers from the register at the top
    out = run_effect("charge_transfer_inefficiency", stars, share_per_transfer=2e-4, trail_px=2.0)[
        0, 0
    ].double()
    q = np.exp(-1 / 2.0)
    for column, row in ((0, 19), (1, 199)):
        lost = 10000 * (1 - (1 - 2e-4) ** (row + 1))
        assert float(out[row, column]) == pytest.approx(10000 - lost, rel=1e-6)
        expected = lost * (1 - q) * q ** np.arange(10)
        np.testing.assert_allclose(out[row + 1 : row + 11, column].numpy(), expected, rtol=1e-4)
        assert (out[:row, column] == 0).all()
        assert float(out[:, column].sum()) == pytest.approx(10000, rel=1e-6)


def test_short_trail_agrees_with_transfers_counted_one_by_one(run_effect):
    """Binomial: each of n transfers leaves a share c to the next packet; for small n c once is enough."""
    from scipy.stats import binom

    star = torch.zeros(1, 1, 200, 1)
    star[0, 0, 99, 0] = 1e5
    out = run_effect("charge_transfer_inefficiency", star, share_per_transfer=1e-4, trail_px=0.1)[
        0, 0, 99:101, 0
    ]
    np.testing.assert_allclose(out.numpy(), 1e5 * binom.pmf([0, 1], 100, 1e-4), rtol=6e-3)  # n c / 2 = 0.5 %


@pytest.mark.parametrize("register", ["bottom", "left", "right"])
def test_transfer_to_any_side_is_the_same_turned(run_effect, register):
    turns = {"left": 1, "bottom": 2, "right": 3}[register]  # that bring the register to the top
    scene = poisson(2000, (1, 1, 40, 50))
    settings = {"share_per_transfer": 5e-4, "trail_px": 1.0}
    turned = torch.rot90(scene, -turns, (-2, -1)).contiguous()
    top = run_effect("charge_transfer_inefficiency", turned, **settings)
    out = run_effect("charge_transfer_inefficiency", scene, register=register, **settings)
    torch.testing.assert_close(out, torch.rot90(top, turns, (-2, -1)))


def test_transfers_are_counted_on_the_sensor(run_effect):
    scene = torch.full((1, 1, 100, 4), 1000.0)
    whole = run_effect("charge_transfer_inefficiency", scene, share_per_transfer=1e-3)
    window = (range(40, 80), range(4))
    part = run_effect(
        "charge_transfer_inefficiency",
        scene[..., 40:80, :],
        window=window,
        resolution=(100, 4),
        share_per_transfer=1e-3,
    )
    torch.testing.assert_close(part[..., 20:, :], whole[..., 60:80, :])


@pytest.mark.parametrize(("aspect", "diagonal", "tail"), [(1.0, 0.0, 0.0), (0.6, 0.3, 0.0), (0.8, 0.2, 0.4)])
def test_crosstalk_correlates_noise_alike_at_every_level(run_effect, aspect, diagonal, tail):
    a = 0.02
    kernel = np.zeros((5, 5))
    kernel[1:4, 1:4] = a * np.array([[diagonal, aspect, diagonal], [1, 0, 1], [diagonal, aspect, diagonal]])
    kernel[2, [0, 4]], kernel[[0, 4], 2] = a * tail, a * tail * aspect
    kernel[2, 2] = 1 - kernel.sum()
    for mean in (100.0, 5000.0):
        flats = poisson(mean)
        out = run_effect("interpixel_crosstalk", flats, share=a, aspect=aspect, diagonal=diagonal, tail=tail)
        assert float(out.double().sum()) == pytest.approx(float(flats.double().sum()), rel=1e-6)
        inner = out[..., 2:-2, 2:-2]
        assert covariance(inner, 0, 0) == pytest.approx(mean * (kernel**2).sum(), rel=1.5 * ERRORS)
        for down, across in ((0, 1), (1, 0), (1, 1), (0, 2), (2, 0)):
            overlap = (kernel[down:, across:] * kernel[: 5 - down, : 5 - across]).sum()
            assert covariance(inner, down, across) == pytest.approx(mean * overlap, abs=mean * ERRORS)
    if diagonal == tail == 0:  # the rule of thumb: 2 a of the variance, to first order
        assert (kernel[:, 1:] * kernel[:, :-1]).sum() == pytest.approx(2 * a, rel=8 * a)


def test_crosstalk_of_a_point_is_the_kernel(run_effect):
    point = torch.zeros(1, 1, 5, 5)
    point[0, 0, 2, 2] = 1000.0
    out = run_effect("interpixel_crosstalk", point, share=0.02, aspect=0.5, diagonal=0.25)[0, 0, 1:4, 1:4]
    expected = torch.tensor([[5.0, 10.0, 5.0], [20.0, 920.0, 20.0], [5.0, 10.0, 5.0]])
    torch.testing.assert_close(out, expected)
    out = run_effect("interpixel_crosstalk", point, share=0.02, aspect=0.5, tail=0.5)[0, 0]
    assert out[2].tolist() == pytest.approx([10, 20, 910, 20, 10])
    assert out[:, 2].tolist() == pytest.approx([5, 10, 910, 10, 5])


def test_brighter_fatter_is_aspect_times_as_strong_between_rows(run_effect):
    """Light that changes down the columns alone, and the same along the rows: what pixels gain has the ratio of the strengths."""
    light = 1000 + 500 * torch.sin(torch.linspace(0, 9, 40, dtype=torch.float64)).expand(1, 1, 40, 40)
    settings = {"share_per_ke": 0.002, "aspect": 1.7}
    along = run_effect("brighter_fatter", light, **settings) - light
    down = run_effect("brighter_fatter", light.mT.contiguous(), **settings) - light.mT
    assert along.abs().max() > 0.1
    torch.testing.assert_close(down.mT, 1.7 * along, rtol=1e-6, atol=1e-9)
