"""When an effect is accepted: the error must fall on both sorts of frames, and a further one must take its share."""

import pytest

from visaug.comparison import Error
from visaug.diagnosis.acceptance import improves


def at(value: float, half: float = 0.01) -> Error:
    return Error(value, value - half, value + half)


@pytest.mark.parametrize(
    ("before", "after", "first", "accepted"),
    [
        ((at(1.0), at(1.0)), (at(0.1), at(0.1)), True, True),
        ((at(1.0), at(1.0)), (at(0.995), at(0.9)), True, False),  # within chance on the frames that find
        ((at(1.0), at(1.0)), (at(0.1), at(1.2)), True, False),  # the frames that confirm disagree
        ((at(1.0), at(1.0)), (at(0.1), at(7.0, 2.0)), True, True),  # these are too unclear to disagree
        (
            (at(1.0, 1e-4), at(1.0)),
            (at(0.985, 1e-4), at(0.9)),
            True,
            False,
        ),  # beyond chance, but next to nothing
        ((at(0.005, 1e-4), at(0.005)), (at(0.0, 1e-4), at(0.0)), False, False),  # a trace is mopped up
        ((at(0.3), at(0.3)), (at(0.0), at(0.0)), False, True),
        ((None, None), (None, None), True, True),
        ((None, None), (None, None), False, False),
        ((at(1.0), None), (at(0.2), None), True, True),  # no frames to confirm on
    ],
)
def test_improves(before, after, first, accepted):
    assert improves(before, after, first) is accepted


def test_a_faint_effect_is_hidden_by_the_noise_of_the_rest():
    before, after = (at(0.05, 0.5), None), (at(-0.1, 0.5), None)
    assert not improves(before, after, True)
    assert improves(before, after, True, beyond_chance=True)
    assert not improves(after, before, True, beyond_chance=True)
