"""Codes of unequal width against NumPy: a code-density test, and thresholds by hand."""

from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from visaug.camera import Camera
from visaug.effects.digital.code_widths import NEAREST, CodeWidths, code_of
from visaug.effects.testing import instruments

PER_CODE = 400  # values of a ramp for each code


def ramp(codes: int) -> torch.Tensor:
    """Rising values with `PER_CODE` a code, from the lower end of code 0 to the upper end of the last."""
    values = (torch.arange(codes * PER_CODE, dtype=torch.float64) + 0.5) / PER_CODE - 0.5
    return values.float().view(1, PER_CODE, codes)


def widths_of(effect: CodeWidths, bits: int = 8, camera_seed: int = 0) -> np.ndarray:
    codes = 2**bits
    out = effect(ramp(codes), bit_depth=bits, camera_seed=camera_seed).round().clamp(0, codes - 1)
    assert bool((out.flatten().diff() >= 0).all())  # a converter is monotonous
    return np.bincount(out.flatten().long().numpy(), minlength=codes) / PER_CODE


def test_widths_have_the_given_spread_and_keep_the_gain():
    """Standard deviation over 20 cameras of 254 inner codes: 5 standard errors of 5080 correlated widths are 7 %."""
    widths = np.stack([widths_of(CodeWidths(dnl=0.2), camera_seed=seed) for seed in range(20)])
    assert widths[:, 1:-1].std() == pytest.approx(0.2, rel=0.07)
    assert widths.sum(1) == pytest.approx(256)
    edges = widths.cumsum(1)[:, :-1] - np.arange(1, 256)
    assert np.abs(edges).max() < 0.5 + 1 / PER_CODE  # errors of thresholds do not add up
    assert not np.allclose(widths[0], widths[1])


@pytest.mark.parametrize("bits", [4, 16])
@pytest.mark.parametrize("in_order", [True, False])
def test_a_value_has_the_code_between_its_thresholds(bits: int, in_order: bool):
    """Values at and around thresholds, and beyond both ends, by NumPy's binary search."""
    codes = 2**bits
    rng = np.random.default_rng(0)
    off = rng.uniform(-NEAREST, NEAREST, codes + 1) * (np.arange(codes + 1) % codes > 0)
    edges = (np.arange(codes + 1) - 0.5 + off).astype(np.float32)
    values = np.concatenate([edges, np.nextafter(edges, -1), edges + 0.3, [-7, codes + 7]]).astype(np.float32)
    expected = np.searchsorted(edges[1:-1], values, side="right")
    found = code_of(torch.from_numpy(values)[None, None], torch.from_numpy(edges)[None, None], in_order)
    assert np.array_equal(found.flatten().numpy(), expected)


@pytest.mark.parametrize("period", [4, 16])
def test_widths_of_the_last_stage_repeat(period):
    """Over 200 cameras the spread of a width has a standard error of 5 %; 5 of them are allowed."""
    seen = [widths_of(CodeWidths(dnl=0.1, pattern="stage", period=period), camera_seed=k) for k in range(200)]
    inner = np.stack(seen)[:, period:-period]
    assert np.allclose(inner[:, period:], inner[:, :-period], atol=2.01 / PER_CODE)
    assert inner[:, :period].sum(1) == pytest.approx(period, abs=2 / PER_CODE)  # the gain stays
    assert inner[:, :period].std(0) == pytest.approx(np.full(period, 0.1), rel=0.25)


def test_errors_of_bits_show_at_powers_of_two():
    """A threshold is off by the sum of the errors of the bits of its code."""
    widths = widths_of(CodeWidths(dnl=0.5, pattern="bits"), camera_seed=3)
    off = np.concatenate([[0], widths.cumsum()[:-1]]) - np.arange(256)  # of the lower threshold of each code
    bits = np.array([off[1 << i] for i in range(8)])
    code = np.arange(1, 256)
    summed = sum(((code >> i) & 1) * bits[i] for i in range(8))
    assert off[1:] == pytest.approx(summed, abs=10 / PER_CODE)
    assert np.abs(bits).max() > 0.1


def test_a_measured_table_replaces_the_pattern(tmp_path: Path):
    """Relative widths 1 : 3 in turn, repeated over the range of a camera that was loaded from a file."""
    np.savetxt(tmp_path / "widths.txt", [0.25, 0.75])
    content = {
        "resolution": [1, 3000],
        "bit_depth": 8,
        "gain_e_per_dn": 1.0,
        "effects": [{"name": "code_widths", "map": "widths.txt"}],
    }
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump(content))
    camera = Camera.load(tmp_path / "camera.yaml")
    levels = np.linspace(1.01, 249.9, 3000)
    context = instruments.context((1, 3000))
    context.bit_depth, context.maps = 8, camera.maps
    values = instruments.tensors({"dnl": 0.0, "pattern": "thresholds"})
    signal = torch.tensor(levels, dtype=torch.float32).view(1, 1, 1, -1)
    out = CodeWidths().apply(signal, values, instruments.stream(context, (1,)), context)
    thresholds = (np.cumsum(np.tile([0.5, 1.5], 128)) - 0.5)[:-1]
    assert np.array_equal(out.round().flatten().numpy(), np.searchsorted(thresholds, levels, side="right"))


def test_the_last_code_before_all_bits_change_has_the_stated_spread():
    """Code 127 of 8 bits, over 400 cameras: 5 standard errors of a standard deviation are 18 %."""
    widths = [widths_of(CodeWidths(dnl=0.1, pattern="bits"), camera_seed=k)[127] for k in range(400)]
    assert np.std(widths) == pytest.approx(0.1, rel=0.18)
