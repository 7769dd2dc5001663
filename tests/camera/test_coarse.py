"""Numbers of few bits in the fast path: the law where they are used, and where they are not.

False alarms: every test fails by chance with a probability of 1e-5 at most.
"""

import numpy as np
import pytest
import torch
from scipy import stats

from visaug.camera import Camera, coarse, fast, tables
from visaug.camera.scale import Scale

pytest.importorskip("numba")

ALARM = 1e-5
WHITE_E = 9000.0
CONTENT = {
    "resolution": [64, 64],
    "gain_e_per_dn": 0.7,
    "black_level_dn": 500,
    "read_noise": {"sigma_e": 3.1, "shape": -0.17},
    "dsnu": {"pixel_e": 1.3},
    "prnu": {"pixel": 0.007},
}


def taken(images: torch.Tensor, keys: torch.Tensor, origin: tuple[int, int] = (0, 0)) -> torch.Tensor:
    cam = Camera.load(CONTENT)
    values = {path: np.array([value]) for path, value in cam.values().items()}
    scale = Scale(np.array([WHITE_E]), np.zeros(1), np.array([1 / 65535]))
    return fast.take(cam, images, scale, values, keys, keys + 1, origin=origin)


def is_coarse(**changes: float) -> bool:
    cam = Camera.load(CONTENT).replace(changes)
    values = {path: np.array([value]) for path, value in cam.values().items()}
    numbers = fast._numbers(
        cam, 1, Scale(np.array([WHITE_E]), np.zeros(1), np.array([1 / 65535])), values, False
    )
    return bool(fast._coarse(numbers, tables.tukey_tables(values["read_noise.shape"]))[0])


def test_they_are_used_only_where_each_law_hides_the_other():
    assert is_coarse()
    assert not is_coarse(**{"read_noise.sigma_e": 0.3})  # the count's comb would show
    assert not is_coarse(**{"dsnu.pixel_e": 0.05})  # that of the read noise
    assert not is_coarse(**{"dsnu.pixel_e": 0.0})  # and whole electrons


@pytest.mark.parametrize("level", [0.0, 700.0, 8500.0])
def test_cumulants_and_tails(level):
    """Against moments from theory, and the tails of an independent sample of 16 million."""
    size = 2048
    dn = taken(torch.full((2, 1, size, size), level / WHITE_E), torch.tensor([31, 47])).double() * 65535
    drawn = (dn.round().numpy().ravel() - 500) * 0.7
    rng = np.random.default_rng(8)
    u = rng.random(2 * drawn.size)
    tukey = stats.tukeylambda.ppf(u, -0.17) / stats.tukeylambda.std(-0.17)
    light = np.maximum(level * (1 + 0.007 * rng.standard_normal(u.size)), 0)
    other = rng.poisson(light) + 1.3 * rng.standard_normal(u.size) + 3.1 * tukey
    other = np.round(other / 0.7) * 0.7
    deviation = np.sqrt(level + (0.007 * level) ** 2 + 1.3**2 + 3.1**2 + 0.7**2 / 12)
    assert abs(drawn.mean() - level) < 4.5 * deviation / drawn.size**0.5
    for p in (0.1, 1e-2, 2e-3, 1e-3, 1e-4, 1e-5):  # 2^-9 is where the tails begin
        low, high = np.quantile(other, [p, 1 - p])
        for inside, outside in ((drawn <= low, other <= low), (drawn >= high, other >= high)):
            pooled = (inside.sum() + outside.sum()) / (drawn.size + other.size)
            error = np.sqrt(pooled * (1 - pooled) * (1 / drawn.size + 1 / other.size))
            assert abs(inside.mean() - outside.mean()) < 5.5 * error


def test_the_place_decides_a_pixels_number():
    image = torch.rand(1, 1, 9, 40)
    whole = taken(image, torch.tensor([5]))
    for row, column in ((0, 3), (2, 8)):
        part = taken(image[..., row:, column:], torch.tensor([5]), origin=(row, column))
        assert torch.equal(part, whole[..., row:, column:])


def test_neighbours_and_rows_are_independent():
    drawn = taken(torch.full((1, 1, 1024, 1024), 0.3), torch.tensor([77]))[0, 0].double()
    drawn = (drawn - drawn.mean()) / drawn.std()
    for pair in ((drawn[:, 1:], drawn[:, :-1]), (drawn[:, 2:], drawn[:, :-2]), (drawn[1:], drawn[:-1])):
        assert abs((pair[0] * pair[1]).mean().item()) < 4.5 / pair[0].numel() ** 0.5
        squares = ((pair[0] ** 2 - 1) * (pair[1] ** 2 - 1)).mean().item()
        assert abs(squares) < 4.5 * 2.1 / pair[0].numel() ** 0.5


def test_the_tail_begins_where_the_note_has_it():
    cell = np.diff(stats.norm.ppf(2.0**-coarse.RARE_BITS + np.array([0, 2.0**-coarse.NORMAL_BITS])))[0]
    assert coarse._widest(tables.normal_table(), coarse.NORMAL_BITS) == pytest.approx(cell, rel=0.02)
