"""The expression for GPUs, run by eager torch: its law against the exact chain's.

False alarms: each two-sample test fails by chance with a probability of 1e-5.
"""

import numpy as np
import pytest
import torch
from scipy import stats

from tests.camera.on_gpu import take
from visaug.camera import Camera
from visaug.camera.scale import Scale
from visaug.core.sampling import Stream

CAMERA = {
    "resolution": [400, 500],
    "gain_e_per_dn": 0.5,
    "black_level_dn": 300,
    "full_well_e": 4000.0,
    "read_noise": {"sigma_e": 1.5, "shape": -0.2},
    "prnu": {"pixel": 0.006},
    "dsnu": {"pixel_e": 1.1},
}


def plain(electrons: float) -> Scale:
    return Scale(np.array([electrons]), np.zeros(1), np.array([1 / 65535]))


@pytest.mark.parametrize("level", [0.0, 0.4, 7.0, 15.0, 17.0, 300.0, 3990.0])
def test_law_is_the_exact_chains(level):
    camera = Camera.load(CAMERA)
    stream = Stream([1], [2], 1, (range(400), range(500)))
    exact = camera.expose(torch.full((1, 1, 400, 500), level), stream)
    values = {path: np.array([value]) for path, value in camera.values().items()}
    image, keys = torch.full((1, 1, 400, 500), level / 5000), torch.tensor([77])
    quick = take(camera, image, plain(5000.0), values, keys, keys)
    quick = quick * 65535
    jitter = torch.rand(2, 200_000, generator=torch.Generator().manual_seed(1)).numpy()
    samples = [dn.round().numpy().ravel() + u for dn, u in zip((exact, quick), jitter)]
    assert stats.ks_2samp(*samples).pvalue > 1e-5


def test_kept_patterns_are_the_exact_chains():
    camera = Camera.load(
        {**CAMERA, "read_noise": {"sigma_e": 0.1}, "dsnu": {"row_e": 20.0, "column_e": 30.0, "pixel_e": 40.0}}
    )
    keys, window = torch.tensor([5]), (range(30), range(40))
    exact = camera.expose(torch.zeros(1, 1, 30, 40), Stream([1], keys, 1, window))
    values = {path: np.array([value]) for path, value in camera.values().items()}
    image = torch.zeros(1, 1, 30, 40)
    quick = take(camera, image, plain(1.0), values, keys, keys, True)
    assert (quick * 65535 - exact).abs().max() < 3  # read noise of 0.2 DN in each
