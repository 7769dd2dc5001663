"""What one diagnosis simulates serves the next, and nothing stale does."""

import pytest

from tests.diagnosis.small import RIPPLE, frame_set
from visaug.diagnosis import laboratory, search
from visaug.diagnosis.candidates.signatures import scanned
from visaug.diagnosis.fitting.parameters import base_coordinates
from visaug.diagnosis.fitting.reference import make_reference
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.names import source_of
from visaug.diagnosis.spread import by_threads
from visaug.effects import load_file


class Counted:
    """Simulates by threads, and counts the sets of each camera's effects."""

    def __init__(self, until: int | None = None):
        self.jobs, self.until, self.spread = [], until, by_threads()

    def __call__(self, work, jobs):
        for job, result in zip(jobs, self.spread(work, jobs), strict=True):
            if len(self.jobs) == self.until:
                raise KeyboardInterrupt
            self.jobs.append(job)
            yield result

    @property
    def effects(self):
        return {name for camera, _ in self.jobs for name in camera.effect_names}


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path))
    monkeypatch.setattr(laboratory, "SAVED", 3)


def test_one_effect_more_or_less_costs_no_other(stated, place):
    few = frozenset(search.catalogue()) - {"row_noise", "tap_mismatch", "image_lag"}

    def signs_of(without):
        spread = Counted()
        lab = Laboratory(frame_set(5), stated, 0, spread=spread)
        reference = search.given_reference(lab, stated, 20, lambda *_: None)
        signs = scanned(lab, reference, search.trials(stated, without), lambda *_: None)
        return signs, spread.effects

    own = set(stated.effect_names)
    _, first = signs_of(few | {"row_noise"})
    whole, second = signs_of(few)
    again, third = signs_of(few)
    assert first - own == {"tap_mismatch", "image_lag"}
    assert second - own == {"row_noise"}
    assert third == set()
    assert again.trials == whole.trials
    assert (again.values == whole.values).all()
    assert (again.variances == whole.variances).all()


def test_an_interrupted_reference_goes_on_where_it_was(stated, place):
    own = base_coordinates(stated, frame_set(5), True)[:1]

    def made(spread):
        return make_reference(
            Laboratory(frame_set(5), stated, 0, spread=spread), stated, own, 10, lambda *_: None
        )

    cut, rest, none = Counted(until=8), Counted(), Counted()
    with pytest.raises(KeyboardInterrupt):
        made(cut)
    resumed, again = made(rest), made(none)
    assert [number for _, number in cut.jobs] == list(range(8))
    assert [number for _, number in rest.jobs][:2] == [8, 9]
    assert not none.jobs
    for use in ("find", "confirm", "whole"):
        for part in ("sets", "slopes", "least"):
            assert (getattr(getattr(resumed, use), part) == getattr(getattr(again, use), part)).all()


def test_what_differs_has_another_name(stated, tmp_path):
    lab = Laboratory(frame_set(5), stated, 0)
    name = lab._names.of(stated, 0, ("find",))
    assert name == Laboratory(frame_set(5), stated, 0)._names.of(stated.replace({}), 0, ("find",))
    others = {
        Laboratory(frame_set(5), stated, 1)._names.of(stated, 0, ("find",)),
        Laboratory(frame_set(5).subset(range(16)), stated, 0)._names.of(stated, 0, ("find",)),
        lab._names.of(stated, 1, ("find",)),
        lab._names.of(stated, 0, ("find", "confirm")),
        lab._names.of(stated.replace({"read_noise.sigma_e": 1.7321}), 0, ("find",)),
    }
    assert name not in others
    assert len(others) == 5


def test_a_changed_effect_file_is_simulated_anew(stated, tmp_path):
    file = tmp_path / "ripple.py"
    lab = Laboratory(frame_set(5), stated, 0)
    names = []
    for factor in (1, 2):  # the parameters stay, the law changes
        file.write_text(RIPPLE.format(factor=factor, line=""))
        load_file(file)
        camera = stated.with_effect("ripple", sigma_e=1.0)
        names.append((source_of("ripple"), lab._names.of(camera, 0, ("find",))))
    assert names[0][0] != names[1][0]
    assert names[0][1] != names[1][1]
    assert source_of("row_noise") == ""
