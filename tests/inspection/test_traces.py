"""What was done to frames before, defects, codes and what frames cannot tell; each by independent NumPy, SciPy or Pillow code.

The family-wise false-alarm rate is below 1 % for a set, so a list of findings is compared as a whole. Fixed seeds.
"""

import io

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

import visaug
from tests.inspection.cameras import COLUMNS, ROWS, SHAPE, frames, offsets
from visaug.frames import FrameRecord
from visaug.inspection.processing import shares_of_neighbours


def whats(values):
    return [f.what for f in visaug.inspect(values).findings]


def through_jpeg(frame, quality):
    file = io.BytesIO()
    Image.fromarray(frame).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))


@pytest.mark.parametrize(("quality", "corner"), [(90, (0, 0)), (75, (3, 5))])
def test_jpeg_is_told_from_the_pixels_alone(quality, corner):
    """At the grid of the file and of a cropped one; the grid's place is that of the crop."""
    rng = np.random.default_rng(1)
    packed = np.stack([through_jpeg(f, quality) for f in frames(rng, [], 8, 8, black=60)])
    result = visaug.inspect(packed[:, corner[0] :, corner[1] :])
    assert [f.what for f in result.findings] == ["compression"]
    grid = result.findings[0].details
    assert (grid["grid_row"], grid["grid_column"]) == tuple(-k % 8 for k in corner)
    assert any("JPEG hides" in line for line in result.ambiguous)


