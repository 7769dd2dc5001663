"""An effect that `register` accepts never ends a diagnosis."""

import pytest

from visaug.diagnosis.candidates.trials import beside_words, effect_trials, form_trials, trials
from visaug.effects import Effect, Parameter, Stage


def an_effect(**parameters: Parameter) -> type[Effect]:
    def apply(self, signal, p, stream, context):
        return signal

    return type("Own", (Effect,), {"name": "own", "stage": Stage.READOUT, "apply": apply, **parameters})


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        (Parameter(0.0, unit="e-", strength=True), 1.0),
        (Parameter(2.0, unit="e-", strength=True), 2.0),
        (Parameter(0.0, high=0.5, strength=True), 0.5),
        (Parameter(0.0, strength=True, trials=(0.1, 3.0)), 0.1),
    ],
)
def test_a_strength_without_trial_values_is_tried_within_its_bounds(parameter, value):
    (trial,) = effect_trials(an_effect(level=parameter))
    assert dict(trial.values) == {"own.level": value}


def test_an_effect_without_a_strength_has_nothing_to_try():
    own = an_effect(period=Parameter(3.0, trials=(1.0, 2.0, 3.0)))
    assert effect_trials(own) == []
    assert form_trials(own) == []


def test_a_full_well_is_no_effects_parameter(stated):
    """Its path has no dot."""
    content = {k: v for k, v in stated.to_dict().items() if k != "full_well_e"}
    found = [t for t in trials(type(stated).load(content)) if t.effect == "saturation"]
    assert found
    assert [beside_words(trial) for trial in found] == [[]] * len(found)
    assert all(set(trial.by_name) == {"full_well_e"} for trial in found)


def test_values_that_a_camera_cannot_have_are_not_tried(stated):
    """A converter of few electrons: 0.3 of its range is less than the least full well."""
    content = {k: v for k, v in stated.to_dict().items() if k not in ("full_well_e", "black_level_dn")}
    content |= {"bit_depth": 1, "gain_e_per_dn": 1.2}
    tried = [t for t in trials(type(stated).load(content)) if t.effect == "saturation"]
    assert [t.values[0][1] for t in tried] == pytest.approx([1.44, 2.04])
