"""The story of the hidden effect: told from an answer that is kept."""

from dataclasses import dataclass

import pytest

import visaug
from visaug_train.studies import story

ANSWER = {
    "schema": 1,
    "error": {"before": 1.0, "after": 0.05, "floor": 0.0, "interval_after": [-0.02, 0.1]},
    "fits": {"p_value_before": 0.003, "p_value_after": 0.4, "adequate_before": False, "adequate_after": True},
    "where": [],
    "ranking": [],
    "accepted": ["amplifier_glow"],
    "steps": [{"action": "add amplifier_glow", "error": 0.05, "interval": [-0.02, 0.1]}],
    "frames": {"fit": [0], "select": [1], "confirm": [2]},
    "ambiguous": [],
    "unexplained": None,
}


@dataclass
class Answer:
    camera: visaug.Camera

    def to_json(self):
        return ANSWER


@pytest.fixture
def asked(monkeypatch):
    """Counts diagnoses, and answers each without simulating."""
    calls = []

    def diagnose(camera, frames, seed=0, progress=None):
        calls.append((len(frames), seed))
        return Answer(camera.with_effect("amplifier_glow"))

    monkeypatch.setattr(visaug, "diagnose", diagnose)
    return calls


def test_frames_are_diagnosed_once_for_each_seed(asked, tmp_path):
    first = story.hidden_effect_sections(tmp_path, seed=3)
    again = story.hidden_effect_sections(tmp_path, seed=3)
    assert asked == [(67, 3)]
    assert first == again
    story.hidden_effect_sections(tmp_path, seed=4)
    assert asked[1:] == [(67, 4)]


def test_the_story_tells_what_was_missing(asked, tmp_path):
    sections = story.hidden_effect_sections(tmp_path)
    assert all(section.title.startswith("Hidden effect") for section in sections)
    said = " ".join(block.text for section in sections for block in section.blocks if hasattr(block, "text"))
    assert "The missing effect is amplifier_glow" in said
    assert any(hasattr(block, "uri") for block in sections[0].blocks)


def test_the_file_that_comes_along_tells_nothing_of_the_effect():
    assert visaug.Camera.load(story.FRAMES / "camera.yaml").effect_names == []
