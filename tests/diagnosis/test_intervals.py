"""Intervals of fitted parameters hold the truth as often as they say, of sets that the same program simulates."""

import pytest

from scripts.fit_coverage import Truths


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "values"),
    [
        # the foot of a glow is hardly another dark current: noise of derivatives would separate the two
        ("amplifier_glow", {"rate_e_per_s": 60.0, "width": 0.2}),
        # statistics are not linear along a period, within the step of a derivative
        ("periodic_banding", {"amplitude_e": 0.5}),
    ],
)
def test_intervals_of_95_percent_hold_the_truth(stated, effect, values):
    """Of 24 sets; fewer than 18 for any of the eleven parameters would come once in 700 runs of independent fits."""
    found = Truths(stated).coverage(stated.with_effect(effect, **values), effect)
    of_both = [c for c in found if c.path.startswith(("dark_current.", f"{effect}."))]
    assert min(c.inside for c in of_both) >= 18, list(map(str, of_both))
