"""The noise on a CUDA device against the CPU: repeatable, of the same law, with the same gradients.

False alarms: each two-sample test fails by chance with a probability of 1e-6.
"""

from typing import Any

import numpy as np
import pytest
import torch
from scipy import stats

from visaug.augment.sensor_noise import SensorNoise
from visaug.camera import Camera
from visaug.camera.camera import shipped

pytestmark = [pytest.mark.gpu, pytest.mark.skipif(not torch.cuda.is_available(), reason="needs CUDA")]
CAMERA = {
    "resolution": [128, 160],
    "gain_e_per_dn": 0.5,
    "bit_depth": 12,
    "black_level_dn": 300,
    "full_well_e": 1800.0,
    "quantum_efficiency": 0.6,
    "read_noise": {"sigma_e": 4.0, "shape": -0.1},
    "prnu": {"pixel": 0.01},
    "dsnu": {"column_e": 2.0, "pixel_e": 2.0},
}
RANDOM = {"gain_db": {"std": 2.0}, "read_noise.sigma_e": 0.2}
COLOUR = {
    "cfa": "RGGB",
    "white_balance": [2.0, 1.0, 1.7],
    "matrix": [[1.6, -0.45, -0.15], [-0.25, 1.5, -0.25], [-0.05, -0.55, 1.6]],
}


def images(count: int = 4, channels: int = 1) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    levels = torch.linspace(0.05, 0.9, count).view(-1, 1, 1, 1)
    return (levels + 0.02 * torch.rand(count, channels, 128, 160, generator=generator)).clamp(0, 1)


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float16])
def test_stays_on_the_device_and_repeats(fast, dtype):
    noise = SensorNoise(Camera.load({**CAMERA, "randomize": RANDOM}), fast=fast)
    given, draws = images().cuda().to(dtype), noise.draw(4)
    first, again = (noise.apply_draws(given, draws) for _ in range(2))
    assert first.is_cuda
    assert first.dtype == dtype
    assert torch.equal(first, again)
    assert not torch.equal(first, noise.apply_draws(given, noise.draw(4)))


@pytest.mark.parametrize("fast", [True, False])
def test_law_is_that_of_the_cpu(fast):
    noise = SensorNoise(Camera.load(CAMERA), fast=fast)
    given = images(6)
    on_cpu, on_gpu = noise(given), noise(given.cuda()).cpu()
    jitter = np.random.default_rng(1).random((2, 128 * 160)) / 4095
    for one, other in zip(on_cpu, on_gpu):
        # Rows of columns' offsets are drawn anew for each image: levels are compared without them.
        a, b = (x[0].double().numpy() - x[0].double().mean(0).numpy() for x in (one, other))
        samples = [a.ravel() + jitter[0], b.ravel() + jitter[1]]
        tested: Any = stats.ks_2samp(*samples)
        assert tested.pvalue > 1e-6


def test_exact_chain_replays_the_draws_of_the_cpu():
    noise = SensorNoise(Camera.load({**CAMERA, "randomize": RANDOM}), fast=False)
    given, draws = images(), noise.draw(4)
    on_cpu, on_gpu = noise.apply_draws(given, draws), noise.apply_draws(given.cuda(), draws).cpu()
    step = (on_cpu - on_gpu).abs() * 4095 * 0.5
    assert (
        step > 2
    ).float().mean() < 0.01  # rounding at the edge of a step; counts of photons may differ by one


def test_gradients_are_those_of_the_cpu():
    values = {"read_noise.sigma_e": 4.0}
    found = {}
    for device in ("cpu", "cuda"):
        parameters = {name: torch.nn.Parameter(torch.tensor(value)) for name, value in values.items()}
        noise = SensorNoise(Camera.load(CAMERA), values=parameters, seed=3).to(device)
        given = images().to(device).requires_grad_()
        draws = noise.draw(4)
        (noise.apply_draws(given, draws) - images().to(device)).square().sum().backward()
        found[device] = [given.grad, *(p.grad for p in noise.parameters())]
        with torch.no_grad():  # the fast path reads parameters that lie on the device
            assert noise.apply_draws(given, draws).device == given.device
    assert len(found["cpu"]) == 2
    for a, b in zip(found["cpu"], found["cuda"]):
        assert torch.isfinite(b).all()
        close = torch.isclose(a, b.cpu(), rtol=1e-2, atol=1e-3)
        assert close.float().mean() > 0.98


@pytest.mark.parametrize("name", [None, *sorted(shipped())])
def test_every_shipped_camera(name):
    camera = Camera.load({**CAMERA, "colour": COLOUR} if name is None else name)
    noise = SensorNoise(camera, exposure=0.3)
    given, draws = images(2, 3), noise.draw(2)  # gain and other parameters are drawn: the same for both
    on_cpu, on_gpu = noise.apply_draws(given, draws), noise.apply_draws(given.cuda(), draws).cpu()
    assert on_gpu.shape == given.shape
    spread = [(x - given).std().item() for x in (on_cpu, on_gpu)]
    assert spread[1] == pytest.approx(spread[0], rel=0.1)
