"""Steps between columns: where they are, how high, and that a look at a dark frame finds them."""

import numpy as np
import pytest
import torch

from visaug.effects import FrameSummary, catalogue

NAME = "fixed_pattern_structure"


def staircase(columns: int, edges: tuple[int, int], levels: tuple[float, float, float]) -> np.ndarray:
    return np.select(
        [np.arange(columns) < edge for edge in edges],
        [np.full(columns, level) for level in levels[:2]],
        levels[2],
    )


def look_at(frame: np.ndarray, share: float = 1.0) -> FrameSummary:
    rows, columns = (share * np.arange(n) / n for n in frame.shape)
    return FrameSummary(frame, rows, columns, np.arange(5), np.zeros((0, len(frame))))


def test_steps_are_where_and_as_high_as_stated(run_effect):
    dark = torch.full((1, 1, 40, 100), 50.0)
    out = run_effect(
        NAME,
        dark,
        amplitude_e=4.0,
        shape="steps",
        edge=0.25,
        second_edge=0.7,
        second=-1.5,
        direction="columns",
    )
    np.testing.assert_allclose(
        (out - dark)[0, 0].numpy(), np.tile(staircase(100, (25, 70), (0.0, 4.0, -2.0)), (40, 1)), atol=1e-5
    )


@pytest.mark.parametrize("direction", ["columns", "rows"])
def test_a_look_at_the_dark_frame_finds_them(direction):
    """Lines that scatter by a third of the lower step; over 200 seeds an edge was never more than two lines off."""
    rng = np.random.default_rng(8)
    profile = staircase(160, (24, 43), (-1.1, -3.0, 0.7)) + 0.5 * rng.standard_normal(160)
    frame = profile + rng.standard_normal((120, 160))
    if direction == "rows":
        frame = frame.T
    seen = look_at(frame, share=0.5)  # a window: the first half of a sensor
    found = next(look for look in catalogue()[NAME].looks(seen) if look["direction"] == direction)
    assert found["edge"] * 320 == pytest.approx(24, abs=2)
    assert found["second_edge"] * 320 == pytest.approx(43, abs=2)
    assert found["amplitude_e"] == pytest.approx(-1.9, abs=0.6)
    assert found["amplitude_e"] * found["second"] == pytest.approx(3.7, abs=0.6)


def test_two_columns_that_stand_out_are_no_band():
    """Steps of 2 e- among columns that scatter by 0.5 e-, two of which lie 12 e- higher: fitted alone they would explain more."""
    rng = np.random.default_rng(11)
    profile = staircase(160, (50, 110), (-2.0, 0.0, 2.0)) + 0.5 * rng.standard_normal(160)
    profile[80:82] += 12.0
    found = catalogue()[NAME].looks(look_at(np.tile(profile, (120, 1))))[0]
    assert found["edge"] * 160 == pytest.approx(50, abs=2)
    assert found["second_edge"] * 160 == pytest.approx(110, abs=2)


def test_a_look_finds_the_seam_of_two_taps():
    """A step of 2 e- among columns that scatter by 0.5 e-; over 200 seeds it was never more than two columns off."""
    rng = np.random.default_rng(9)
    profile = 2.0 * (np.arange(160) >= 93) + 0.5 * rng.standard_normal(160)
    frame = profile + rng.standard_normal((120, 160))
    look = catalogue()["tap_mismatch"].looks(look_at(frame))[0]
    assert look["direction"] == "columns"
    assert look["seam"] * 160 == pytest.approx(93, abs=2)
    assert look["offset_e"] == pytest.approx(2.0, abs=0.4)


@pytest.mark.parametrize(("bits", "seen"), [(0, []), (1, [1, 1]), (4, [4, 4])])
def test_a_look_at_the_codes_counts_the_bits_that_none_has(bits, seen):
    """4095 stays where the converter clips."""
    codes = np.unique([*(np.arange(100, 4000) >> bits << bits), 4095])
    none = np.zeros(3)
    looks = catalogue()["bit_truncation"].looks(
        FrameSummary(np.zeros((3, 3)), none, none, codes, np.zeros((0, 3)))
    )
    assert [look["bits"] for look in looks] == seen
