"""What one diagnosis keeps serves the next, and nothing stale does."""

from dataclasses import replace

import pytest

from tests.diagnosis.small import frame_set
from visaug.diagnosis import search
from visaug.diagnosis.candidates import cache
from visaug.diagnosis.fitting.parameters import base_coordinates, effect_coordinates
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import load_file

EFFECT = '''
from visaug.effects import Effect, Parameter, Stage

class Ripple(Effect):
    """A test's own."""
    name = "ripple"
    stage = Stage.READOUT
    sigma_e = Parameter(1.0, unit="e-", strength=True)

    def apply(self, signal, p, stream, context):
        return signal + {factor} * p.sigma_e * stream.normal("row")
'''


def test_one_effect_more_or_less_costs_no_other(stated, tmp_path, monkeypatch):
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path))
    few = frozenset(search.catalogue()) - {"row_noise", "tap_mismatch", "image_lag"}
    lab = Laboratory(frame_set(5), stated, 0)

    def signs_of(without):
        tried = []
        real = cache.scanned
        with monkeypatch.context() as patch:
            patch.setattr(cache, "scanned", lambda *a: (tried.extend(a[2]), real(*a))[1])
            reference = search.given_reference(lab, stated, 20, lambda *_: None)
            signs = cache.signatures(lab, reference, search.trials(stated, without), lambda *_: None)
            return signs, {trial.effect for trial in tried}

    _, first = signs_of(few | {"row_noise"})
    whole, second = signs_of(few)
    again, third = signs_of(few)
    assert (first, second, third) == ({"tap_mismatch", "image_lag"}, {"row_noise"}, set())
    assert again.trials == whole.trials
    assert (again.values == whole.values).all()
    assert (again.variances == whole.variances).all()


def test_kept_signatures_are_those_of_their_own_trials(stated, tmp_path, monkeypatch):
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path))
    lab = Laboratory(frame_set(5), stated, 0)
    few = frozenset(search.catalogue()) - {"row_noise", "tap_mismatch"}
    reference = search.given_reference(lab, stated, 20, lambda *_: None)
    tried = search.trials(stated, few)
    cache.signatures(lab, reference, tried, lambda *_: None)
    kept = cache.signatures(lab, reference, tried, lambda *_: None)
    direct = cache.scanned(lab, reference, tried, lambda *_: None)
    places = [
        direct.trials.index(trial) for trial in kept.trials
    ]  # by effect, where those at once are by strength
    assert sorted(places) == list(range(len(direct.trials)))
    assert (kept.values == direct.values[places]).all()


def test_an_interrupted_reference_goes_on_with_the_stage_it_was_at(stated, tmp_path, monkeypatch):
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path))
    monkeypatch.setattr(cache, "STAGE", 4)
    lab, own = Laboratory(frame_set(5), stated, 0), base_coordinates(stated, frame_set(5), True)[:1]
    made, real = [], cache.make_reference

    def make(lab, camera, coordinates, sets, *rest):
        made.append(sets)
        if len(made) == 3:
            raise KeyboardInterrupt
        return real(lab, camera, coordinates, sets, *rest)

    monkeypatch.setattr(cache, "make_reference", make)
    with pytest.raises(KeyboardInterrupt):
        cache.reference(lab, stated, own, 10, lambda *_: None)
    staged = cache.reference(lab, stated, own, 10, lambda *_: None)
    assert made == [4, 8, 10, 10]
    at_once = real(lab, stated, own, 10, lambda *_: None)
    for use in ("find", "confirm", "whole"):
        assert (getattr(staged, use).sets == getattr(at_once, use).sets).all()


def test_a_camera_with_an_effect_is_simulated_once(stated, tmp_path, monkeypatch):
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path))
    lab = Laboratory(frame_set(5), stated, 0)
    own = base_coordinates(stated, lab.frames, True)
    camera = stated.with_effect("row_noise", sigma_e=1.0)
    free = [*own, *effect_coordinates(camera, "row_noise")]
    known = cache.reference(lab, stated, own, 12, lambda *_: None)
    made = cache.reference(lab, camera, free, 12, lambda *_: None, known)
    monkeypatch.setattr(cache, "make_reference", None)  # nothing is simulated any more
    again = cache.reference(lab, camera, free, 12, lambda *_: None, known)
    assert again.coordinates == made.coordinates
    for use in ("find", "confirm", "whole"):
        for part in ("sets", "slopes", "least"):
            assert (getattr(getattr(again, use), part) == getattr(getattr(made, use), part)).all()
    bent = replace(known, find=replace(known.find, slopes=1.1 * known.find.slopes))
    with pytest.raises(TypeError):  # other derivatives are another reference
        cache.reference(lab, camera, free, 12, lambda *_: None, bent)


def test_a_changed_effect_file_is_simulated_anew(stated, tmp_path):
    file = tmp_path / "ripple.py"
    lab = Laboratory(frame_set(5), stated, 0)
    names = []
    for factor in (1, 2):  # the parameters stay, the law changes
        file.write_text(EFFECT.format(factor=factor))
        load_file(file)
        camera = stated.with_effect("ripple", sigma_e=1.0)
        names.append((cache.source_of("ripple"), cache.key(lab, camera, "reference")))
    assert names[0][0] != names[1][0]
    assert names[0][1] != names[1][1]
    assert cache.source_of("row_noise") == ""
