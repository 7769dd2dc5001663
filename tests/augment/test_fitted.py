"""Camera parameters as `nn.Parameter`s, found by an optimiser from the noise of frames."""

import pytest
import torch
from torch import nn

from visaug.augment import SensorNoise

SIDE, FRAMES, ELECTRONS, STEPS = 40, 12, 750.0, 50
CAMERA = {
    "resolution": [SIDE, SIDE],
    "bit_depth": 12,
    "gain_e_per_dn": 1.0,
    "quantum_efficiency": 0.5,
    "black_level_dn": 200,
    "read_noise": {"sigma_e": 1.0},
}


def test_gain_and_read_noise_are_fitted_to_the_variance_of_darks_and_flats():
    """Photon transfer by gradient descent: from twice the gain and half the read noise to within 5 %.

    A variance is known to sqrt(2 / 9600), 1.4 %, hence the gain to 0.7 % and sigma to 1 %: off by 5 % by chance
    less than once in 100,000.
    """
    gain_true, sigma_true = 0.8, 6.0
    light = torch.zeros(FRAMES, 1, SIDE, SIDE)
    light[:, :, SIDE // 2 :] = 1.0
    electrons = torch.tensor([0.0, ELECTRONS])
    wanted = (sigma_true**2 + electrons) / gain_true**2 + 1 / 12  # EMVA 1288's linear model, DN^2

    gain, sigma = nn.Parameter(torch.tensor(1.6)), nn.Parameter(torch.tensor(3.0))
    values = {"gain_e_per_dn": gain, "read_noise.sigma_e": sigma}
    noise = SensorNoise(CAMERA, values=values, full_scale_photons=2 * ELECTRONS, black_level="keep", seed=2)
    assert set(noise.parameters()) == {gain, sigma}
    draws = noise.draw(FRAMES)  # the same noise in every step: the loss is a function of the two
    optimiser = torch.optim.Adam(
        [{"params": [gain], "lr": 0.1}, {"params": [sigma], "lr": 0.4}], betas=(0.5, 0.9)
    )
    for _ in range(STEPS):
        optimiser.zero_grad()
        dn = noise.apply_draws(light, draws) * (2**12 - 1)
        found = torch.stack([half.var() for half in dn.split(SIDE // 2, dim=2)])
        (found / wanted).log().square().sum().backward()
        optimiser.step()
    assert [gain.item(), sigma.item()] == pytest.approx([gain_true, sigma_true], rel=0.05)
