"""What one diagnosis keeps serves the next, and nothing stale does."""

from tests.diagnosis.small import frame_set
from visaug.comparison import Laboratory
from visaug.diagnosis import cache, search
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
        real = search.signatures
        with monkeypatch.context() as patch:
            patch.setattr(search, "signatures", lambda *a: (tried.extend(a[2]), real(*a))[1])
            looking = search._Search(lab, stated, without, lambda *_: None, 20)
            return looking._signatures(looking._reference()), {trial.effect for trial in tried}

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
    looking = search._Search(lab, stated, few, lambda *_: None, 20)
    reference = looking._reference()
    looking._signatures(reference)
    kept = looking._signatures(reference)
    direct = search.signatures(lab, reference, search.trials(stated, few), lambda *_: None)
    assert kept.trials == direct.trials
    assert (kept.values == direct.values).all()


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
