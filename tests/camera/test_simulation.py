"""Frame sets as a camera would take them."""

import numpy as np
import pytest

from visaug.camera import Camera
from visaug.camera.simulation import simulate
from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet

ROWS, COLUMNS = 60, 80
CONTENT = {
    "resolution": [ROWS, COLUMNS],
    "bit_depth": 12,
    "gain_e_per_dn": 0.5,
    "black_level_dn": 200,
    "read_noise": {"sigma_e": 2.0},
    "prnu": {"column": 0.02, "row": 0.02, "pixel": 0.02},
    "dsnu": {"column_e": 8.0, "row_e": 8.0, "pixel_e": 8.0},
    "dark_current": {"a_e_per_s": 10.0, "b_per_c": 0.1},
}


def plan(*records: dict, cleans=None) -> FrameSet:
    """A plan of these records; its own pixels are zeros that nobody reads."""
    made = [FrameRecord(sequence=i, file=f"{i}.npy", **{"kind": "bias", **r}) for i, r in enumerate(records)]
    shapes = [
        (ROWS, COLUMNS) if r.window is None else (r.window[1] - r.window[0], r.window[3] - r.window[2])
        for r in made
    ]
    return FrameSet.from_arrays(made, [np.zeros(shape, np.uint16) for shape in shapes], cleans or {})


def simulated(camera: Camera, frames: FrameSet, seed: int = 0) -> np.ndarray:
    taken = simulate(camera, frames, seed)
    return np.stack([taken.read(i).astype(np.float64) for i in range(len(taken))])


def test_fixed_patterns_are_kept_over_frames_and_noise_is_not():
    """Two bias frames share the pattern, variance 192 e-^2, and not the read noise, 4 e-^2 and rounding,
    1/48 e-^2.
    """
    first, second = simulated(Camera.load(CONTENT), plan({}, {}))
    assert np.corrcoef(first.ravel(), second.ravel())[0, 1] > 0.95
    noise_e = (first - second).std() / np.sqrt(2) * 0.5
    assert noise_e == pytest.approx(np.sqrt(4 + 0.25 / 12), rel=5 / np.sqrt(2 * ROWS * COLUMNS))


def test_camera_and_plan_can_be_files(tmp_path):
    camera = Camera.load(CONTENT)
    camera.save(tmp_path / "camera.yaml")
    (tmp_path / "plan.csv").write_text("sequence,file,kind\n0,a.tif,bias\n")
    (frame,) = simulated(camera, plan({}))
    taken = simulate(tmp_path / "camera.yaml", tmp_path / "plan.csv")
    assert (taken.read(0) == frame).all()
    with pytest.raises(InputError, match="no such file"):
        simulate(camera, tmp_path / "nowhere.csv")


def test_the_pattern_of_the_light_is_kept_too():
    frames = simulated(
        Camera.load({**CONTENT, "dsnu": {}}),
        plan(*[{"kind": "flat", "photons": 1000.0, "exposure_s": 0.0}] * 8),
    )
    odd, even = frames[::2].mean(0), frames[1::2].mean(0)
    shared = np.cov(odd.ravel(), even.ravel())[0, 1]
    # 3 * 0.02^2 of the light, within the scatter of 60 rows and 80 columns drawn
    assert np.sqrt(shared) * 0.5 / 1000 == pytest.approx(0.02 * np.sqrt(3), rel=0.25)


def test_a_seed_repeats_the_set_and_another_is_another_camera():
    camera, frames = Camera.load(CONTENT), plan({}, {})
    np.testing.assert_array_equal(simulated(camera, frames, 5), simulated(camera, frames, 5))
    one, other = simulated(camera, frames, 5), simulated(camera, frames, 6)
    assert abs(np.corrcoef(one[0].ravel(), other[0].ravel())[0, 1]) < 0.4  # rows and columns are few


def test_windows_are_crops_of_the_whole_frame():
    """Noise and patterns belong to places on the sensor, so the same frame in a window is its part."""
    camera = Camera.load(CONTENT).with_effect("row_noise", sigma_e=3.0)
    flat = {"kind": "flat", "photons": 300.0, "exposure_s": 0.01}
    (whole,) = simulated(camera, plan(flat))
    (part,) = simulated(camera, plan({**flat, "window": (7, 31, 11, 50)}))
    np.testing.assert_array_equal(part, whole[7:31, 11:50])


def test_frames_do_not_depend_on_what_else_is_in_the_set():
    camera = Camera.load(CONTENT)
    many = simulated(camera, plan(*[{"kind": "dark", "exposure_s": 0.1 * i} for i in range(5)]))
    alone = plan(*[{"kind": "dark", "exposure_s": 0.1 * i} for i in range(5)]).subset([3])
    np.testing.assert_array_equal(simulated(camera, alone)[0], many[3])


