"""Views measure what they say: white noise against theory, and one planted difference each."""

import numpy as np
import pytest

from visaug.frames import FrameRecord, FrameSet
from visaug.statistics import VIEWS, FrameData, fingerprint
from visaug.statistics.reduction import without_lone_pixels
from visaug.statistics.views.drawn import spectrum_marks
from visaug.statistics.views.scene import _Key, _shift, _target
from visaug.statistics.views.spectrum import peak_frequency, power

ROWS, COLUMNS = 60, 80


def frames_of(make, count=12, kind="bias", **record):
    """A set in memory: `make(rng, i)` gives frame i."""
    rng = np.random.default_rng(7)
    records = [
        FrameRecord(i, f"{i}.npy", kind, record.get("exposure_s", 0.0), 20.0, 0.0, record.get("photons"))
        for i in range(count)
    ]
    return FrameSet.from_arrays(records, [make(rng, i).astype(np.float32) for i in range(count)])


def white(rng, _):
    return rng.normal(100, 10, (ROWS, COLUMNS))


def test_white_noise_has_no_structure():
    """Tolerances are five standard errors: a false alarm in about one run of a million of seeds."""
    f = fingerprint(frames_of(white))
    assert f["level/mean/bias"] == pytest.approx(100, abs=5 * 10 / np.sqrt(12 * ROWS * COLUMNS))
    free = 11 * (ROWS - 1) * (COLUMNS - 1)
    # the pixel part lacks rows and columns: its mean square is lower by their share
    expected = 100 * (1 - 1 / ROWS) * (1 - 1 / COLUMNS)
    assert np.exp(f["photon_transfer/variance/bias"]) == pytest.approx(expected, rel=5 * np.sqrt(2 / free))
    for lag in ("one column on", "one row on", "diagonal"):
        assert f[f"noise_covariance/{lag}/bias"] == pytest.approx(-1 / 60, abs=5 / np.sqrt(free) + 0.02)
    rows = np.exp(f["temporal_lines/rows/bias"]) - 0.01
    assert rows == pytest.approx(1, abs=5 * np.sqrt(2 / (11 * ROWS)))


def test_row_noise_shows_in_rows_alone():
    def with_rows(rng, i):
        return white(rng, i) + rng.normal(0, 3, (ROWS, 1))

    f = fingerprint(frames_of(with_rows))
    ratio = 1 + 9 / 100 * COLUMNS  # row variance over what white noise gives a mean of COLUMNS pixels
    assert np.exp(f["temporal_lines/rows/bias"]) == pytest.approx(ratio, rel=0.25)
    assert np.exp(f["temporal_lines/columns/bias"]) == pytest.approx(1, abs=0.3)


def test_neighbours_that_share_noise():
    def shared(rng, _):
        noise = rng.normal(0, 10, (ROWS, COLUMNS))
        return 100 + 0.9 * noise + 0.1 * np.roll(noise, 1, 1)

    f = fingerprint(frames_of(shared))
    assert f["noise_covariance/one column on/bias"] == pytest.approx(0.09 / 0.82, abs=0.03)
    assert f["noise_covariance/one row on/bias"] == pytest.approx(-1 / 60, abs=0.03)


