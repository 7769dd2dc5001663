"""Tables from names and headers; and formats that laboratories bring."""

import json
import os
from datetime import UTC, datetime

import numpy as np
import pytest
import tifffile
from PIL import Image

from visaug.core.errors import InputError
from visaug.frames import FrameSet, read_table
from visaug.frames.names import read_name
from visaug.frames.survey import natural, parse_resolution, survey

RNG = np.random.default_rng(31)


def pixels(shape=(6, 8), top=4000):
    return RNG.integers(100, top, shape, dtype=np.uint16)


def put(folder, *names, shape=(6, 8)):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        tifffile.imwrite(path, pixels(shape), photometric="minisblack")


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        ("bias_000.tif", {"kind": "bias"}),
        ("bias001.fits.fz", {"kind": "bias"}),
        ("dark_2s_20C_003.fits", {"kind": "dark", "exposure_s": 2.0, "temperature_c": 20.0}),
        ("darks/2.5s_-10C/7.tif", {"kind": "dark", "exposure_s": 2.5, "temperature_c": -10.0}),
        ("dark-10C-2s.tif", {"kind": "dark", "exposure_s": 2.0}),  # a dash or a minus: nobody knows
        (
            "flat_10ms_500ph_525nm.tif",
            {"kind": "flat", "exposure_s": 0.01, "photons": 500.0, "filter": "525 nm"},
        ),
        ("flat_0p5s_6dB_12bit.png", {"kind": "flat", "exposure_s": 0.5, "gain_db": 6.0, "bit_depth": 12}),
        ("gain100/flat_1,5s.tif", {"kind": "flat", "exposure_s": 1.5, "setting": "GAIN=100"}),
        ("MasterBias.fits", {"kind": "bias", "combined": 0}),
        ("lights/img_20.tif", {"kind": "scene"}),
        ("darks/flat_1s.tif", {"kind": "flat", "exposure_s": 1.0}),  # the nearer name wins
        ("IMG_2016s04.tif", {}),
        ("images/b_000.png", {}),
        ("session3/x.tif", {}),
    ],
)
def test_facts_of_names(name, facts):
    assert read_name(name).facts == facts


def test_subfolders_give_a_table_that_can_be_loaded(tmp_path):
    put(
        tmp_path,
        "bias/1.tif",
        "bias/10.tif",
        "bias/2.tif",
        "darks/1s_20C_1.tif",
        "flat/5ms_1.tif",
        ".x/bias.tif",
    )
    found = survey(tmp_path, {"bit_depth": 12})
    assert found.complete
    assert [r["file"] for r in found.rows] == [
        "bias/1.tif",
        "bias/2.tif",
        "bias/10.tif",
        "darks/1s_20C_1.tif",
        "flat/5ms_1.tif",
    ]
    (tmp_path / "frames.csv").write_text(found.text())
    assert read_table(tmp_path / "frames.csv") == found.records()
    frames = FrameSet.load(tmp_path)
    assert frames.bit_depth == 12
    assert frames.read(4).shape == (6, 8)
    # A table elsewhere names the files from where it lies.
    elsewhere = tmp_path / "tables"
    elsewhere.mkdir()
    (elsewhere / "frames.csv").write_text(found.text(elsewhere))
    np.testing.assert_array_equal(FrameSet.load(elsewhere).read(1), frames.read(1))
    # Without a table the folder is read in the same way, and says so.
    (tmp_path / "frames.csv").unlink()
    direct = FrameSet.load(tmp_path)
    assert [r.kind for r in direct.records] == ["bias", "bias", "bias", "dark", "flat"]
    assert any(w.startswith("read_from_names") for w in direct.warnings)