def test_each_frame_has_its_own_exposure_temperature_and_gain():
    """Mean dark signal K t a exp(b T): 5 standard errors, patterns off; 6.02 dB double it; no temperature:
    the camera's.
    """
    camera = Camera.load({**CONTENT, "prnu": {}, "dsnu": {}, "temperature_c": 10.0})
    conditions = [
        (0.0, 20.0, 0.0),
        (2.0, 20.0, 0.0),
        (2.0, 30.0, 0.0),
        (2.0, 20.0, 20 * np.log10(2)),
        (2.0, None, 0.0),
    ]
    records = [{"kind": "dark", "exposure_s": t, "temperature_c": c, "gain_db": g} for t, c, g in conditions]
    for frame, (exposure, temperature, gain_db) in zip(simulated(camera, plan(*records)), conditions):
        k = 2.0 * 10 ** (gain_db / 20)
        electrons = exposure * 10 * np.exp(0.1 * (10.0 if temperature is None else temperature))
        error = k * np.sqrt((4 + electrons) / frame.size)
        assert frame.mean() == pytest.approx(200 + k * electrons, abs=5 * error)


def test_a_scene_shows_its_target():
    clean = np.linspace(0, 900, ROWS * COLUMNS).reshape(ROWS, COLUMNS).astype(np.float32)
    camera = Camera.load({**CONTENT, "prnu": {}, "dsnu": {}, "dark_current": {}})
    frames = plan({"kind": "scene", "clean": "scene.npy", "exposure_s": 0.01}, cleans={"scene.npy": clean})
    taken = simulate(camera, frames)
    left = (taken.read(0).astype(np.float64) - 200) * 0.5 - clean
    assert (left / np.sqrt(clean + 4.1)).std() == pytest.approx(
        1, rel=0.06
    )  # 5 standard errors of 4800 pixels
    np.testing.assert_array_equal(taken.clean(0), clean)


def test_lag_remembers_the_frame_before_over_batches(monkeypatch):
    """Batches of one frame give the same set as one batch."""
    camera = Camera.load(CONTENT).with_effect("image_lag")
    records = [
        {"kind": "flat", "photons": 800.0, "exposure_s": 0.01},
        {"kind": "dark", "exposure_s": 0.01},
    ] * 2
    together = simulated(camera, plan(*records))
    monkeypatch.setattr("visaug.camera.simulation.BATCH_PIXELS", 1)
    np.testing.assert_array_equal(simulated(camera, plan(*records)), together)


def test_a_change_of_window_within_a_set_with_memory():
    camera = Camera.load(CONTENT).with_effect("image_lag").with_effect("black_level_drift")
    frames = plan({}, {"window": (0, 20, 0, 30)}, {"window": (20, 40, 0, 30)}, {})
    taken = simulate(camera, frames)
    assert [taken.read(i).shape for i in range(4)] == [(ROWS, COLUMNS), (20, 30), (20, 30), (ROWS, COLUMNS)]


def test_values_are_whole_and_within_the_converters_range():
    frames = plan({"kind": "flat", "photons": 1e6, "exposure_s": 0.01}, {})
    taken = simulate(Camera.load({**CONTENT, "black_level_dn": 0}), frames)
    assert taken.bit_depth == 12
    assert taken.read(0).max() == 4095
    assert taken.read(1).min() == 0
    assert np.mod(taken.read(1), 1).max() == 0


def test_progress_is_told():
    calls = []
    simulate(Camera.load(CONTENT), plan({}, {}, {}), progress=lambda *call: calls.append(call))
    assert calls[-1][1:] == (3, 3)


@pytest.mark.parametrize(
    ("record", "field"),
    [
        ({"kind": "flat", "exposure_s": 0.01}, "photons"),
        ({"kind": "scene", "exposure_s": 0.01}, "clean"),
        ({"kind": "image"}, "kind"),
        ({"window": (0, 61, 0, 10)}, "region"),
    ],
)
def test_what_cannot_be_simulated_names_the_file_and_field(record, field):
    with pytest.raises(InputError) as caught:
        simulate(Camera.load(CONTENT), plan(record))
    assert "0.npy" in str(caught.value)
    assert field in str(caught.value)


def test_a_target_of_another_size_is_refused():
    frames = plan(
        {"kind": "scene", "clean": "s.npy", "exposure_s": 0.01}, cleans={"s.npy": np.ones((3, 3), np.float32)}
    )
    with pytest.raises(InputError, match=r"s\.npy.*3"):
        simulate(Camera.load(CONTENT), frames)


def test_a_target_with_missing_values_is_refused():
    clean = np.ones((ROWS, COLUMNS), np.float32)
    clean[1, 2] = np.nan
    frames = plan({"kind": "scene", "clean": "s.npy", "exposure_s": 0.01}, cleans={"s.npy": clean})
    with pytest.raises(
        InputError, match=r"s\.npy: holds values that are no numbers; expected photons per pixel"
    ):
        simulate(Camera.load(CONTENT), frames)


def test_a_seed_of_numpys_is_that_of_pythons():
    frames = plan({"kind": "bias", "exposure_s": 0.0})
    first, second = (simulate(Camera.load(CONTENT), frames, seed=seed).read(0) for seed in (3, np.int64(3)))
    np.testing.assert_array_equal(first, second)
    with pytest.raises(InputError, match="seed: 'x' is not valid; expected a whole number"):
        simulate(Camera.load(CONTENT), frames, seed="x")