@pytest.mark.parametrize("shape", [(33, 47), (40, 40)])
def test_few_small_frames_are_no_jpeg(shape):
    """Of so few blocks a mean cosine is large by chance. The family of tests is wrong once in 4000 sets."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        values = rng.normal(100, 3 + seed, (3 + seed % 2, *shape)).round().astype(np.uint16)
        assert whats(values) == []


def test_the_last_code_of_a_few_pixels_is_no_clipping():
    """Three pixels at the highest code that comes, and none beside it. Clean sets; a family is wrong once in 100."""
    rng = np.random.default_rng(142)
    for _ in range(6):
        values = rng.normal(290, 6.6, (5, 20, 21)).round()
        values = np.minimum(values, 309).astype(np.uint16)
        values[values >= 306] = 305
        values[0, 3, 4], values[2, 9, 11], values[4, 17, 2] = 312, 312, 312
        assert "clipping" not in whats(values)
    values = rng.normal(290, 6.6, (5, 40, 42)).round().astype(np.uint16)
    assert whats(np.minimum(values, 295)) == ["clipping"]


@pytest.mark.parametrize("shape", [(20, 68), (68, 20)])
def test_noise_of_few_rows_is_not_taken_for_shared(shape):
    """What neighbours share in white noise, in standard errors of few rows or columns, over 400 sets."""
    z = []
    for seed in range(400):
        noise = np.random.default_rng(seed).normal(0, 3, (3, *shape))
        noise -= noise.mean(0)
        noise -= noise.mean(1, keepdims=True) + noise.mean(2, keepdims=True)
        noise += noise.mean((1, 2), keepdims=True)
        z += list(shares_of_neighbours(noise, 3)[1].values())
    # 800 numbers: their standard deviation is known to 2.5 %
    assert np.std(z) == pytest.approx(1, abs=0.09)


def test_filters_and_demosaicing_are_told_apart():
    rng = np.random.default_rng(2)
    raw = 200 + rng.normal(0, 10, (8, *SHAPE))
    median = np.stack([ndimage.median_filter(np.rint(f), 3) for f in raw])
    smooth = np.stack([ndimage.gaussian_filter(f, 0.7) for f in raw])
    green = (ROWS + COLUMNS) % 2 == 0
    weights = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
    bilinear = np.stack([ndimage.convolve(f * green, weights, mode="mirror") for f in raw])
    assert whats(median) == ["denoising"]
    assert whats(np.rint(smooth)) == ["correlated_noise"]
    assert whats(np.rint(bilinear)) == ["demosaicing"]


def test_corrected_pixels_are_found_where_they_are():
    rng = np.random.default_rng(3)
    values = frames(rng, [], 8, 12).astype(float)
    true = {(10, 20), (50, 60), (90, 140), (100, 30)}
    for r, c in true:
        values[:, r, c] = np.rint((values[:, r, c - 1] + values[:, r, c + 1]) / 2)
    result = visaug.inspect(values)
    assert [f.what for f in result.findings] == ["defect_correction"]
    assert {(r, c) for r, c, _, _ in result.places} == true


def test_hot_dead_and_unstable_pixels_have_their_places(tmp_path):
    """Jumps of 30 DN in noise of 3 DN: both levels occur twice or more in 12 frames with probability 0.994."""
    rng = np.random.default_rng(4)
    values = frames(rng, [], 12, 12, black=100).astype(float)
    values[:, 50, 60] += 800
    values[:, 70, 80] = 0
    values[:, 20, 30] += 30 * np.array([0, 1] * 6)
    result = visaug.inspect(values)
    assert {(r, c, kind) for r, c, kind, _ in result.places} == {
        (50, 60, "hot"),
        (70, 80, "dead"),
        (20, 30, "unstable"),
    }
    assert len(result.findings) == 3
    rows = result.save_defects(tmp_path / "defects.csv").read_text().splitlines()
    assert rows[0] == "row,column,type,height_dn"
    assert len(rows) == 4


def test_defective_lines_are_no_pattern_of_all_lines():
    rng = np.random.default_rng(5)
    values = frames(rng, [], 8, 12, black=100)
    values[:, :, 70] = 900  # stuck
    values[:, 33, :] += 15
    result = visaug.inspect(values)
    assert {(f.what, f.axis) for f in result.findings} == {
        ("line_defects", "row"),
        ("line_defects", "column"),
    }
    assert {(r, c) for r, c, _, _ in result.places} == {(33, -1), (-1, 70)}


def test_steps_elsewhere_than_in_the_middle():
    """Four parts of 40 columns at 0, 2, -1 and 1 DN: three steps, within 5 % of 2, -3 and 2 DN (6 standard errors)."""
    rng = np.random.default_rng(6)
    levels = np.array([0, 2, -1, 1])[COLUMNS // 40]
    found = visaug.inspect(frames(rng, [levels], 8, 12)).findings
    steps = {f.details["at_column"]: f.details["difference_dn"] for f in found}
    assert steps == {
        40: pytest.approx(2, rel=0.05),
        80: pytest.approx(-3, rel=0.05),
        120: pytest.approx(2, rel=0.05),
    }
    assert {f.what for f in found} == {"halves", "step"}


def test_codes():
    """Lost bits, codes at the top of 16 bits, gaps of a digital gain, and clipping at 0."""
    rng = np.random.default_rng(7)
    values = frames(rng, [], 8, 12, sigma=6, black=200)
    lost = visaug.inspect(values // 4 * 4)
    assert [(f.what, f.details["lost_bits"]) for f in lost.findings] == [("code_gaps", 2)]
    moved = visaug.inspect(values * 16)
    assert (moved.findings, moved.bits, moved.shift) == ((), 12, 4)
    [gaps] = visaug.inspect(values + values // 10).findings
    assert (gaps.what, gaps.period) == ("code_gaps", 11)
    [clipped] = visaug.inspect(frames(rng, [], 8, 12, black=2)).findings
    assert clipped.what == "clipping"
    assert clipped.share == pytest.approx(0.309, abs=0.01)  # of a normal law, (-inf, 0.5] about 2 with 3 DN


@pytest.mark.parametrize(("black", "light", "kind"), [(200, 0, "dark"), (200, 1800, "flat")])
@pytest.mark.parametrize(
    "stored",
    [lambda v: v, lambda v: v.astype(np.float32), lambda v: v * 16, lambda v: (v * 16).astype(np.float32)],
    ids=["integers", "floats", "at the top", "floats at the top"],
)
def test_kind_and_sizes_are_those_of_the_converter_in_any_file(stored, black, light, kind):
    """Row offsets of 2 DN and noise of 6 DN in 12 bits: stored in whatever way they give the same figures. A pattern that is
    not there has a probability below 1 %.
    """
    rng = np.random.default_rng(86)
    values = frames(rng, [offsets(rng, 8, 2.0, "row", True)], 8, 12, 6.0, black, light)
    result, expected = visaug.inspect(stored(values)), visaug.inspect(values)
    assert (result.kinds, result.measured) == ({kind: 8}, expected.measured)
    assert result.measured[0].level_dn == pytest.approx(black + light, abs=1)
    assert [f.what for f in result.findings] == ["row_offset"]
    assert result.findings[0].amplitude_dn == pytest.approx(2.0, rel=0.2)
    assert result.findings[0].amplitude_dn == expected.findings[0].amplitude_dn


def test_copies_of_one_exposure_are_said():
    rng = np.random.default_rng(8)
    one = frames(rng, [2.5 * np.sin(2 * np.pi * ROWS / 13)], 1, 12)
    result = visaug.inspect(np.concatenate([one, one]))
    assert [(f.what, f.kind) for f in result.findings] == [("row_banding", None)]
    assert "copies" in result.answer
    assert any("cannot tell fixed from new" in line for line in result.ambiguous)


def test_scenes_tell_only_what_changes():
    """A still scene with banding; and scenes that change, of which nothing is claimed."""
    rng = np.random.default_rng(9)

    def scene():
        return 500 + 1800 * ndimage.gaussian_filter(rng.normal(size=SHAPE), 6)

    banding = 3 * np.sin(2 * np.pi * (ROWS / 11 + rng.uniform(0, 1, (8, 1, 1))))
    still = visaug.inspect(frames(rng, [scene(), banding], 8, 12))
    assert still.kinds == {"scene": 8}
    assert [(f.what, f.kind) for f in still.findings] == [("row_banding", "per_frame")]
    moving = visaug.inspect(frames(rng, [np.stack([scene() for _ in range(5)])], 5, 12))
    assert (moving.kinds, moving.findings) == ({"image": 5}, ())
    assert moving.ambiguous


def bodies(rng):
    """A body of two faces before a black sky."""
    image = np.zeros(SHAPE)
    row, column = rng.integers(10, 50), rng.integers(10, 80)
    image[row : row + 50, column : column + 60] = rng.uniform(0.2, 0.8)
    image[row : row + 25, column : column + 30] *= 0.6
    return ndimage.gaussian_filter(image, 0.8)


def smooth(rng, reach):
    image = ndimage.gaussian_filter(rng.normal(0, 1, SHAPE), reach)
    return 0.05 + 0.7 * (image - image.min()) / np.ptp(image)


def patches(rng):
    image = np.full(SHAPE, rng.uniform(0.08, 0.5))
    for _ in range(12):
        row, column = rng.integers(0, 100), rng.integers(0, 140)
        size = rng.integers(20, 60, 2)
        image[row : row + size[0], column : column + size[1]] = rng.uniform(0.05, 0.8)
    return ndimage.gaussian_filter(image, 0.8)


SCENES = {
    "bodies": bodies,
    "smooth": lambda rng: smooth(rng, 12),
    "slopes": lambda rng: smooth(rng, 30),
    "patches": patches,
}


def photographed(scenes, rng, exposure=1.0):
    """Shot noise of 4000 electrons of full scale, read noise of 20, codes of 8 bits above 10 DN."""
    electrons = [rng.poisson(4000 * exposure * x) + rng.normal(0, 20, SHAPE) for x in scenes]
    return np.clip(np.rint(np.stack(electrons) * 245 / 4000 + 10), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_pictures_are_scenes(name, seed):
    """Alike or changing: their content is no pattern of the camera. Nothing but codes is found (one false alarm in 100 sets)."""
    rng = np.random.default_rng([seed, 6])
    one = SCENES[name](rng)
    still = visaug.inspect(photographed([one] * 10, rng))
    assert still.kinds == {"scene": 10}
    changing = visaug.inspect(photographed([SCENES[name](rng) for _ in range(10)], rng))
    assert set(changing.kinds) == {"image"}
    for result in (still, changing):
        assert {f.what for f in result.findings} <= {"clipping"}, result.answer


@pytest.mark.parametrize("exposure", [0.1, 0.3])
def test_dim_pictures_of_bodies_are_scenes(exposure):
    rng = np.random.default_rng(16)
    kinds = visaug.inspect(photographed([bodies(rng) for _ in range(10)], rng, exposure)).kinds
    assert kinds == {"image": 10}


@pytest.mark.parametrize("change", ["brighter", "moved"])
def test_a_scene_that_changes_a_little_is_not_one_scene(change):
    """By 3 % of brightness or by half a pixel: what differs is the scene's, and looks like new offsets of rows and columns."""
    rng = np.random.default_rng(17)
    one = bodies(rng)
    shots = [one * (1 + 0.03 * (k % 2)) for k in range(8)]
    if change == "moved":
        shots = [ndimage.shift(one, 0.5 * (k % 2), order=1) for k in range(8)]
    result = visaug.inspect(photographed(shots, rng))
    assert (result.kinds, [f.what for f in result.findings]) == ({"image": 8}, [])