def test_what_is_missing_is_said_with_how_to_give_it(tmp_path):
    put(tmp_path, "bias_0.tif", "dark_0.tif", "dark_1.tif", "flat_2s_0.tif", "what.tif")
    found = survey(tmp_path)
    notes = {note.split(":")[0]: note for note in found.notes}
    assert not found.complete
    assert "what.tif" in notes["kind"]
    assert "dark_0.tif, dark_1.tif" in notes["exposure_s"]
    assert "--exposure" in notes["exposure_s"]
    assert {"photons", "temperature_c", "bit_depth", "order_assumed"} <= set(notes)
    (tmp_path / "frames.csv").write_text(found.text())
    with pytest.raises(InputError, match="row 3, exposure_s: is blank"):
        read_table(tmp_path / "frames.csv")
    (tmp_path / "frames.csv").unlink()
    with pytest.raises(InputError, match="visaug frames"):
        FrameSet.load(tmp_path)
    assert not survey(tmp_path, {"exposure_s": 1.0}).missing("exposure_s")


def test_the_word_that_told_each_file(tmp_path):
    put(tmp_path, "darks/3_2s.tif", "flat_1_100s_m10C_1.tif", "flat_1_100s_m10C_2.tif")
    found = survey(tmp_path, {"exposure_s": 7.0})
    assert found.told_by() == {
        ("dark", "darks in the name", 7.0, "an option", None, ""): ["darks/3_2s.tif"],
        ("flat", "flat in the name", 0.01, "1_100s in the name", -10.0, "m10c in the name"): [
            "flat_1_100s_m10C_1.tif",
            "flat_1_100s_m10C_2.tif",
        ],
    }


@pytest.mark.parametrize("names", [["dark_alley.tif", "a.tif"], ["dark_1.tif", "dark_2.tif"], ["flat_1.tif"]])
def test_pictures_stay_pictures_whatever_their_names(tmp_path, names):
    put(tmp_path, *names)
    assert {r.kind for r in FrameSet.load(tmp_path).records} == {"image"}


def test_a_descriptor_beside_the_frames_is_pointed_out(tmp_path):
    put(tmp_path, "images/b_000.tif")
    (tmp_path / "EMVA1288_Data.txt").write_text("n 12 8 6")
    notes = [note.split(":")[0] for note in survey(tmp_path).notes]
    assert "descriptor" in notes
    assert "kind" in notes


def test_nothing_to_find(tmp_path):
    with pytest.raises(InputError, match="holds no frames"):
        survey(tmp_path)
    with pytest.raises(InputError, match="is not a folder"):
        survey(tmp_path / "absent")
    put(tmp_path, "deep/er/a.tif")
    with pytest.raises(InputError, match=r"1 files may contain some.*visaug frames"):
        FrameSet.load(tmp_path)


def test_a_file_that_cannot_be_read_is_left_out_and_named(tmp_path):
    """Of a folder that is searched; one that is asked for by name is refused."""
    put(tmp_path, "bias_0.tif", "bias_1.tif")
    (tmp_path / "bias_2.tif").write_bytes(b"")
    found = survey(tmp_path)
    assert [r["file"] for r in found.rows] == ["bias_0.tif", "bias_1.tif"]
    (note,) = [n for n in found.notes if n.startswith("unreadable_files: 1 file is left out")]
    assert "bias_2.tif" in note
    with pytest.raises(InputError, match=r"bias_2\.tif"):
        FrameSet.load(tmp_path)
    for name in ("bias_0.tif", "bias_1.tif"):
        (tmp_path / name).unlink()
    with pytest.raises(InputError, match=r"bias_2\.tif"):
        survey(tmp_path)


