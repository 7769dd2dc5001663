"""An image keeps its brightness through every shipped camera, whatever its spreads draw.

Each of 1,000 draws takes one image of even blocks, 16 x 16 pixels each. A bound on one draw's block holds up to five
standard errors of that block, measured as temporal and fixed noise together: 1e-5 for each of some 10^5 blocks would be
one, so draws are allowed six. Means over all draws have errors a thousandth of the bounds. Colour cameras are taken without
their filters, whose demosaicing mixes neighbouring blocks; test_colour.py has the same law for flat pictures.
"""

import pytest
import torch

from visaug.augment import SensorNoise
from visaug.camera import Camera, shipped

LEVELS = torch.tensor([0.5, 0.9, 0.925, 0.95, 0.975, 1.0])
DRAWS, SIDE = 1000, 16
BLOCKS = LEVELS.repeat_interleave(SIDE).view(1, 1, 1, -1).expand(DRAWS, 1, SIDE, -1)
ERRORS = 6


@pytest.fixture(scope="module", params=sorted(shipped()))
def taken(request) -> tuple[torch.Tensor, torch.Tensor]:
    """Means of the blocks and their standard errors, (draws, levels) each."""
    camera = Camera.load(request.param)
    images = SensorNoise(camera, seed=11, mono=True)(BLOCKS.contiguous()).view(DRAWS, SIDE, len(LEVELS), SIDE)
    # Rows and columns share noise, so the error of a block's mean is taken from the means of its rows and columns.
    means = images.mean((1, 3))
    rows, columns = images.mean(3).var(1) / SIDE, images.mean(1).var(2) / SIDE
    return means, (rows + columns).sqrt()


def test_flat_levels_keep_their_mean(taken):
    means, errors = taken
    for level, bound in ((0.5, 0.005), (0.9, 0.01)):
        k = LEVELS.tolist().index(pytest.approx(level))
        off = (means[:, k] - level).abs()
        assert off.sub(bound * level + ERRORS * errors[:, k]).max() < 0
        assert abs(means[:, k].mean() - level) < bound * level


def test_white_is_white(taken):
    means, errors = taken
    assert (means[:, -1] + errors[:, -1]).min() > 0.97
    assert means[:, -1].mean() > 0.98


def test_the_top_of_a_ramp_keeps_its_steps(taken):
    means, errors = taken
    rise, error = means[:, -1] - means[:, 1], (errors[:, -1] ** 2 + errors[:, 1] ** 2).sqrt()
    assert (rise + ERRORS * error).min() > 0.075
    steps = means[:, 1:].mean(0).diff()
    assert steps.min() > 0.01  # the last one is short of 0.025 by the noise that the converter cuts


@pytest.mark.parametrize("fast", [True, False], ids=["fast", "exact"])
@pytest.mark.parametrize(
    ("content", "white_e"),
    [
        ({"black_level_dn": 400}, (4095 - 400) * 1.7),
        ({"black_level_dn": 400, "full_well_e": 3000.0}, 3000.0),
        ({"black_level_dn": 400, "full_well_e": 5e5}, (4095 - 400) * 1.7),
    ],
    ids=["converter", "well", "large well"],
)
def test_noise_counts_the_electrons_of_saturation(content, white_e, fast):
    """Variance 1/N of a Poisson count: at half of saturation N is half of min(full well, (max - black) G)."""
    camera = Camera.load({"resolution": [300, 300], "bit_depth": 12, "gain_e_per_dn": 1.7, **content})
    flat = SensorNoise(camera, fast=fast)(torch.full((1, 1, 300, 300), 0.5)).double()
    expected = 0.5 / white_e + 1 / 12 * (1.7 / white_e) ** 2
    assert flat.var().item() == pytest.approx(expected, rel=5 * (2 / 300**2) ** 0.5)
    assert abs(flat.mean() - 0.5) < 5 * expected**0.5 / 300


def test_the_papers_reading_takes_the_whole_range():
    """Eq. 7: mu_p = I (2^bits - 1) G / QE, whatever the black level is; DN over the whole range."""
    content = {"resolution": [300, 300], "bit_depth": 12, "gain_e_per_dn": 1.7, "black_level_dn": 400}
    camera = Camera.load({**content, "reading": "paper", "quantum_efficiency": 0.5})
    flat = SensorNoise(camera, black_level="keep")(torch.full((1, 1, 300, 300), 0.3))
    assert flat.mean().item() == pytest.approx(0.3 + 400 / 4095, abs=5 * flat.std().item() / 300)
    assert SensorNoise(camera)(torch.ones(1, 1, 8, 8)).max() < 1 - 390 / 4095
