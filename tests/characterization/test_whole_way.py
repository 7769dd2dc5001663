"""Frames to camera to comparison: the camera that was measured, beside the frames that it was measured from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import visaug
from visaug.characterization import characterize
from visaug.effects import catalogue
from visaug.frames import FrameRecord, FrameSet


def numpy_frames(seed: int) -> FrameSet:
    """A NumPy camera of 0.4 e-/DN, 60 x 72: bias frames, dark frames at three temperatures, flats of six levels."""
    rng = np.random.default_rng(seed)
    shape = 60, 72
    response = 1 + 0.009 * rng.standard_normal(shape)
    offset = 1.1 * rng.standard_normal(shape) + 0.9 * rng.standard_normal(shape[1])
    plan = [("bias", 0.0, 20.0, None)] * 12
    plan += [("dark", t, T, None) for T in (15.0, 22.0, 30.0) for t in (0.5, 2.0) for _ in range(2)]
    plan += [("flat", 0.01, 20.0, float(p)) for p in (120, 400, 800, 1300, 1900, 2500) for _ in range(2)]
    frames = []
    for _, exposure, temperature, photons in plan:
        dark = exposure * 1.5 * np.exp(0.1 * temperature)
        electrons = rng.poisson(0.6 * (photons or 0.0) * response + dark)
        dn = np.rint((electrons + offset + 2.4 * rng.standard_normal(shape)) / 0.4 + 180.3)
        frames.append(np.clip(dn, 0, 4095).astype(np.uint16))
    records = [FrameRecord(i, f"{i}", k, t, T, 0.0, p) for i, (k, t, T, p) in enumerate(plan)]
    return FrameSet.from_arrays(records, frames)


def test_where_nothing_is_hidden_the_camera_that_was_measured_holds():
    """False-alarm rate 2 % for the true camera."""
    frames = numpy_frames(21)
    result = characterize(frames)
    content = result.to_camera_dict()
    assert content["bit_depth"] == 12
    assert "effects" not in content
    compared = visaug.compare(result.camera, frames, seed=2)
    assert compared.adequate, compared.where()


@pytest.mark.parametrize(
    ("bits", "gain", "read_dn", "black_dn"),
    [(12, 1.0, 2.0, 1.9), (10, 10.0, 0.6, 5.3), (8, 60.0, 0.3, 0.6)],
    ids=["a sixth of the bias frames cut", "noise of 0.6 DN", "8 bits"],
)
def test_cameras_of_several_kinds_hold(bits, gain, read_dn, black_dn):
    """Each is rejected by chance once in 50. Uneven offsets, 1 % PRNU, flats up to saturation."""
    rng, shape = np.random.default_rng([bits, 5]), (40, 48)
    response, offset = 1 + 0.01 * rng.standard_normal(shape), 0.7 * read_dn * rng.standard_normal(shape)
    top = 2**bits - 1
    plan = [("bias", None, 0.0)] * 12
    plan += [
        ("flat", s * top * gain / 0.5, s * top * gain)
        for s in (0.03, 0.1, 0.2, 0.4, 0.6, 0.8, 1.3)
        for _ in range(3)
    ]
    frames = []
    for _, _, mean in plan:
        dn = rng.poisson(mean * response) / gain + offset + read_dn * rng.standard_normal(shape) + black_dn
        frames.append(np.clip(np.rint(dn), 0, top).astype(np.uint8 if bits == 8 else np.uint16))
    records = [FrameRecord(i, f"{i}", kind, 0.01, 20.0, 0.0, p) for i, (kind, p, _) in enumerate(plan)]
    frame_set = FrameSet.from_arrays(records, frames)
    compared = visaug.compare(characterize(frame_set).camera, frame_set, seed=4)
    assert compared.adequate, compared.where()


def ccd_window(
    rows: int = 64,
    columns: int = 80,
    exposures: tuple[float, ...] = (4e-5, 0.00118, 0.0029, 0.0046, 0.00632, 0.0086, 0.0103),
) -> FrameSet:
    """A window of the shipped CCD: one stack of dark frames, pairs of dark frames and flats of seven exposures."""
    whole = FrameSet.load(Path(visaug.__file__).parent / "data" / "ccd12")
    chosen = [i for i, r in enumerate(whole.records) if r.exposure_s in exposures]
    chosen += [i for i, r in enumerate(whole.records) if r.kind == "dark" and r.exposure_s == 0.00516][:8]
    window = 144, 144 + rows, 192, 192 + columns
    records = [replace(whole.records[i], window=window) for i in sorted(chosen)]
    frames = [whole.read(i)[:rows, :columns].astype(np.uint16) for i in sorted(chosen)]
    return FrameSet.from_arrays(records, frames)


def test_what_was_measured_of_a_real_ccd_brings_its_camera_closer():
    """Row noise and dark current are in the camera; without them it is farther from the frames, in the views of rows most."""
    frames = ccd_window()
    result = characterize(frames)
    content = result.to_camera_dict()
    assert content["bit_depth"] == 12
    assert [e["name"] for e in content["effects"] if e["name"] == "row_noise"]
    camera = result.camera
    bare = camera.without_effect("row_noise").replace({"dark_current.a_e_per_s": 0.0})
    with_all, without = (visaug.compare(c, frames, seed=3) for c in (camera, bare))

    def distance(compared: visaug.Comparison, views: tuple[str, ...] = ()) -> float:
        seen = [
            (not views or s.view in views) and d > 0 for s, d in zip(compared.statistics, with_all.spread)
        ]
        z = (compared.measured - compared.modelled)[seen] / with_all.spread[seen]
        return float((z**2).mean())

    rows = "temporal_lines", "temporal_spectrum"
    assert distance(with_all) < distance(without)
    assert distance(with_all, rows) < 0.2 * distance(without, rows)


def test_a_diagnosis_of_the_camera_that_was_measured_raises_no_error():
    """The real CCD without the search for effects: the remaining difference is reported, and the refit does not raise the error."""
    frames = ccd_window(40, 48, exposures=(0.00118, 0.0046, 0.0086))
    camera = characterize(frames).camera
    found = visaug.diagnose(camera, frames, without=list(catalogue()), sets=50, seed=3)
    assert found.accepted == ()
    assert found.to_json()["error"]["after"] <= 1
    assert not found.adequate_after
    assert found.unexplained is not None
    assert "level" in found.unexplained.axis


@pytest.mark.slow
def test_unequal_codes_of_a_real_ccd_are_named():
    """Of the effects of the converter: the widths of its codes repeat after four, as a code-density test shows too."""
    frames = ccd_window()
    counts = np.zeros(4096)
    for i in range(len(frames)):
        counts += np.bincount(frames.read(i).astype(int).ravel(), minlength=4096)
    expected = np.convolve(counts, np.r_[0.5, np.ones(3), 0.5] / 4, "same")
    code = np.arange(4096)
    inner = (expected > 20) & (code > 8) & (code < 4000)
    widths = [
        counts[inner & (code % 4 == k)].sum() / expected[inner & (code % 4 == k)].sum() for k in range(4)
    ]
    assert min(widths[:2]) > 1.02
    assert max(widths[2:]) < 0.99
    camera = characterize(frames).camera
    others = set(catalogue()) - {"code_widths", "missing_codes", "bit_truncation"}
    found = visaug.diagnose(camera, frames, without=sorted(others), sets=60)
    assert found.accepted == ("code_widths",)
    assert found.camera.choices()["code_widths.pattern"] == "stage"
    assert found.camera.values()["code_widths.period"] == 4
    assert found.to_json()["error"]["after"] < 0.95