def test_a_damaged_png_is_left_out_and_named(tmp_path):
    """Cut, one byte changed, and no picture at all."""
    for name in ("bias_0.png", "bias_1.png", "bias_2.png"):
        Image.fromarray(pixels((20, 30))).save(tmp_path / name)
    whole = (tmp_path / "bias_1.png").read_bytes()
    (tmp_path / "bias_1.png").write_bytes(whole[: len(whole) // 2])
    changed = bytearray(whole)
    changed[len(whole) // 2] ^= 0xFF
    (tmp_path / "bias_2.png").write_bytes(changed)
    (tmp_path / "bias_3.png").write_bytes(b"no picture")
    found = survey(tmp_path)
    assert [r["file"] for r in found.rows] == ["bias_0.png"]
    (note,) = [n for n in found.notes if n.startswith("unreadable_files: 3 files are left out")]
    assert all(f"bias_{n}.png" in note for n in (1, 2, 3))


def test_a_tiff_without_its_last_pixels_is_left_out(tmp_path):
    """One frame, one stack; tifffile writes the header into the first 256 bytes."""
    for name, content in (("bias_0.tif", pixels()), ("bias_1.tif", np.stack([pixels()] * 3))):
        tifffile.imwrite(tmp_path / name, content, photometric="minisblack")
        whole = (tmp_path / name).read_bytes()
        (tmp_path / f"bias_cut_{name[-5]}.tif").write_bytes(whole[: 256 + content.nbytes - 10])
    found = survey(tmp_path)
    assert [r["file"] for r in found.rows] == ["bias_0.tif", *(f"bias_1.tif#[{n}]" for n in range(3))]
    assert any("unreadable_files: 2 files" in n and "bias_cut_0.tif" in n for n in found.notes)


def test_natural_order_and_sizes():
    assert sorted(["a10", "a9", "a", "10", "9b"], key=natural) == ["9b", "10", "a", "a9", "a10"]
    assert parse_resolution(" 20 x 30") == (20, 30)
    with pytest.raises(InputError, match="--resolution"):
        parse_resolution("20")


def test_stack_and_exif_of_tiff(tmp_path):
    stack = pixels((3, 6, 8))
    tifffile.imwrite(tmp_path / "dark_stack.tif", stack, photometric="minisblack")
    exif = Image.Exif()
    exif[0x8769] = {0x829A: 0.004, 0x8827: 800, 0x9003: "2026:03:01 12:00:00"}
    Image.fromarray(pixels()).save(tmp_path / "flat.png", exif=exif)
    found = {r["file"]: r for r in survey(tmp_path, {"exposure_s": 3.0}).rows}
    assert [found[f"dark_stack.tif#[{i}]"]["exposure_s"] for i in range(3)] == [3.0] * 3
    flat = found["flat.png"]
    assert flat["exposure_s"] == pytest.approx(0.004)
    assert flat["setting"] == "ISO=800"
    assert flat["time_s"] == datetime(2026, 3, 1, 12, tzinfo=UTC).timestamp()
    (tmp_path / "flat.png").unlink()
    (tmp_path / "frames.csv").write_text(survey(tmp_path, {"exposure_s": 3.0}).text())
    frames = FrameSet.load(tmp_path)
    for i in range(3):
        np.testing.assert_array_equal(frames.read(i), stack[i])


def test_exposures_of_microscopes(tmp_path):
    tifffile.imwrite(
        tmp_path / "dark.ome.tif",
        pixels((2, 6, 8)),
        metadata={"axes": "TYX", "Plane": {"ExposureTime": [40.0, 40.0], "ExposureTimeUnit": ["ms", "ms"]}},
    )
    rows = survey(tmp_path).rows
    assert [(r["file"], r["kind"], r["exposure_s"]) for r in rows] == [
        (f"dark.ome.tif#[{i}]", "dark", 0.04) for i in range(2)
    ]


def test_hdf5_stacks_with_attributes(tmp_path):
    h5py = pytest.importorskip("h5py")
    stacks = {"bias": pixels((2, 6, 8)), "run/dark_2s": pixels((3, 6, 8))}
    with h5py.File(tmp_path / "set.h5", "w") as file:
        file.attrs["bit_depth"] = 12
        for name, values in stacks.items():
            file.create_dataset(name, data=values, chunks=(1, 6, 8), compression="gzip")
        file["run"].attrs["temperature_c"] = 21.5
    frames = FrameSet.load(tmp_path)
    assert [(r.file, r.kind, r.exposure_s, r.temperature_c) for r in frames.records] == [
        *((f"set.h5#bias[{i}]", "bias", 0.0, None) for i in range(2)),
        *((f"set.h5#run/dark_2s[{i}]", "dark", 2.0, 21.5) for i in range(3)),
    ]
    assert frames.bit_depth == 12
    np.testing.assert_array_equal(frames.read(3), stacks["run/dark_2s"][1])
    for name, message in (
        ("nothing[0]", "holds no data set 'nothing'; expected one of bias"),
        ("bias[9]", "outside"),
    ):
        (tmp_path / "frames.csv").write_text(f"file,kind\nset.h5#{name},bias\n")
        with pytest.raises(InputError, match=message):
            FrameSet.load(tmp_path).read(0)
    (tmp_path / "frames.csv").write_text("file,kind\nbroken.h5#bias[0],bias\n")
    (tmp_path / "broken.h5").write_bytes(b"no HDF5")
    with pytest.raises(InputError, match="not an HDF5"):
        FrameSet.load(tmp_path).read(0)


def test_npz_arrays_by_name(tmp_path):
    np.savez(tmp_path / "all.npz", bias=pixels((2, 6, 8)), dark_1s=pixels((6, 8)), times=np.zeros(3))
    assert [(r.file, r.kind, r.exposure_s) for r in FrameSet.load(tmp_path).records] == [
        ("all.npz#bias[0]", "bias", 0.0),
        ("all.npz#bias[1]", "bias", 0.0),
        ("all.npz#dark_1s", "dark", 1.0),
    ]


def bits_to_bytes(bits):
    """Bytes from bits, lowest first, padded with zeros."""
    bits = np.concatenate([bits, np.zeros(-len(bits) % 8, int)])
    return (bits.reshape(-1, 8) << np.arange(8)).sum(1).astype(np.uint8)


def packed(values, form):
    """Packing written from the text of the standards, one pixel at a time."""
    if form in ("mono10p", "mono12p"):
        width = int(form[4:6])
        return bits_to_bytes(np.concatenate([(int(v) >> np.arange(width)) & 1 for v in values]))
    low = 4 if form == "mono12packed" else 2
    out = []
    for a, b in values.reshape(-1, 2).astype(int):
        out += [a >> low, (a & ((1 << low) - 1)) | (b & ((1 << low) - 1)) << 4, b >> low]
    return np.array(out, np.uint8)


@pytest.mark.parametrize(
    ("form", "bits"),
    [("mono8", 8), ("mono10p", 10), ("mono12p", 12), ("mono10packed", 10), ("mono12packed", 12)],
)
@pytest.mark.parametrize("kind", ["flat", "dark"])
def test_packed_raw_files_are_found_out(tmp_path, form, bits, kind):
    rows, columns = np.mgrid[:12, :20]
    level = 0.4 * 2**bits + 3 * rows + 2 * columns if kind == "flat" else 0.05 * 2**bits + 0 * rows
    image = np.rint(level + RNG.normal(0, 2, rows.shape)).astype(int)
    data = image.ravel().astype(np.uint8) if form == "mono8" else packed(image.ravel(), form)
    data.tofile(tmp_path / f"{kind}_1s.raw")
    (tmp_path / "frames.csv").write_text(survey(tmp_path, resolution=(12, 20)).text())
    frames = FrameSet.load(tmp_path)
    np.testing.assert_array_equal(frames.read(0), image)
    assert frames.bit_depth == bits
    assert any(form in w for w in frames.warnings if w.startswith("packing_assumed"))


def dng(path, mosaic):
    """A small DNG 1.4 written with tifffile: the tags that the specification demands of a mosaic."""
    matrix = [v for entry in np.eye(3).ravel() for v in (int(entry * 10000), 10000)]
    tags = [
        (50706, 1, 4, (1, 4, 0, 0), False),  # DNGVersion
        (50708, 2, 0, "Test Camera", False),  # UniqueCameraModel
        (33421, 3, 2, (2, 2), False),  # CFARepeatPatternDim
        (33422, 1, 4, (1, 0, 2, 1), False),  # CFAPattern: G R, B G
        (50721, 10, 9, matrix, False),  # ColorMatrix1
        (50714, 3, 1, 512, False),  # BlackLevel
        (50717, 3, 1, 16383, False),  # WhiteLevel
        (33434, 5, 1, (1, 8), False),  # ExposureTime
        (34855, 3, 1, 400, False),  # ISOSpeedRatings
    ]
    tifffile.imwrite(path, mosaic, photometric=32803, extratags=tags, planarconfig="contig")


def test_raw_files_of_another_size_are_left_out(tmp_path):
    np.zeros((6, 8), "<u2").tofile(tmp_path / "bias_0.raw")
    with pytest.raises(InputError, match=r"bias_0\.raw: resolution: 96 bytes are no frame of 10 x 10 pixels"):
        survey(tmp_path, resolution=(10, 10))
    np.zeros((5, 8), "<u2").tofile(tmp_path / "bias_1.raw")
    found = survey(tmp_path, resolution=(6, 8))
    assert [row["file"] for row in found.rows] == ["bias_0.raw"]
    assert any(note.startswith("unreadable_files: 1 file is left out") for note in found.notes)


def test_raw_photographs(tmp_path):
    pytest.importorskip("rawpy")
    mosaic = RNG.integers(500, 16000, (64, 96), dtype=np.uint16)
    dng(tmp_path / "bias_1.dng", mosaic)
    dng(tmp_path / "flat_1.dng", mosaic[::-1])
    frames = FrameSet.load(tmp_path)
    bias, flat = frames.records
    assert (bias.kind, flat.kind, flat.exposure_s, flat.setting) == ("bias", "flat", 0.125, "ISO=400")
    assert (flat.bayer, frames.bit_depth) == ("GRBG", 14)
    np.testing.assert_array_equal(frames.read(0), mosaic)
    (tmp_path / "flat_1.dng").write_bytes(b"no photograph at all")
    with pytest.raises(InputError, match=r"flat_1.dng"):
        FrameSet.load(tmp_path)


def test_missing_extras_are_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "rawpy", None)
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    for name in ("bias.nef", "bias.h5"):
        (tmp_path / name).write_bytes(b"x")
        (tmp_path / "frames.csv").write_text(f"file,kind\n{name},bias\n")
        with pytest.raises(InputError, match=r"visaug\[raw\]"):
            FrameSet.load(tmp_path).read(0)


def test_micro_manager_exposure(tmp_path):
    from visaug.frames.headers import _microscope

    assert _microscope({"Summary": {}, "Frames": [json.loads('{"Exposure-ms": "12.5"}')]}) == {
        "exposure_s": 0.0125
    }


def test_a_name_that_is_not_utf8_is_named(tmp_path):
    put(tmp_path, "dark_1s.tif")
    try:
        (tmp_path / "dark_1s.tif").rename(tmp_path / os.fsdecode(b"dark_1s_\xe9.tif"))
    except OSError:
        pytest.skip("the file system takes UTF-8 alone")
    with pytest.raises(InputError, match="dark_1s_\udce9\\.tif: has a name that is not UTF-8"):
        survey(tmp_path).text()


def test_arrays_that_are_no_frames_are_named(tmp_path):
    """A file of numbers beside frames is left out with a note; alone it is a mistake."""
    np.save(tmp_path / "numbers.npy", np.zeros((2, 2, 4, 4)))
    with pytest.raises(InputError, match=r"numbers\.npy: holds no frames; expected arrays"):
        survey(tmp_path)
    np.save(tmp_path / "bias.npy", pixels())
    found = survey(tmp_path)
    assert [r["file"] for r in found.rows] == ["bias.npy"]
    assert any("unreadable_files: 1 file is left out" in note for note in found.notes)