def sensor(name, rng):
    """Patterns of dark frames (DN) that are no scene."""
    field = np.zeros(SHAPE)
    match name:
        case "glow of a corner":
            return field + 25 * np.exp(-np.hypot(ROWS, COLUMNS) / 20)
        case "glow of the middle":
            return field + 20 * np.exp(-((ROWS - 60) ** 2 + (COLUMNS - 80) ** 2) / 2 / 30**2)
        case "hot pixels":
            return np.where(rng.random(SHAPE) < 0.01, rng.exponential(100, SHAPE), 0)
        case "banding, halves and lines":
            lines = 4 * np.sin(ROWS / 3) + 6 * (COLUMNS > 80) + rng.normal(0, 3, (1, SHAPE[1]))
            return lines + rng.normal(0, 5, SHAPE)
        case _:
            return ndimage.gaussian_filter(
                rng.normal(0, 12, (8, *SHAPE)), (0, 1, 1)
            )  # noise that neighbours share


@pytest.mark.parametrize(
    "name",
    ["glow of a corner", "glow of the middle", "hot pixels", "banding, halves and lines", "coarse noise"],
)
def test_dark_frames_stay_dark(name):
    """All frames of 8 sets of 8 keep their kind. Fixed seeds; the test for edges has a false-alarm rate of 1e-4 per frame."""
    for seed in range(8):
        rng = np.random.default_rng([seed, 18])
        assert visaug.inspect(frames(rng, [sensor(name, rng)], 8, 8)).kinds == {"dark": 8}


