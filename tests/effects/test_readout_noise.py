"""Random telegraph signal along a series of frames, 1/f noise in one, and a banding as single frames show it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from visaug.effects import FrameSummary, catalogue


@pytest.mark.parametrize("kept", [0.0, 0.6])
def test_slow_traps_keep_their_state(run_effect, kept):
    frames = torch.zeros(6, 1, 100, 100)
    settings = {"density": 1.0, "amplitude_e": 1.0, "amplitudes": "equal", "duty": 0.3}
    state = run_effect("rts_noise", frames, sequence=True, kept=kept, **settings).double() - 0.3
    # variance 0.21; 10 000 pixels: a covariance's standard error is at most 0.21 / 100, 5 of them a twentieth of it
    for k in range(5):
        assert float((state[k] ** 2).mean()) == pytest.approx(0.21, abs=0.0105)
        assert float((state[k] * state[k + 1]).mean()) == pytest.approx(0.21 * kept, abs=0.0105)


def test_slow_traps_keep_their_state_from_batch_to_batch(run_effect):
    """It is drawn anew in 2 % of the frames, whatever the batches, and distributed as at the beginning."""
    settings = {"density": 1.0, "amplitude_e": 1.0, "amplitudes": "equal", "duty": 0.3, "kept": 0.98}
    frames, memory = torch.zeros(64, 1, 60, 60), {}
    apart = [
        run_effect("rts_noise", part, sequence=True, memory=memory, **settings) for part in frames.split(16)
    ]
    state = torch.cat(apart).double() - 0.3
    for first, last in ((0, 0), (63, 63), (3, 63), (60, 63)):
        expected = 0.21 * 0.98 ** (last - first)
        # 3600 pixels: 4 standard errors of a covariance, at most 0.21 / 60 each
        assert float((state[first] * state[last]).mean()) == pytest.approx(expected, abs=0.014)


def test_a_clamp_takes_the_mean_of_flicker_noise_away(run_effect):
    frames = torch.zeros(40, 1, 60, 80)
    free, clamped = (
        run_effect("flicker_noise", frames, sigma_e=1.0, clamp=word).double() for word in ("none", "frame")
    )
    assert float(clamped.mean((1, 2, 3)).abs().max()) < 1e-5
    # 1/f from one period in two frames on: the longest four have a fifth of its power, and a frame's mean some of that
    assert float(free.mean((1, 2, 3)).std()) > 0.1
    rows = clamped.mean(-1).std()
    assert float(rows) > 5 / 80**0.5  # white noise would leave 1 / sqrt(80)


@pytest.mark.parametrize(("period", "within"), [(7.3, 0.01), (22.2, 0.02), (61.0, 0.08)])
def test_a_look_at_single_frames_tells_the_period(period, within):
    """Of 96 rows, where the nearest whole frequencies of a frame are periods of 19.2 and 24; less well if it hardly repeats."""
    rng = np.random.default_rng(11)
    phases = rng.uniform(0, 2 * np.pi, (12, 1))
    wave = 0.8 * np.sin(2 * np.pi * np.arange(96) / period + phases)
    noise = wave + 0.2 * rng.standard_normal(wave.shape)
    lines = np.arange(96) / 96
    seen = FrameSummary(np.zeros((96, 4)), lines, lines[:4], np.arange(5), noise)
    (found,) = catalogue()["periodic_banding"].looks(seen)
    assert found["period_rows"] == pytest.approx(period, rel=within)
    assert found["amplitude_e"] == pytest.approx(0.8, rel=0.15)
    faint = catalogue()["periodic_banding"].looks(replace(seen, row_noise_e=noise / 10))
    assert [look["period_rows"] for look in faint] == [found["period_rows"]] * 2
    assert [look["amplitude_e"] for look in faint] == pytest.approx([found["amplitude_e"] / 10, 0.5])
    assert catalogue()["periodic_banding"].looks(replace(seen, row_noise_e=noise[:0])) == []
