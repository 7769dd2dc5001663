"""Lines of progress where there is no terminal."""

import pytest

from visaug.core import progress


def test_a_phase_that_comes_again_is_timed_from_its_own_beginning(monkeypatch, capsys):
    """Ten minutes of another phase lie between two runs of "refitting", each step of which takes 40 s."""
    clock = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: clock[0])
    with progress.progress_bars(single=True) as report:
        for step, seconds in ((0, 0), (1, 40), (2, 40)):
            clock[0] += seconds
            report("refitting", step, 3)
        clock[0] += 600
        report("simulating", 0, 1)
        clock[0] += 600
        for step, seconds in ((0, 0), (1, 40), (0, 600), (1, 40)):
            clock[0] += seconds
            report("refitting", step, 3)
    assert capsys.readouterr().err.splitlines() == [
        "refitting",
        "refitting (1 of 3), about 80 s left",
        "refitting (2 of 3), about 40 s left",
        "simulating",
        "refitting (0 of 3)",
        "refitting (1 of 3), about 80 s left",
        "refitting (0 of 3)",
        "refitting (1 of 3), about 80 s left",
    ]


@pytest.mark.parametrize(
    ("step", "phase"),
    [
        ("trying vignetting", "trying, one effect after the other"),
        ("limit of vignetting", "limits, one effect after the other"),
        ("simulating 30 sets of the camera", "simulating 30 sets of the camera"),
    ],
)
def test_what_was_found_stands_before_each_later_step(step, phase):
    """Of 90 s of a diagnosis a third comes after the effect is known."""
    told = []
    report = progress.beside(lambda *of: told.append(of), ("row_noise", "image_lag"))
    report(step, 2, 5)
    assert told == [(f"row_noise and image_lag found: {step}", 2, 5)]
    assert progress.phase_of(told[0][0]) == f"row_noise and image_lag found: {phase}"
    assert progress.phase_of(step) == phase
