"""Signatures of effects with random numbers of their own."""

import numpy as np

from tests.diagnosis.small import frame_set
from visaug.diagnosis import search
from visaug.diagnosis.candidates.signatures import MORE, resolved, scanned
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.stage import Setting


def test_what_moves_means_either_way_has_no_mean_shift_beyond_its_noise(stated):
    """A drift of the black level moves no mean on average: its mean over n simulations has 1 / sqrt(n) of its deviation.

    With the seed 0 the two simulations of the scan have 1.1 of it. The bound is 1.7 times 1 / sqrt(6), of five levels.
    """
    few = frozenset(search.catalogue()) - {"black_level_drift", "tap_mismatch"}
    lab = Laboratory(frame_set(5), stated, 0)

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
