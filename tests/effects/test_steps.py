"""Steps between columns: where they are, how high, and that a look at a dark frame finds them."""

import numpy as np
import pytest
import torch

from visaug.effects import catalogue

NAME = "fixed_pattern_structure"


def staircase(columns: int, edges: tuple[int, int], levels: tuple[float, float, float]) -> np.ndarray:
    return np.select(
        [np.arange(columns) < edge for edge in edges],
        [np.full(columns, level) for level in levels[:2]],
        levels[2],
    )


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
    places = [np.arange(n) / (2 * n) for n in frame.shape]  # a window: the first half of a sensor
    found = next(look for look in catalogue()[NAME].looks(frame, *places) if look["direction"] == direction)
    assert found["edge"] * 320 == pytest.approx(24, abs=2)
    assert found["second_edge"] * 320 == pytest.approx(43, abs=2)
    assert found["amplitude_e"] == pytest.approx(-1.9, abs=0.6)
    assert found["amplitude_e"] * found["second"] == pytest.approx(3.7, abs=0.6)
