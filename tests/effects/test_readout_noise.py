"""Random telegraph signal along a series of frames, and 1/f noise in one."""

import pytest
import torch


@pytest.mark.parametrize("kept", [0.0, 0.6])
def test_slow_traps_keep_their_state(run_effect, kept):
    frames = torch.zeros(6, 1, 100, 100)
    settings = {"density": 1.0, "amplitude_e": 1.0, "amplitudes": "equal", "duty": 0.3}
    state = run_effect("rts_noise", frames, sequence=True, kept=kept, **settings).double() - 0.3
    # variance 0.21; 10 000 pixels: a covariance's standard error is at most 0.21 / 100, 5 of them a twentieth of it
    for k in range(5):
        assert float((state[k] ** 2).mean()) == pytest.approx(0.21, abs=0.0105)
        assert float((state[k] * state[k + 1]).mean()) == pytest.approx(0.21 * kept, abs=0.0105)


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