def test_a_glow_of_frames_of_unstated_kind_is_doubted():
    rng = np.random.default_rng(20)
    values = frames(rng, [sensor("glow of a corner", rng)], 4, 8)
    unstated = visaug.inspect(values)
    assert any("smooth scene" in line for line in unstated.ambiguous)
    records = [FrameRecord(k, f"{k}", "dark") for k in range(4)]
    stated = visaug.inspect(visaug.FrameSet.from_arrays(records, values))
    assert "glow" in [f.what for f in stated.findings]
    assert not any("smooth scene" in line for line in stated.ambiguous)


def test_flats_with_dust_and_vignetting_stay_flat():
    rng = np.random.default_rng(19)
    light = 1 - 0.5 * ((ROWS - 60) ** 2 + (COLUMNS - 80) ** 2) / 100**2
    for _ in range(30):
        row, column = rng.integers(0, SHAPE[0]), rng.integers(0, SHAPE[1])
        light = light * (1 - 0.08 * (np.hypot(ROWS - row, COLUMNS - column) < 6))
    assert visaug.inspect(frames(rng, [1500 * light], 8, 12, sigma=20)).kinds == {"flat": 8}


@pytest.mark.parametrize("value", [0, 7, 255])
def test_frames_of_one_value_have_no_pattern(value):
    """Only that they lie at an end of the range is said; tiny frames and a slope without noise raise nothing."""
    result = visaug.inspect(np.full((3, 64, 64), value, np.uint8))
    assert [f.what for f in result.findings] == ([] if value == 7 else ["clipping"])
    visaug.inspect(np.arange(3 * 17 * 19, dtype=np.uint16).reshape(3, 17, 19))


def test_what_cannot_be_inspected_is_one_line():
    with pytest.raises(visaug.InputError, match=r"array \(n, H, W\)"):
        visaug.inspect(np.zeros((100, 120)))
    with pytest.raises(visaug.InputError, match="16 x 16"):
        visaug.inspect(np.zeros((4, 8, 8), np.uint8))
