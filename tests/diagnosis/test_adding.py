"""A camera with one effect more: from where it is refitted."""

from types import SimpleNamespace

import numpy as np
import pytest

from visaug.diagnosis import adding
from visaug.diagnosis.adding import Adding
from visaug.diagnosis.parameters import Coordinate

BEYOND = Coordinate("brighter_fatter.beyond", False, 0.05, 0.5)
GAIN = Coordinate("gain_e_per_dn", True, 0.02, 0.3)


@pytest.mark.parametrize(
    ("misfits", "kept"),
    [
        ((90.0, 95.0), 0.05),  # about as deep: a form that meets the shoulders of a spot or its edges
        ((90.0, 40.0), 0.05),
        ((90.0, 100.0), 0.15),  # the other valley is clearly deeper
    ],
)
def test_numbers_stay_in_the_valley_where_they_were_unless_another_is_clearly_deeper(
    stated, monkeypatch, misfits, kept
):
    """The first fit takes the arms of a kernel to 0.15, a hundred standard deviations from where they were without tracks."""
    was = stated.with_effect("brighter_fatter", beyond=0.05)
    bent = stated.with_effect("brighter_fatter", beyond=0.15)
    begun = []

    def refit(lab, reference, report, begin=None):
        begun.append(begin)
        camera, fit = (bent, misfits[0]) if begin is None else (begin, misfits[1])
        return SimpleNamespace(camera=camera, misfit=fit)

    monkeypatch.setattr(adding, "refit", refit)
    spread = np.array([0.01, 0.001])
    reference = SimpleNamespace(
        coordinates=(GAIN, BEYOND), null_steps=np.array([1.0, -1.0])[:, None] * spread
    )
    first = SimpleNamespace(camera=stated, coordinates=(GAIN,))
    near = SimpleNamespace(camera=was, reference=SimpleNamespace(coordinates=(GAIN, BEYOND)))
    fitted = Adding(None, first, (), lambda *_: None)._refitted(reference, near)  # pyright: ignore[reportArgumentType]
    assert fitted.camera.values()["brighter_fatter.beyond"] == pytest.approx(kept)
    assert len(begun) == 2  # the gain is where the file says: that start is none of its own


def test_a_number_that_was_bent_is_tried_as_the_file_says(stated, monkeypatch):
    """Another valley must only be deeper."""
    bent = stated.replace({"gain_e_per_dn": 1.4})

    def refit(lab, reference, report, begin=None):
        return SimpleNamespace(camera=begin or bent, misfit=90.0 if begin is None else 89.0)

    monkeypatch.setattr(adding, "refit", refit)
    reference = SimpleNamespace(coordinates=(GAIN,), null_steps=np.array([[0.01], [-0.01]]))
    first = SimpleNamespace(camera=stated, coordinates=(GAIN,))
    near = SimpleNamespace(camera=bent, reference=SimpleNamespace(coordinates=(GAIN,)))
    fitted = Adding(None, first, (), lambda *_: None)._refitted(reference, near)  # pyright: ignore[reportArgumentType]
    assert fitted.camera.values()["gain_e_per_dn"] == pytest.approx(stated.values()["gain_e_per_dn"])
