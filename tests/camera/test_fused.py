"""Runs of base effects in one loop against the same effects one by one, in torch operators.

Both have the same random numbers, so they agree in every pixel, but for a value within rounding errors of a half.
"""

import itertools

import pytest
import torch

from visaug.camera import Camera, fused
from visaug.core.sampling import Stream

pytest.importorskip("numba")

CONTENT = {
    "resolution": [40, 50],
    "bit_depth": 12,
    "gain_e_per_dn": 0.7,
    "quantum_efficiency": 0.6,
    "black_level_dn": 200,
    "exposure_s": 0.5,
    "full_well_e": 2500.0,
    "read_noise": {"sigma_e": 2.0, "shape": -0.2, "after_gain_dn": 0.8},
    "prnu": {"column": 0.02, "row": 0.02, "pixel": 0.02},
    "dsnu": {"column_e": 8.0, "row_e": 8.0, "pixel_e": 8.0},
    "dark_current": {"a_e_per_s": 4.0, "b_per_c": 0.1},
}
NOISELESS = {"read_noise": {}, "dsnu": {}, "gain_e_per_dn": 2.0}
BETWEEN = [
    [],
    [{"name": "vignetting"}],
    [{"name": "clock_induced_charge", "mean_e": 3.0}],
    [{"name": "row_noise", "sigma_e": 3.0}],
    [{"name": "row_noise", "sigma_e": 0.0}],
    [{"name": "missing_codes"}],
    [{"name": "vignetting"}, {"name": "image_lag"}, {"name": "nonlinearity"}],
]


def taken(camera: Camera, photons: torch.Tensor, values=None, **options) -> torch.Tensor:
    stream = Stream([1, 2, 3], [9, 9, 9], photons.shape[1], (range(2, 42), range(3, 53)))
    return camera.expose(photons, stream, values, **options)


def light(channels: int = 1) -> torch.Tensor:
    """From no light over single electrons to the full well, which each row meets."""
    ramp = torch.cat([torch.zeros(10), torch.logspace(-2, 4, 40)])
    return ramp.expand(3, channels, 40, 50) * torch.tensor([0.2, 1.0, 1.3]).view(3, 1, 1, 1)


def agree(one: torch.Tensor, other: torch.Tensor) -> None:
    apart = (one - other).abs()
    assert apart.max() <= 1
    assert (apart > 0).double().mean() < 1e-3


@pytest.mark.parametrize("changes", [{}, NOISELESS, {"bit_depth": 16, "full_well_e": None}])
@pytest.mark.parametrize("further", BETWEEN, ids=lambda names: "-".join(e["name"] for e in names) or "none")
def test_a_run_is_its_effects(changes, further, monkeypatch):
    content = {**CONTENT, **changes, "effects": further}
    camera = Camera.load({key: value for key, value in content.items() if value is not None})
    values = {"gain_db": torch.tensor([0.0, 3.0, 6.0]), "exposure_s": torch.tensor([0.0, 0.5, 4.0])}
    lengths = []
    expose = fused.expose
    monkeypatch.setattr(fused, "expose", lambda run, *rest: (lengths.append(len(run)), expose(run, *rest))[1])
    together = taken(camera, light(2), values, sequence=True)
    assert max(lengths) > 1
    monkeypatch.setattr(fused, "runs", lambda effects, *_: [[effect] for effect in effects])
    agree(together, taken(camera, light(2), values, sequence=True))


def test_with_a_gradient_the_numbers_are_the_same():
    camera = Camera.load(CONTENT)
    photons = light().clone().requires_grad_()
    with_gradient = taken(camera, photons)
    agree(taken(camera, light()), with_gradient.detach())
    with_gradient.sum().backward()
    assert photons.grad is not None
    assert photons.grad.abs().sum() > 0


def test_more_light_gives_no_fewer_electrons():
    """Common random numbers: at the same seed a count never falls as its mean grows."""
    camera = Camera.load({"resolution": [40, 50], "gain_e_per_dn": 1.0, "prnu": {"pixel": 0.02}})
    levels = [0.0, 0.3, 2.0, 2.1, 20.0, 24.9, 25.1, 26.0, 400.0, 401.0, 60000.0]
    frames = [taken(camera, torch.full((3, 1, 40, 50), level)) for level in levels]
    for fewer, more in itertools.pairwise(frames):
        assert (more >= fewer).all()
    assert (frames[-2] > frames[-3]).double().mean() > 0.5


def test_a_watched_chain_goes_effect_by_effect():
    camera, seen = Camera.load(CONTENT), []
    watched = taken(camera, light(), watch=lambda effect, signal: seen.append((effect.name, signal)))
    assert [name for name, _ in seen] == [effect.name for effect in camera.effects]
    agree(watched, taken(camera, light()))


def test_runs_end_where_an_effect_sits_between():
    names = ["quantum_efficiency", "prnu", "row_noise", "read_noise", "system_gain"]
    camera = Camera.load(CONTENT).with_effect("row_noise", sigma_e=1.0)
    effects = [next(e for e in camera.effects if e.name == name) for name in names]
    under = camera._conditions(None, Stream([1], [1], 1, (range(4), range(4))), torch.device("cpu"))
    runs = fused.runs(effects, torch.zeros(1, 1, 4, 4), under.values, under.context)
    found = [[e.name for e in run] for run in runs]
    assert found == [names[:2], names[2:3], names[3:]]
