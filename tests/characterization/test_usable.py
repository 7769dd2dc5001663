"""Frames that a camera model can explain: what the checks found beyond it is left out, in plain NumPy frames."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage, stats

from visaug.characterization.alarms import all_warnings, found_by_checks
from visaug.characterization.nonuniformity import structured
from visaug.characterization.usable import usable
from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet

SHAPE = (48, 64)


def taken(seed, light=1.0, change=None, lamp=None):
    rng = np.random.default_rng(seed)
    prnu = rng.normal(0, 0.01, SHAPE)

    def frame(kind, electrons):
        wave = lamp(rng) if lamp is not None and kind == "flat" else 1.0
        dn = 100 + (rng.poisson(electrons * light * wave * (1 + prnu)) + rng.normal(0, 4, SHAPE)) / 0.4
        return np.clip(np.rint(dn if change is None else change(dn)), 0, 4095).astype(np.uint16)

    kinds = [("bias", 0)] * 8 + [("flat", e) for e in (100, 400, 1000, 1400) for _ in range(4)]
    records = [
        FrameRecord(i, f"{i}", k, e / 1e4, 20.0, 0.0, e / 0.6 if k == "flat" else None)
        for i, (k, e) in enumerate(kinds)
    ]
    return FrameSet.from_arrays(records, [frame(k, e) for k, e in kinds], bit_depth=12)


def stuck(*where):
    def change(dn):
        dn = dn.copy()
        dn[where] = 0
        return dn

    return change


def test_sound_frames_are_the_same_set():
    frames = taken(0)
    assert usable(frames, SHAPE) is frames


@pytest.mark.parametrize("columns", [64, 56])
def test_overscan_is_cut_and_its_place_kept(columns):
    """A camera of the whole frame needs to know which part is shown; one of the lit part does not."""
    made = usable(taken(1, light=np.where(np.arange(64) < 56, 1.0, 0.0)), (48, columns))
    assert made.shape(0) == (48, 56)
    assert made.records[0].window == ((0, 48, 0, 56) if columns == 64 else None)
    assert any(w.startswith("overscan:") for w in all_warnings(made))


def test_frames_of_another_size_than_the_sensor_are_refused():
    for resolution in ((20, 20), (64, 48), (96, 128)):
        with pytest.raises(InputError, match=r"0: is 48 x 64; expected \d+ x \d+ as the camera's resolution"):
            usable(taken(0), resolution)
    frames = taken(0)
    told = [replace(record, window=(8, 56, 0, 64)) for record in frames.records]
    assert len(usable(frames.with_records(told), (96, 128))) == len(frames)


def test_constant_rows_get_values_of_several_rows():
    """Correlation of the new row's noise with any other row stays below five standard errors of independent ones."""
    frames = taken(2, change=stuck(slice(20, 21), slice(None)))
    made = usable(frames, SHAPE)
    flats = [i for i, r in enumerate(made.records) if r.kind == "flat"][-4:]
    noise = made.read_many(flats) - made.read_many(flats).mean(0)
    own = noise[:, 20].ravel()
    others = [np.corrcoef(own, noise[:, r].ravel())[0, 1] for r in range(48) if r != 20]
    assert np.ptp(own) > 0
    assert max(others) < 5 / np.sqrt(len(own))
    assert (made.read(0)[:20] == frames.read(0)[:20]).all()


def test_single_stuck_pixels_stay():
    frames = taken(3, change=stuck([10], [20]))
    assert usable(frames, SHAPE).read(0)[10, 20] == 0


def test_flats_of_a_lamp_with_bands_are_left_out():
    rows = np.arange(SHAPE[0])[:, None]
    frames = taken(4, lamp=lambda rng: 1 + 0.05 * np.sin(2 * np.pi * (rows / 20 + rng.random())))
    assert {r.kind for r in usable(frames, SHAPE).records} == {"bias"}


def test_light_that_drifts_behind_a_lens_that_falls_off_is_no_band():
    """Rows change together, each by its own signal: the whole light changes, which is the effect light_drift."""
    y = np.linspace(-1, 1, SHAPE[0])[:, None]
    frames = taken(5, light=1 - 0.5 * y**2, lamp=lambda rng: 1 + 0.05 * rng.standard_normal())
    assert not found_by_checks(frames).banded


@pytest.mark.parametrize("smooth", [True, False])
def test_one_filter_over_everything_is_told_from_noise_along_rows(smooth):
    def change(dn):
        return (
            ndimage.gaussian_filter(dn, 0.6)
            if smooth
            else dn + np.random.default_rng(int(dn.sum())).normal(0, 5, (48, 1))
        )

    assert found_by_checks(taken(6, change=change)).smoothed == smooth


def test_law_of_the_blocks_of_white_pixels():
    """Probabilities of 400 white maps are uniform; Kolmogorov's test fails one time in 1000."""
    rng = np.random.default_rng(7)
    chances = [structured(rng.normal(1, 0.01, SHAPE))[0] for _ in range(400)]
    assert stats.kstest(chances, "uniform").pvalue > 1e-3