def test_parity_and_halves():
    def uneven(rng, i):
        frame = white(rng, i)
        frame[1::2] += 4
        frame[:, COLUMNS // 2 :] += 2
        return frame

    f = fingerprint(frames_of(uneven))
    assert f["seams/odd against even rows/bias"] == pytest.approx(4, abs=0.5)
    assert f["seams/halves of columns/bias"] == pytest.approx(2, abs=0.5)


def test_lost_bits():
    f = fingerprint(frames_of(lambda rng, i: np.round(white(rng, i)).astype(int) & ~1))
    assert f["codes/dark: bit 0 set/bias"] == 0
    assert f["codes/dark: bit 1 set/bias"] == pytest.approx(0.5, abs=0.05)


def test_memory_is_the_share_of_the_frame_before():
    rng = np.random.default_rng(3)
    target = np.zeros((ROWS, COLUMNS), np.float32)
    target[20:30, 30:50] = 1000
    records, frames = [], []
    for i in range(8):
        records.append(FrameRecord(i, f"{i}.npy", "bias", 0.0, 20.0))
        frames.append(rng.normal(100, 3, (ROWS, COLUMNS)))
    for i in range(8, 16, 2):
        records.append(FrameRecord(i, f"{i}.npy", "scene", 0.01, 20.0, clean="spot.npy"))
        records.append(FrameRecord(i + 1, f"{i + 1}.npy", "dark", 0.01, 20.0))
        frames.append(rng.normal(100, 3, (ROWS, COLUMNS)) + target)
        frames.append(rng.normal(100, 3, (ROWS, COLUMNS)) + 0.02 * target)
    kept = FrameSet.from_arrays(records, [f.astype(np.float32) for f in frames], {"spot.npy": target})
    f = fingerprint(kept)
    assert f["memory/slope on a bright scene before/dark 0.01 s 20 C"] == pytest.approx(0.02, abs=0.001)


def test_a_step_between_flats_leaves_its_share_in_the_next_frame():
    """Ten flats of 500 DN, ten of 2000 DN, of which the first keeps 3 % of the step; a mean is known to 0.05 DN."""
    rng, levels = np.random.default_rng(4), [500.0] * 10 + [2000.0] * 10
    records = [
        FrameRecord(i, f"{i}.npy", "flat", 0.01, 20.0, 0.0, photons=2 * level)
        for i, level in enumerate(levels)
    ]
    frames = [rng.normal(level, 3, (ROWS, COLUMNS)) for level in levels]
    frames[10] += 0.03 * (500 - 2000)
    f = fingerprint(FrameSet.from_arrays(records, [frame.astype(np.float32) for frame in frames]))
    (name,) = (name for name in f.labels if name.startswith("memory/share of a step between flats"))
    assert f[name] == pytest.approx(0.03, abs=0.0005)


def test_memory_takes_no_step_from_frames_of_the_same_conditions_out_of_use():
    """Flats at one level: every frame before is of that level too, whether or not the statistics use it and hold its pixels."""
    pixels = [white(np.random.default_rng(i), i) for i in range(8)]
    pixels[1::2] = [np.zeros((1, 1))] * 4  # of the frames that are not looked at
    flats = frames_of(lambda _, i: pixels[i], count=8, kind="flat", exposure_s=0.01, photons=100.0)
    found = fingerprint(flats, [0, 2, 4, 6])
    (label,) = [label for label in found.labels if label.startswith("memory/share of a step")]
    assert found[label] == 0


@pytest.mark.parametrize("codes", [1, 2, 5])
def test_statistics_depend_on_the_plan_alone(codes):
    """Not on the pixels: a camera whose bias frames hold hardly a code besides 0 has them all."""
    a = fingerprint(frames_of(white))
    b = fingerprint(frames_of(lambda rng, i: rng.integers(0, codes, (ROWS, COLUMNS))))
    assert a.statistics == b.statistics
    assert np.isfinite(b.values).all()
    assert len(set(a.labels)) == len(a.labels)


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_every_view_has_a_picture_or_says_what_it_needs(view):
    data = FrameData(frames_of(white))
    picture = view.picture(data)
    if picture is not None:
        assert picture.maps or (picture.curves and picture.x_label and picture.y_label)
        for curve in picture.curves:
            assert len(curve.x) == len(curve.y) > 0


@pytest.mark.parametrize("period", [2.5, 9, 17.3])
def test_a_banding_tells_its_frequency(period):
    rows, phases = np.arange(80), np.random.default_rng(0).random((10, 1))
    waves = np.sin(2 * np.pi * (rows / period + phases))
    noise = 0.2 * np.random.default_rng(1).normal(size=waves.shape)
    assert peak_frequency(power(waves + noise)) == pytest.approx(1 / period, abs=0.25 / 80)
    assert peak_frequency(np.zeros(40)) == 0  # frames without any noise


def test_edges_of_two_heights_tell_a_linear_spread_from_one_that_grows():
    """A linear exchange between neighbours leaves nothing in it, one of squares all of itself."""
    clean = np.full((48, 64), 10.0, np.float32)
    clean[4:20, 6:20], clean[26:44, 30:50], clean[8:20, 40:56] = 300.0, 800.0, 1000.0
    target = _target(_Key(clean))
    _, weighted, norm = target.shapes["curvature growing with the level"]
    around = ((0, 1), (0, -1), (1, 0), (-1, 0))

    def exchange(image: np.ndarray) -> np.ndarray:
        return sum(_shift(image, *step) for step in around) - 4 * image

    assert np.vdot(weighted, exchange(clean)) / norm == pytest.approx(0, abs=1e-3)
    assert np.vdot(weighted, exchange(clean**2 / 1000)) / norm == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("axis", ["row", "column"])
def test_what_spills_from_a_round_spot_along_one_axis_is_not_seen_along_the_other(axis):
    y, x = np.mgrid[0:ROWS, 0:COLUMNS]
    spot = np.where(np.hypot(y - 30, x - 40) <= 6, 10_000.0, 10.0).astype(np.float32)
    spilled = spot + 50 * sum(
        (_shift(spot > 1000, *step) & (spot < 1000)).astype(np.float32)
        for d in (1, 2)
        for step in (((0, d), (0, -d)) if axis == "row" else ((d, 0), (-d, 0)))
    )
    rng = np.random.default_rng(0)
    records = [FrameRecord(i, f"{i}.npy", "bias", 0.0, 20.0) for i in range(6)]
    records += [FrameRecord(i, f"{i}.npy", "scene", 0.01, 20.0, clean="spot.npy") for i in range(6, 12)]
    frames = [100 + rng.normal(0, 0.1, spot.shape) + (spilled if i > 5 else 0) for i in range(12)]
    kept = FrameSet.from_arrays(records, [f.astype(np.float32) for f in frames], {"spot.npy": spot})
    f = fingerprint(kept)
    seen = {
        way: f[f"scene/1 to 2 px from bright spots along the {way}/scene spot"] for way in ("row", "column")
    }
    assert seen.pop(axis) > 20  # one or two of its pixels in two rows lie next to the spot
    assert next(iter(seen.values())) == pytest.approx(0, abs=0.5)


def test_a_spot_on_one_level_has_no_offset_and_no_square():
    """The line through the scene takes the level; what rounding leaves varied by 1e-6 DN and stood far out by that."""
    y, x = np.mgrid[0:ROWS, 0:COLUMNS]
    spot = np.where(np.hypot(y - 30, x - 40) <= 5, 10_000.0, 10.0).astype(np.float32)
    rng = np.random.default_rng(0)
    records = [FrameRecord(i, f"{i}.npy", "bias", 0.0, 20.0) for i in range(4)]
    records += [FrameRecord(i, f"{i}.npy", "scene", 0.01, 20.0, clean="spot.npy") for i in range(4, 8)]
    for background in (spot, spot + (x > 60)):
        frames = [rng.normal(100, 3, spot.shape) + (background if i > 3 else 0) for i in range(8)]
        clean = {"spot.npy": background.astype(np.float32)}
        f = fingerprint(FrameSet.from_arrays(records, [a.astype(np.float32) for a in frames], clean))
        told = [f[f"scene/{name}/scene spot"] for name in ("offset", "square")]
        assert [value == 0 for value in told] == 2 * [background is spot]


def test_a_dead_pixel_does_not_hide_a_step_between_rows():
    """Odd rows 2 DN higher, 1 in 300 pixels 5000 DN off; tolerance of five standard errors of the rest."""
    rng = np.random.default_rng(3)
    dead = rng.random((ROWS, COLUMNS)) < 1 / 300
    step = 2.0 * (np.arange(ROWS) % 2)[:, None]
    f = fingerprint(frames_of(lambda rng, i: white(rng, i) + step + 5000 * dead))
    error = 10 / np.sqrt(12 * ROWS * COLUMNS) * 2
    assert f["seams/odd against even rows/bias"] == pytest.approx(2.0, abs=5 * error)
    assert np.exp(f["fixed_pattern/pixels/bias"]) > 5000**2 / 1000  # where it is not taken away
    assert f["defects/above 50 scales/bias"] == pytest.approx(np.sqrt(dead.sum()))


@pytest.mark.parametrize("slow", [0.0, 3.0])
def test_white_noise_has_no_lone_pixels(slow):
    """Beyond 8 robust deviations comes one normal number in 10^14; a slope of the field is no pixel's own."""
    image = np.random.default_rng(4).normal(0, 1, (ROWS, COLUMNS)) + slow * np.arange(COLUMNS)
    assert np.array_equal(without_lone_pixels(image.astype(np.float32)), image.astype(np.float32))


def plan_of(*conditions) -> FrameSet:
    """Three frames under each condition: kind, exposure, temperature, photons, clean."""
    rng = np.random.default_rng(3)
    records = [
        FrameRecord(3 * k + i, f"{k}-{i}.npy", kind, exposure, temperature, 0.0, photons, clean)
        for k, (kind, exposure, temperature, photons, clean) in enumerate(conditions)
        for i in range(3)
    ]
    cleans = {clean: np.full((ROWS, COLUMNS), 50.0, np.float32) for *_, clean in conditions if clean}
    return FrameSet.from_arrays(records, [white(rng, 0).astype(np.float32) for _ in records], cleans)


@pytest.mark.parametrize(
    "conditions",
    [
        [("dark", 2.0, 20.0, None, None)],
        [("dark", 0.2, 20.0, None, None), ("dark", 2.0, 20.0, None, None)],
        [("bias", 0.0, 20.0, None, None), ("bias", 0.0, 30.0, None, None)],
        [("flat", 0.01, 20.0, 500.0, None), ("flat", 1.0, 20.0, 500.0, None)],
        [("dark", 2.0, 20.0000001, None, None), ("dark", 2.0, 20.0000002, None, None)],
        [("scene", 0.01, 20.0, None, "a/spot.npy"), ("scene", 0.01, 20.0, None, "b/spot.npy")],
    ],
    ids=["one dark", "darks", "warm bias", "two exposures", "nearly alike", "two spots"],
)
def test_no_two_statistics_have_one_name(conditions):
    """Uses of the frames find each other's statistics by name; where there are no bias frames darks stand for them."""
    frames = plan_of(*conditions)
    whole = fingerprint(frames)
    assert len(set(whole.labels)) == len(whole.labels)
    part = fingerprint(frames, [i for i in range(len(frames)) if i % 3 < 2])
    assert set(part.labels) <= set(whole.labels)


@pytest.mark.parametrize("alone", [False, True])
def test_each_of_two_star_fields_has_its_own_target(alone):
    """Fields that differ in the place of one star: the frame's top is the star's level, wherever another set has its own."""
    fields = {}
    for name, (row, column) in {"first.npy": (13, 20), "second.npy": (34, 50)}.items():
        fields[name] = np.full((ROWS, COLUMNS), 20.0, np.float32)
        fields[name][row : row + 2, column : column + 2] = 5000.0
    names = ["second.npy"] if alone else ["first.npy", "second.npy"]
    records = [FrameRecord(i, f"{i}.npy", "scene", 0.01, 20.0, clean=name) for i, name in enumerate(names)]
    frames = FrameSet.from_arrays(records, [0.5 * fields[name] + 100 for name in names], fields)
    f = fingerprint(frames)
    assert f["scene/top of bright spots/scene second"] == pytest.approx(2600)


def test_what_a_frame_keeps_is_measured_without_dark_frames():
    """Bias frames alone, one of them after a bright scene: a share of 0.1 of it stays.

    The frame is compared with the mean of its group of four, which holds a quarter of it. Five standard errors are 0.003.
    """
    rng = np.random.default_rng(3)
    scene = np.full((ROWS, COLUMNS), 100.0)
    scene[20:40, 30:50] = 1100
    frames = [white(rng, i) for i in range(5)]
    frames[2] = scene
    frames[3] = frames[3] + 0.1 * (scene - 100)
    kinds = ["bias", "bias", "scene", "bias", "bias"]
    records = [FrameRecord(i, f"{i}.npy", kind, 0.0, 20.0) for i, kind in enumerate(kinds)]
    records[2] = FrameRecord(2, "2.npy", "scene", 0.01, 20.0, clean="scene.npy")
    clean = {"scene.npy": scene.astype(np.float32)}
    found = fingerprint(FrameSet.from_arrays(records, [f.astype(np.float32) for f in frames], clean))
    assert found["memory/slope on a bright scene before/bias"] == pytest.approx(0.1 * 3 / 4, abs=0.003)


@pytest.mark.parametrize("name", ["columns, band 2", "columns, band 2, flat 3000 ph 20 C"])
def test_a_band_is_marked_whatever_follows_its_name(name):
    ((low, high),) = spectrum_marks(name, np.array([0, 4, 10]), 100, 0.1)
    assert (low, high) == pytest.approx((0.005 * 4.5, 0.005 * 10.5))
