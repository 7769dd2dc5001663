"""A look at what blooms against charge that is moved pixel by pixel."""

import numpy as np
import pytest
import torch

from tests.diagnosis.small import SENSOR, stated_camera
from visaug import FrameSet
from visaug.diagnosis.candidates.look import look, spilled
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import FrameSummary, catalogue
from visaug.frames import FrameRecord

WELL_E = 10000.0


def spill(light: np.ndarray, share: float, upward: float) -> np.ndarray:
    """Of each pixel's excess its share runs up and down, filling every well on its way."""
    filled = np.minimum(light, WELL_E)
    for rows, part in ((range(len(light)), 1 - upward), (range(len(light))[::-1], upward)):
        for column in range(light.shape[1]):
            carried = 0.0
            for row in rows:
                carried += share * part * max(light[row, column] - WELL_E, 0)
                taken = min(carried, WELL_E - filled[row, column])
                filled[row, column] += taken
                carried -= taken
    return filled


def scene(top: int = 40, rows: int = 90) -> np.ndarray:
    light = np.full((rows, 12), 300.0)
    light[top : top + 5, 3:9] = 60000.0
    return light


def looks(light: np.ndarray, read: np.ndarray):
    rng = np.random.default_rng(1)
    seen = spilled(light, read + rng.normal(0, 5, read.shape), WELL_E)
    none = np.zeros(0)
    seen_at = FrameSummary(np.zeros((0, 0)), none, none, none, np.zeros((0, 0)), spilled_e=seen)
    return seen, catalogue()["blooming"].looks(seen_at)


@pytest.mark.parametrize(("share", "upward"), [(1.0, 0.5), (1.0, 0.0), (0.9, 0.3), (0.3, 1.0)])
def test_share_and_direction_of_what_blooms(share, upward):
    """Read noise of 5 e- in some hundred pixels is no more than 1e-3 of 1.5 10^6 e-."""
    seen, (point,) = looks(scene(), spill(scene(), share, upward))
    assert len(seen) == 6
    assert point["share"] == pytest.approx(share, rel=0.01)
    assert point["upward"] == pytest.approx(upward, abs=0.01)


@pytest.mark.parametrize(("share", "upward"), [(1.0, 0.2), (0.6, 0.9)])
def test_blooming_moves_charge_as_it_is_moved_pixel_by_pixel(run_effect, share, upward):
    known = {"full_well_e": WELL_E}
    image = torch.from_numpy(scene()[None, None]).float()
    bloomed = run_effect("blooming", image, known=known, share=share, upward=upward)[0, 0].numpy()
    expected = spill(scene(), share, upward)
    np.testing.assert_allclose(np.minimum(bloomed, WELL_E), expected, rtol=1e-5)


def test_what_runs_off_an_end_tells_no_share():
    light = scene(top=4)
    seen, points = looks(light, spill(light, 1.0, 0.5))
    assert len(seen) == 0
    assert points == []


def test_full_wells_that_stay_full_do_not_bloom():
    seen, points = looks(scene(), np.minimum(scene(), WELL_E))
    assert len(seen) == 6
    assert points == []


@pytest.fixture
def lab() -> Laboratory:
    """Bias frames, and scenes whose charge the NumPy camera spills, four fifths of it downwards."""
    from benchmark.camera import Hidden, Shot, take
    from benchmark.charge import blooming

    target = np.full(SENSOR.shape, 40.0, np.float32)
    target[20:24, 30:36] = 80000.0
    plan = [Shot("bias", 1e-5, 20.0)] * 4 + [Shot("scene", 0.01, 20.0, target="spot")] * 2
    spill_over = Hidden("spill", "charge", blooming, 0.7, "one way mostly")
    frames = take(SENSOR, plan, {"spot": target}, 3, [spill_over])
    records = [
        FrameRecord(
            i, f"{i}.npy", s.kind, s.seconds, s.celsius, 0.0, clean="spot" if s.kind == "scene" else None
        )
        for i, s in enumerate(plan)
    ]
    return Laboratory(
        FrameSet.from_arrays(records, list(frames), {"spot": target}, bit_depth=SENSOR.bits), stated_camera()
    )


def test_a_look_at_frames_goes_by_their_electrons(lab):
    """DN by the camera's gain and black level, photons by its quantum efficiency.

    PRNU of 0.7 % and shot noise of 0.5 % over 24 pixels leave the share known to 0.2 %: a tenth of the tolerance.
    """
    found = look(lab, stated_camera())
    assert found is not None
    assert len(found.spilled_e) == 6
    (point,) = catalogue()["blooming"].looks(found)
    assert point["share"] == pytest.approx(0.7, rel=0.02)
    assert point["upward"] == pytest.approx(0.2, abs=0.01)


def test_without_a_full_well_the_converter_is_the_limit(lab):
    """As with a well that holds more than the converter's range."""
    found, wide = (look(lab, stated_camera().replace({"full_well_e": well_e})) for well_e in (None, 1e6))
    assert found is not None
    assert wide is not None
    assert len(found.spilled_e) > 0
    np.testing.assert_array_equal(found.spilled_e, wide.spilled_e)
