import subprocess
import sys

import numpy as np
import pytest
from astropy.io import fits

from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet, read_table, write_table
from visaug.frames.plan import default_plan, describe_plan, plan_groups

RNG = np.random.default_rng(11)


def small_set(n=6, shape=(5, 7), **options):
    frames = RNG.integers(0, 1000, (n, *shape), dtype=np.uint16)
    records = [FrameRecord(10 + i, f"f{i}.npy", "dark", 0.1 * (1 + i // 2), 20.0) for i in range(n)]
    return FrameSet.from_arrays(records, frames, **options), frames


def test_records_stand_in_order_of_sequence_with_their_own_frames():
    frames = np.arange(3, dtype=np.uint16)[:, None, None] * np.ones((1, 2, 2), np.uint16)
    records = [FrameRecord(s, f"{s}.npy", "dark", 1.0) for s in (5, 1, 3)]
    fs = FrameSet.from_arrays(records, frames)
    assert [r.sequence for r in fs.records] == [1, 3, 5]
    assert [fs.read(i)[0, 0] for i in range(3)] == [1, 2, 0]


def test_subset_of_a_subset_reads_the_right_frames():
    fs, frames = small_set()
    sub = fs.subset([5, 1, 3]).subset([2, 0])
    assert [r.sequence for r in sub.records] == [11, 15]
    np.testing.assert_array_equal(sub.read_many([0, 1]), frames[[1, 5]])
    assert [g.indices for g in sub.groups()] == [(0,), (1,)]


@pytest.mark.parametrize("keep_names", [False, True])
def test_saved_set_is_the_same_set(tmp_path, keep_names):
    shapes = [(4, 6), (3, 3), (4, 6)]
    pixels = [RNG.integers(0, 4096, s, dtype=np.uint16) for s in shapes]
    names = ["sub/a.tif", "b.npz#frames[2,1]", "c.fits"]
    records = [
        FrameRecord(0, names[0], "scene", 0.1, 21.5, 3.0, clean="target.tif", window=(0, 4, 0, 6)),
        FrameRecord(3, names[1], "flat", 0.2, None, 0.0, 120.25, window=(4, 7, 0, 3)),
        FrameRecord(9, names[2], "dark", 0.3, window=(2, 6, 2, 8)),
    ]
    clean = RNG.random((4, 6), dtype=np.float32)
    FrameSet.from_arrays(records, pixels, {"target.tif": clean}).save(tmp_path / "out", keep_names=keep_names)
    again = FrameSet.load(tmp_path / "out")
    assert [r.file for r in again.records] == (
        names if keep_names else ["frames.npz#frames[0]", "frames.npz#frames_1[0]", "frames.npz#frames[1]"]
    )
    for old, new in zip(records, again.records):
        for field in ("sequence", "kind", "exposure_s", "temperature_c", "gain_db", "photons", "window"):
            assert getattr(old, field) == getattr(new, field)
    for i in range(3):
        np.testing.assert_array_equal(again.read(i), pixels[i])
    np.testing.assert_array_equal(again.clean(0), clean)
    assert again.bit_depth == 16


def test_bit_depth_of_the_records_is_the_sets(tmp_path):
    frames = np.full((2, 3, 4), 4000, np.uint16)
    records = [FrameRecord(i, f"{i}.tif", "dark", 1.0, bit_depth=12) for i in range(2)]
    FrameSet.from_arrays(records, frames).save(tmp_path / "out", keep_names=True)
    assert FrameSet.load(tmp_path / "out").bit_depth == 12
    # What is said on the command line wins, and is what a copy of the set holds.
    again = FrameSet.load(tmp_path / "out", bit_depth=14)
    assert again.bit_depth == 14
    again.save(tmp_path / "copy")
    assert FrameSet.load(tmp_path / "copy").bit_depth == 14
    with pytest.raises(InputError, match="14 and 12 bits are mixed in one set"):
        FrameSet.from_arrays([records[0], FrameRecord(1, "b", "dark", bit_depth=14)], frames)


def test_saving_is_all_or_nothing(tmp_path):
    fs, _ = small_set()
    bad = FrameSet.from_arrays(fs.records, [*[np.ones((2, 2))] * 5, np.full((2, 2), np.nan)])
    with pytest.raises(InputError, match="NaN"):
        bad.save(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
    fs.save(tmp_path / "out")
    with pytest.raises(InputError, match="not empty"):
        fs.save(tmp_path / "out")
    fs.subset([0, 1]).save(tmp_path / "out", overwrite=True)
    assert len(FrameSet.load(tmp_path / "out")) == 2
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("file", ["/a.npy", "../a.npy", "frames.csv", "a.npz", "a.jpg"])
def test_names_that_cannot_be_written_are_refused(tmp_path, file):
    fs = FrameSet.from_arrays([FrameRecord(0, file, "dark", 1.0)], np.ones((1, 2, 2), np.uint16))
    with pytest.raises(InputError):
        fs.save(tmp_path / "out", keep_names=True)


@pytest.mark.parametrize(
    ("pixels", "bit_depth", "message"),
    [
        ([[1.0, np.nan]], None, "1 of 2 pixels are NaN"),
        ([[1.0, np.inf]], None, "NaN or infinite"),
        ([[-1.0, 3.0]], None, "smallest value is -1"),
        ([[1, 4096]], 12, "largest value is 4096; expected at most 4095 for 12 bits"),
    ],
)
def test_bad_pixels_are_refused_on_reading(tmp_path, pixels, bit_depth, message):
    np.save(tmp_path / "a.npy", np.array(pixels))
    write_table(tmp_path / "frames.csv", [FrameRecord(0, "a.npy", "dark", 1.0)])
    with pytest.raises(InputError, match=message):
        FrameSet.load(tmp_path, bit_depth=bit_depth).read(0)
    with pytest.raises(InputError, match=message):
        FrameSet.from_arrays(
            [FrameRecord(0, "a", "dark", 1.0)], np.array([pixels]), bit_depth=bit_depth
        ).read(0)


def test_mixed_sizes_need_a_region(tmp_path):
    np.save(tmp_path / "a.npy", np.ones((4, 4), np.uint16))
    np.save(tmp_path / "b.npy", np.ones((3, 4), np.uint16))
    records = [FrameRecord(0, "a.npy", "dark", 1.0), FrameRecord(1, "b.npy", "dark", 1.0)]
    write_table(tmp_path / "frames.csv", records)
    fs = FrameSet.load(tmp_path)
    fs.read(0)
    with pytest.raises(InputError, match=r"b.npy: frames differ in size: this one is 3 x 4"):
        fs.read(1)
    with pytest.raises(InputError, match="expected 8 x 8 as the sensor"):
        FrameSet.load(tmp_path, resolution=(8, 8)).read(0)
    records[1] = FrameRecord(1, "b.npy", "dark", 1.0, window=(0, 3, 0, 4))
    write_table(tmp_path / "frames.csv", records)
    fs = FrameSet.load(tmp_path)
    assert fs.read(0).shape == (4, 4)
    assert fs.read(1).shape == (3, 4)
    with pytest.raises(InputError, match=r"expected 4 x 4 as a.npy"):
        fs.read_many([0, 1])
    records[1] = FrameRecord(1, "b.npy", "dark", 1.0, window=(0, 2, 0, 4))
    write_table(tmp_path / "frames.csv", records)
    with pytest.raises(InputError, match="as stated by its region"):
        FrameSet.load(tmp_path).read(1)


def test_clean_targets_must_fit_their_frame(tmp_path):
    np.save(tmp_path / "a.npy", np.ones((4, 4), np.uint16))
    np.save(tmp_path / "clean.npy", np.ones((4, 5)))
    write_table(tmp_path / "frames.csv", [FrameRecord(0, "a.npy", "scene", 1.0, clean="clean.npy")])
    with pytest.raises(InputError, match=r"clean.npy: is 4 x 5; expected the size of its frame, 4 x 4"):
        FrameSet.load(tmp_path, resolution=(4, 4)).clean(0)
    (tmp_path / "a.npy").unlink()  # a plan names frames that are not there yet
    assert FrameSet.load(tmp_path).clean(0).shape == (4, 5)
    fs, _ = small_set()
    with pytest.raises(InputError, match="has no noiseless target"):
        fs.clean(0)


def test_descriptor_with_backslashes_exposures_and_photons(tmp_path):
    (tmp_path / "images").mkdir()
    for name in ("b0", "b1", "d0"):
        np.save(tmp_path / "images" / f"{name}.npy", np.full((4, 6), 100, np.uint16))
    text = "# header\r\nv 3.0\r\nn 12 6 4\r\nb 5160000.0 961.0\r\ni images\\b0.npy\r\ni images\\b1.npy\r\n"
    (tmp_path / "EMVA1288_Data.txt").write_text(text + "d 5160000.0\r\ni images\\d0.npy\r\n")
    for path in (tmp_path, tmp_path / "EMVA1288_Data.txt"):
        fs = FrameSet.load(path)
        assert [(r.kind, r.exposure_s, r.photons) for r in fs.records] == [
            ("flat", 0.00516, 961.0),
            ("flat", 0.00516, 961.0),
            ("dark", 0.00516, None),
        ]
        assert fs.bit_depth == 12
        assert fs.read(2).shape == (4, 6)
    # frames.csv wins over a descriptor beside it.
    write_table(tmp_path / "frames.csv", [FrameRecord(0, "images/b0.npy", "scene", 1.0)])
    assert [r.kind for r in FrameSet.load(tmp_path).records] == ["scene"]


@pytest.mark.parametrize(
    "text", ["", "n 12 6 4\n", "n 12 6\n", "n 12 6 4\ni a.npy\n", "n 12 6 4\nb 1\ni a\n", "x y\n"]
)
def test_bad_descriptor_is_named(tmp_path, text):
    (tmp_path / "EMVA1288_Data.txt").write_text(text)
    with pytest.raises(InputError, match=r"EMVA1288_Data.txt"):
        FrameSet.load(tmp_path)


def test_fits_folder_by_its_headers(tmp_path):
    headers = [
        ("c.fits", {"IMAGETYP": "Bias Frame", "CCD-TEMP": -9.5, "DATE-OBS": "2024-01-01T00:00:02"}),
        ("b.fits", {"IMAGETYP": "DARK", "EXPTIME": 30.0, "CCD-TEMP": -10, "DATE-OBS": "2024-01-01T00:00:01"}),
        (
            "a.fit",
            {"IMAGETYP": "Flat Field", "EXPTIME": 2.5, "GAIN_DB": 6.0, "DATE-OBS": "2024-01-01T00:00:03"},
        ),
        ("d.fits", {"IMAGETYP": "Light Frame", "EXPOSURE": 1.0, "DATE-OBS": "2024-01-01T00:00:04"}),
    ]
    for name, header in headers:
        unit = fits.PrimaryHDU(np.full((3, 4), 50000, np.uint16))
        unit.header.update(header)
        unit.writeto(tmp_path / name)
    fs = FrameSet.load(tmp_path)
    assert [(r.file, r.kind, r.exposure_s, r.temperature_c, r.gain_db) for r in fs.records] == [
        ("b.fits", "dark", 30.0, -10.0, 0.0),
        ("c.fits", "bias", 0.0, -9.5, 0.0),
        ("a.fit", "flat", 2.5, None, 6.0),
        ("d.fits", "scene", 1.0, None, 0.0),
    ]
    assert fs.read(0).max() == 50000
    assert fs.bit_depth == 16


@pytest.mark.parametrize("header", [{}, {"IMAGETYP": "guess"}, {"IMAGETYP": "dark"}])
def test_fits_without_what_is_needed_is_named(tmp_path, header):
    unit = fits.PrimaryHDU(np.ones((3, 4), np.uint16))
    unit.header.update(header)
    unit.writeto(tmp_path / "a.fits")
    with pytest.raises(InputError, match=r"a.fits"):
        FrameSet.load(tmp_path)


def test_nothing_to_read_is_named(tmp_path):
    for path in (tmp_path, tmp_path / "absent"):
        with pytest.raises(InputError, match=str(path)):
            FrameSet.load(path)
    (tmp_path / "notes.md").write_text("x")
    with pytest.raises(InputError, match="is not a frame set"):
        FrameSet.load(tmp_path / "notes.md")


def test_peak_memory_stays_within_a_tenth_of_the_set(tmp_path):
    """A set of 160 MiB is read in one pass by a program that may hold 16 MiB, packed and unpacked."""
    frames = np.zeros((160, 512, 1024), np.uint16)
    frames[:] = np.arange(160, dtype=np.uint16)[:, None, None]
    np.savez(tmp_path / "stored.npz", frames=frames)
    np.savez_compressed(tmp_path / "packed.npz", frames=frames)
    records = [
        FrameRecord(i, f"{f}.npz#frames[{i % 160}]", "dark", 1.0)
        for f, start in (("stored", 0), ("packed", 160))
        for i in range(start, start + 160)
    ]
    write_table(tmp_path / "frames.csv", records)
    code = (
        "import sys, tracemalloc; from visaug.frames import FrameSet; tracemalloc.start()\n"
        "fs = FrameSet.load(sys.argv[1]); total = sum(float(fs.read(i).mean()) for i in range(len(fs)))\n"
        "fs.check(); print(total, tracemalloc.get_traced_memory()[1])"
    )
    out = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True
    )
    total, peak = (float(v) for v in out.stdout.split())
    assert total == 2 * sum(range(160))
    assert peak < 16 * 2**20


def checked(frames, kinds, exposures=None, **options):
    exposures = exposures or [0.0 if k == "bias" else 0.1 for k in kinds]
    records = [FrameRecord(i, f"{i}.npy", k, e, 20.0) for i, (k, e) in enumerate(zip(kinds, exposures))]
    found = FrameSet.from_arrays(records, frames, **options).check()
    return {warning.split(":")[0]: warning for warning in found}


def bias_like(n, level=200.0):
    return np.rint(RNG.normal(level, 8, (n, 40, 50))).clip(0).astype(np.uint16)


def test_clean_set_has_no_warnings_even_with_a_drifting_black_level():
    drift = np.arange(16)[:, None, None] // 8
    assert checked(bias_like(16) + drift.astype(np.uint16), ["bias"] * 10 + ["dark"] * 6) == {}


def test_duplicate_and_constant_frames_are_named():
    frames = bias_like(6)
    frames[4] = frames[1]
    assert "frames 1, 4 " in checked(frames, ["bias"] * 6)["duplicate_frames"]
    frames[5] = 7
    assert checked(frames, ["bias"] * 6)["constant_frame"].endswith(
        "frames 5 have one value in all pixels (7 DN)"
    )
    frames[0] = 9
    assert checked(frames, ["bias"] * 6)["constant_frame"].endswith("(7 to 9 DN)")


def test_bias_that_saw_light_is_named():
    frames = bias_like(10)
    frames[3] += 15
    assert "bias frames 3 " in checked(frames, ["bias"] * 8 + ["dark"] * 2)["bias_saw_light"]
    frames = bias_like(8)
    frames[:4] += 60
    assert "bias frames 0, 1, 2, 3 " in checked(frames, ["bias"] * 4 + ["dark"] * 4)["bias_saw_light"]


def test_saturated_flats_and_clipped_darks_are_named():
    flats = bias_like(2, 4090.0).clip(0, 4095)
    assert "flats 0, 1 " in checked(flats, ["flat"] * 2, bit_depth=12)["saturated_flat"]
    assert "frames 0, 1 " in checked(bias_like(2, 5.0), ["bias"] * 2)["clipped_at_zero"]


def test_lone_frame_is_named():
    assert "frame 1 " in checked(bias_like(3), ["dark"] * 3, [0.1, 0.2, 0.1])["few_frames"]


def test_plan_covers_what_a_characterization_needs(tmp_path):
    plan = default_plan(saturation_photons=15000.0, resolution=(200, 256))
    write_table(tmp_path / "frames.csv", plan)
    assert read_table(tmp_path / "frames.csv") == plan
    assert sum(r.kind == "bias" and r.gain_db == 0 for r in plan) >= 16
    darks = {(r.exposure_s, r.temperature_c) for r in plan if r.kind == "dark"}
    assert len({e for e, _ in darks}) >= 3
    assert len({t for _, t in darks}) >= 3
    levels = {r.photons for r in plan if r.kind == "flat" and r.gain_db == 0}
    assert len(levels) >= 8
    assert max(levels) > 15000 > min(levels)
    for i, r in enumerate(plan):
        if r.kind == "scene":
            assert plan[i + 1].kind == "dark"
    assert len({r.gain_db for r in plan}) >= 3
    assert len({r.file for r in plan}) == len(plan)
    text = describe_plan()
    for group in plan_groups():
        assert group.name in text
        assert group.lost in text


@pytest.mark.parametrize(
    "options",
    [
        {"repeats": 1},
        {"repeats": 10**9},
        {"saturation_photons": -3.0},
        {"saturation_photons": 1e-300},
        {"temperatures_c": ()},
        {"levels": (0.5, 1e-300)},
        {"levels": (float("nan"),)},
    ],
)
def test_plan_refuses_what_tells_nothing(options):
    with pytest.raises(InputError):
        plan_groups(**options)


def test_real_descriptor_set(shared_data):
    fs = FrameSet.load(shared_data / "emva1288_ccd12")
    assert len(fs) == 300
    assert fs.bit_depth == 12
    assert {fs.read(i).shape for i in (0, 150, 299)} == {(480, 640)}
    stack = max((g for g in fs.groups() if g.kind == "flat"), key=lambda g: len(g.indices))
    assert (stack.exposure_s, len(stack.indices)) == (0.00516, 50)


def test_trial_sets_have_what_their_tables_say(shared_data):
    assert list((shared_data / "trial_sets").glob("set_*"))
    for folder in sorted((shared_data / "trial_sets").glob("set_*")):
        fs = FrameSet.load(folder)
        rows = (folder / "frames.csv").read_text().splitlines()[1:]
        assert (len(fs), fs.bit_depth, fs.shape(0)) == (len(rows), 16, (200, 256))
        scene = next(i for i, r in enumerate(fs.records) if r.kind == "scene")
        assert fs.clean(scene).shape == (200, 256)
        assert fs.check() == [], folder.name


def test_a_cameras_bits_are_taken_where_files_of_16_leave_them_open(tmp_path):
    """12-bit words at the top of 16 are shifted; a depth that somebody gave stays."""
    dn = np.arange(64, 64 + 48, dtype=np.uint16).reshape(6, 8)
    records = [FrameRecord(i, f"{i}.npy", "bias") for i in range(2)]
    for record in records:
        np.save(tmp_path / record.file, dn * 16 + (0xF000 - 0x1000))
    write_table(tmp_path / "frames.csv", records)
    frames = FrameSet.load(tmp_path, resolution=(6, 8))
    assert frames.subset([1]).assuming_bits(12).bit_depth == 12
    np.testing.assert_array_equal(frames.assuming_bits(12).read(1), dn + 0xF00 - 0x100)
    assert FrameSet.load(tmp_path, bit_depth=14).assuming_bits(12).bit_depth == 14
    bottom = FrameSet.from_arrays(records, np.stack([dn, dn]))
    assert bottom.assuming_bits(10).bit_depth == 10
    assert bottom.assuming_bits(16) is bottom


@pytest.mark.parametrize(
    ("records", "frames", "named"),
    [
        (None, np.zeros((1, 4, 4)), "records: None is no sequence"),
        ([FrameRecord(0, "a", "bias")], None, "frames: None is no sequence"),
        ([{"kind": "bias"}], np.zeros((1, 4, 4)), "records: a dict is no record"),
        ([FrameRecord(0, "a", "bias")], np.zeros((1, 4, 4), complex), "a: holds complex128"),
        ([FrameRecord(0, "a", "bias")], np.full((1, 4, 4), "x"), "a: holds <U1"),
    ],
)
def test_arrays_of_another_kind_are_refused(records, frames, named):
    with pytest.raises(InputError) as told:
        FrameSet.from_arrays(records, frames).read(0)
    assert str(told.value).startswith(named)


@pytest.mark.parametrize("path", [None, 3, ["a.tif"], np.zeros((2, 4, 4))])
def test_what_is_no_path_is_refused(path):
    with pytest.raises(InputError, match="is not a frame set; expected a FrameSet, or the path of one"):
        FrameSet.load(path)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("resolution", 48),
        ("resolution", "48x64"),
        ("resolution", (48,)),
        ("resolution", (4.5, 6)),
        ("resolution", (0, 6)),
        ("bit_depth", "12"),
        ("bit_depth", 12.5),
        ("bit_depth", 33),
    ],
)
def test_options_of_another_kind_are_refused(tmp_path, option, value):
    small_set()[0].save(tmp_path / "set")
    with pytest.raises(InputError) as told:
        FrameSet.load(tmp_path / "set", **{option: value})
    assert told.value.field == option
    assert repr(value) in told.value.problem


def test_a_frame_set_by_path_or_itself(tmp_path):
    frames = FrameSet.from_arrays([FrameRecord(0, "0.npy", "bias")], [np.zeros((4, 6), np.uint16)])
    assert FrameSet.of(frames) is frames
    with pytest.raises(InputError, match="int is not a frame set; expected a FrameSet"):
        FrameSet.of(3)
    with pytest.raises(InputError, match="no such file or folder"):
        FrameSet.of(tmp_path / "nowhere")
