"""Sets above the budget: which frames and pixels are looked at, and that they are simulated as the whole set would be."""

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.small import SENSOR, stated_camera
from visaug import Camera, FrameSet, InputError
from visaug.camera.simulation import simulate
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.part import parts_of
from visaug.effects import catalogue
from visaug.frames import FrameRecord
from visaug.statistics.order import history_warnings
from visaug.statistics.split import FIND, share_out
from visaug.statistics.subsample import Selection, select

ROWS, COLUMNS = 240, 300
BUDGETS = {"budget": 250_000, "full": 600_000}
ELECTRON = 2  # DN: a rounding of the mean may make one electron more or less, 1.4 DN

# from the rest of the sensor: a window has the light that falls into it alone, and the chance to be hit
FROM_AFAR = {"cosmic_rays", "charge_transfer_inefficiency", "flicker_noise"}


def plan(frames_of_each: int = 4) -> FrameSet:
    settings = [("bias", 1e-5, None)] * (2 * frames_of_each)
    settings += [("dark", t, None) for t in (0.2, 3.0) for _ in range(frames_of_each)]
    settings += [("flat", 0.01, p) for p in (900.0, 4000.0, 11000.0) for _ in range(frames_of_each)]
    records = [FrameRecord(i, f"{i}.npy", k, t, 20.0, 0.0, p) for i, (k, t, p) in enumerate(settings)]
    unread = np.broadcast_to(np.uint16(0), (len(records), ROWS, COLUMNS))
    return FrameSet.from_arrays(records, unread, bit_depth=14)


def camera() -> Camera:
    return Camera.load({**stated_camera().to_dict(), "resolution": [ROWS, COLUMNS]})


@pytest.fixture(scope="module")
def selection() -> Selection:
    return select(plan(), **BUDGETS)


def test_windows_of_many_frames_and_a_few_full_ones(selection):
    assert (
        len(selection.frames)
        * np.prod([selection.window[1] - selection.window[0], selection.window[3] - selection.window[2]])
        <= BUDGETS["budget"]
    )
    used = selection.to_json()
    assert used["sensor"] == 1.0
    assert used["of"] == len(plan())
    assert used["frames"] <= used["of"]
    assert used["windows"] == [list(selection.window), used["frame"]]
    shared = share_out(plan().subset(selection.frames))
    confirms = {selection.frames[k] for k in shared.confirm}
    finds = {selection.frames[k] for k in shared.find}
    assert selection.full.fit
    assert not set(selection.full.fit) & confirms
    assert selection.full.confirm
    assert not set(selection.full.confirm) & finds
    kinds = [plan().records[i].kind for i in selection.full.fit]
    assert set(kinds) == {"bias", "dark", "flat"}
    assert kinds.count("bias") >= 2


def test_a_small_set_is_taken_whole():
    pixels = plan().shape(0)[0] * plan().shape(0)[1] * len(plan())
    assert not select(plan(), budget=pixels - 1).is_all
    chosen = select(plan(), budget=pixels)
    assert chosen.is_all
    assert chosen.to_json()["sensor"] == 1.0


def test_frames_are_spread_over_the_sequence_and_late_conditions_are_kept():
    records = [FrameRecord(i, f"{i}.npy", "bias", 0.0, 20.0) for i in range(300)]
    records += [FrameRecord(300 + i, f"{300 + i}.npy", "flat", 0.01, 20.0, 0.0, 500.0) for i in range(6)]
    frames = FrameSet.from_arrays(records, np.broadcast_to(np.uint16(9), (306, 150, 200)))
    chosen = select(frames, budget=1_500_000)
    assert chosen.window is None
    assert chosen.to_json()["sensor"] == 1.0
    biases = [i for i in chosen.frames if i < 300]
    assert biases[0] == 0
    assert biases[-1] == 299
    assert max(np.diff(biases)) <= 299 / (len(biases) - 1) + 1
    assert sum(i >= 300 for i in chosen.frames) >= 3


def test_dark_frames_after_scenes_are_taken_with_the_scene():
    records, cleans = [], {"s.npy": np.full((150, 200), 400.0, np.float32)}
    for i in range(120):
        kind = ("bias", "scene", "dark")[i % 3] if i > 60 else "bias"
        exposure = {"bias": 0.0, "scene": 0.01, "dark": 0.01}[kind]
        records.append(
            FrameRecord(i, f"{i}.npy", kind, exposure, 20.0, clean="s.npy" if kind == "scene" else None)
        )
    frames = FrameSet.from_arrays(records, np.broadcast_to(np.uint16(9), (120, 150, 200)), cleans)
    chosen = set(select(frames, budget=1_000_000).frames)
    darks = [i for i in chosen if records[i].kind == "dark"]
    assert darks
    assert all(i - 1 in chosen for i in darks)


NEEDS_A_FILE = ("unexplained",)
BEYOND = [name for name, e in catalogue().items() if not e.base and name not in (*FROM_AFAR, *NEEDS_A_FILE)]


@pytest.mark.parametrize("name", BEYOND)
def test_a_window_has_what_the_full_frames_have_there(selection, name):
    """Every effect of the catalogue, at its defaults, over bias, darks and flats: pixel by pixel, the same random numbers."""
    with_effect = camera().with_effect(name)
    window, full = parts_of(plan(), selection)
    whole = simulate(with_effect, plan(), 3)
    r0, r1, c0, c1 = selection.window
    taken = window.take(with_effect, 3)
    for k, i in enumerate(selection.frames):
        apart = np.abs(taken.read(k) - whole.read(i)[r0:r1, c0:c1])
        assert (apart > ELECTRON).mean() < 2e-4, plan().records[i]
    taken = full.take(with_effect, 3)
    for k, i in enumerate(selection.full_frames):
        assert (np.abs(taken.read(k) - whole.read(i)) > ELECTRON).mean() < 2e-4


