"""Intervals of fitted parameters hold the truth as often as they say, of sets that the same program simulates."""

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.small import PLAN, frame_set
from visaug.diagnosis.fitting.fit import refit, settled
from visaug.diagnosis.fitting.parameters import base_coordinates, effect_coordinates, moved
from visaug.diagnosis.fitting.reference import FIRST, make_reference
from visaug.diagnosis.laboratory import Laboratory

SETS = 24


def silent(*_) -> None:
    """Takes the progress of a phase."""


@pytest.mark.slow
def test_intervals_of_95_percent_hold_the_truth(stated):
    """A glow whose foot is hardly another dark current: noise of derivatives would tell them apart.

    From a start of up to a step beside it. Fewer than 18 of 24 would come in one run in 6,000 for each of six parameters.
    """
    effect = "amplifier_glow"
    truth = stated.with_effect(effect, rate_e_per_s=60.0, width=0.2)
    lab = Laboratory(frame_set(3, plan=tuple(PLAN)), stated)
    plain = base_coordinates(stated, lab.frames, lab.calibrated)
    free = [*plain, *effect_coordinates(truth, effect)]
    aside = np.random.default_rng(1).uniform(-1, 1, len(free)) * [c.step for c in free]
    aside[[c.path == "full_well_e" for c in free]] = (
        0.0  # only one statistic, which is nonlinear, determines the full well
    )
    begin = moved(truth, free, [c.read(truth) + step for c, step in zip(free, aside, strict=True)])
    reference = make_reference(lab, begin, free, FIRST, silent)
    inside = {c.path: 0 for c in free}
    measured = lab.measured
    for values in zip(*lab.simulated([(truth, 5000 + k) for k in range(SETS)]), strict=True):
        lab.measured = tuple(replace(f, values=own) for f, own in zip(measured, values, strict=True))
        fitted = settled(lab, refit(lab, reference, silent), FIRST, silent)
        known = np.hypot(fitted.reference.null_steps.std(0, ddof=1), fitted.reference.untold)
        for c, spread in zip(fitted.reference.coordinates, known, strict=True):
            inside[c.path] += abs(c.read(fitted.camera) - c.read(truth)) < 1.96 * spread
    of_both = ("dark_current.", f"{effect}.")
    fewest = min(count for path, count in inside.items() if path.startswith(of_both))
    assert fewest >= 18, inside
