"""Signatures of effects with random numbers of their own, and of those that the camera's parameters take up."""

import numpy as np
import pytest

from tests.diagnosis.small import frame_set
from visaug.diagnosis import search
from visaug.diagnosis.candidates.signatures import MORE, resolved, scanned, simulated
from visaug.diagnosis.candidates.trials import Trial
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.spread import by_threads
from visaug.diagnosis.stage import Setting


def test_what_moves_means_either_way_has_no_mean_shift_beyond_its_noise(stated):
    """A drift of the black level moves no mean on average: its mean over n simulations has 1 / sqrt(n) of its deviation.

    With the seed 0 the two simulations of the scan have 1.1 of it. The bound is 1.7 times 1 / sqrt(6), of five levels.
    """
    few = frozenset(search.catalogue()) - {"black_level_drift", "tap_mismatch"}
    lab = Laboratory(frame_set(5), stated, 0, spread=by_threads())

    def report(*_):
        pass

    reference = search.given_reference(lab, stated, 20, report)
    scan = scanned(lab, reference, search.trials(stated, few), report)
    found = resolved(lab, reference, scan, report)
    searching = Setting(lab, reference, scan, few, None, None, report)  # pyrefly: ignore[bad-argument-type]
    assert (searching.with_looks(lambda *_: ()).signs.values == found.values).all()
    assert [t.values for t in found.trials] == [t.values for t in scan.trials]
    assert {trial.effect for trial in found.trials} == {"black_level_drift", "tap_mismatch"}
    levels = np.array([s.view == "level" for s in lab.statistics])
    for trial, values, first, variances in zip(
        found.trials, found.values, scan.values, found.variances, strict=True
    ):
        if trial.effect == "tap_mismatch":
            assert (values == first).all()
            continue
        moved = levels & (variances > 0)
        sizes = [np.sqrt(np.mean(part[moved] ** 2 / variances[moved])) for part in (first, values)]
        assert sizes[0] > 1.0
        assert sizes[1] < 1.7 / np.sqrt(MORE)


def test_what_the_cameras_parameters_take_up_is_simulated_with_these_moved(stated):
    """Poisson electrons of mean and variance 2: a lower black level and less read noise leave their third moment alone.

    The camera moved by these laws leaves 7 standard deviations in all statistics together, most in the skewness of bias frames.
    With derivatives alone 21 would stay, in levels and bits.
    """
    added, values = 2.0, stated.values()
    lab = Laboratory(frame_set(5), stated, 0, spread=by_threads())

    def report(*_):
        pass

    reference = search.given_reference(lab, stated, 60, report)
    trial = Trial("clock_induced_charge", (("clock_induced_charge.mean_e", added),))
    found = simulated(lab, reference, [trial], range(MORE), report)
    steps = dict(found.trials[0].following)
    assert steps["black_level_dn"] == pytest.approx(-added / values["gain_e_per_dn"], rel=0.02)
    variance = values["read_noise.sigma_e"] ** 2
    by_law = {
        "black_level_dn": values["black_level_dn"] - added / values["gain_e_per_dn"],
        "read_noise.sigma_e": np.sqrt(variance - added),
    }
    # the shape of the read noise takes up some of it
    assert steps["read_noise.sigma_e"] == pytest.approx(0.5 * np.log(1 - added / variance), rel=0.4)

    def left(camera) -> np.ndarray:
        sets = lab.finding([(camera, k) for k in range(MORE)])
        return reference.null.beyond(sets.mean(0) - reference.sets[:MORE].mean(0))

    with_effect = trial.on(stated)
    exact, straight = left(with_effect.replace(by_law)), left(with_effect)
    own = reference.null.beyond(found.values[0])
    assert np.abs(straight - exact).max() > 8
    assert np.abs(own - exact).max() < 3