def measured(change) -> FrameSet:
    """Frames of the benchmark's NumPy camera, changed by `change(frame in DN, exposure)`."""
    from benchmark.camera import Shot, take

    sensor = replace(SENSOR, rows=ROWS, columns=COLUMNS)
    shots = [Shot(r.kind, r.exposure_s, 20.0, r.photons) for r in plan().records]
    frames = take(sensor, shots, {}, 12)
    return FrameSet.from_arrays(
        plan().records,
        [
            change(f.astype(float), s.seconds).clip(0).astype(np.uint16)
            for f, s in zip(frames, shots, strict=True)
        ],
        bit_depth=14,
    )


def glow(frame, exposure_s):
    y, x = np.mgrid[:ROWS, :COLUMNS]
    return frame + 150 * exposure_s / 3 * np.exp(-np.hypot(ROWS - 1 - y, x) / 9)


def dark_edge(frame, _):
    frame = frame.copy()
    frame[:, -7:] -= 15
    return frame


def noisy_corner(frame, _):
    """An amplifier of its own for 30 x 40 pixels; new in every frame, which its own pixels seed."""
    frame = frame.copy()
    rng = np.random.default_rng(int(frame.sum()))
    frame[:30, -40:] += rng.normal(0, 10, (30, 40))
    return frame


@pytest.fixture(scope="module")
def modelled():
    """16 simulated sets of the camera as stated."""
    return Laboratory(measured(lambda frame, _: frame), camera(), 1, folds=False).finding(
        [(camera(), k) for k in range(16)]
    )


@pytest.fixture(autouse=True, scope="module")
def small_budgets():
    patch = pytest.MonkeyPatch()
    patch.setattr("visaug.diagnosis.laboratory.select", lambda frames: select(frames, **BUDGETS))
    yield
    patch.undo()


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (glow, "corner of last rows and first columns, 16 px"),
        (dark_edge, "last 8 columns"),
        (noisy_corner, "temporal noise of the corner of first rows and last columns, 16 px"),
        (lambda frame, _: frame, None),
    ],
)
def test_what_lies_in_a_corner_or_at_an_edge_is_seen_there(change, where, modelled):
    """Of 16 simulated sets: 12 standard deviations come by chance in none of a thousand statistics."""
    found = Laboratory(measured(change), camera(), 1, folds=False).measured[0]
    z = (found.values - modelled.mean(0)) / np.maximum(modelled.std(0, ddof=1), 1e-9)
    far = {
        s.name: abs(x)
        for s, x in zip(found.statistics, z, strict=True)
        if abs(x) > 12 and s.least_spread == 0
    }
    if where is None:
        assert not far
    else:
        assert where in far


@pytest.mark.parametrize("budget", [400_000, 10**9])
def test_frames_of_another_window_are_left_out_and_named(budget):
    records = [FrameRecord(i, f"{i}.npy", "bias", 0.0, 20.0) for i in range(30)]
    records += [replace(records[0], sequence=30 + i, window=(0, 50, 0, 60)) for i in range(3)]
    pixels = [np.zeros((150, 200), np.uint16)] * 30 + [np.zeros((50, 60), np.uint16)] * 3
    chosen = select(FrameSet.from_arrays(records, pixels), budget=budget)
    assert chosen.left_out[0].startswith("mixed_windows: 3 of 33")
    assert "image_lag" in chosen.left_out[0]
    assert max(chosen.frames) < 30


def test_frames_of_another_size_are_refused_in_one_line():
    records = [FrameRecord(i, f"{i}.npy", "bias", 0.0, 20.0) for i in range(30)]
    pixels = [np.zeros((150, 200), np.uint16)] * 29 + [np.zeros((150, 210), np.uint16)]
    frames = FrameSet.from_arrays(records, pixels, bit_depth=14)
    with pytest.raises(InputError, match=r"150 x 210.*region"):
        parts_of(frames, select(frames, budget=400_000))


def test_an_order_that_is_not_known_is_said_with_what_it_spoils():
    def bias(sequence, time_s=None, **other):
        return FrameRecord(sequence, "", **{"kind": "bias", **other}, time_s=time_s)

    assert history_warnings([bias(3, 0.0), bias(4, 1.0), bias(5, 1.0)]) == []
    (gap,) = history_warnings([bias(0), bias(1), bias(7)])
    assert gap.startswith("sequence_gap: 5 numbers are missing before the frames of sequence 7")
    assert "image_lag" in gap
    (order,) = history_warnings([bias(0, 5.0), bias(1, 6.0), bias(2, 4.0)])
    assert order.startswith("order_of_acquisition: frames of sequence 2 ")
    assert "drift" in order
    (unknown,) = history_warnings([bias(0), bias(1, kind="image")])
    assert unknown.startswith("unknown_frames: ")


def test_the_first_part_is_what_a_small_set_was(selection):
    frames = plan()
    (part,) = parts_of(frames, select(frames, budget=10**9))
    assert part.positions(FIND) == share_out(frames).find
    assert len(part.keep) == len(frames)
