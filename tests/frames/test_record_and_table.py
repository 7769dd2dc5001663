import dataclasses

import pytest

from visaug.errors import InputError
from visaug.frames import FrameRecord, read_table, write_table
from visaug.frames.record import group_records, parse_window

HEADER = "sequence,file,kind,exposure_s,temperature_c,gain_db,photons,clean"


def table(tmp_path, *rows, header=HEADER):
    path = tmp_path / "frames.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_reads_every_column_and_sorts_by_sequence(tmp_path):
    path = table(
        tmp_path,
        "7,b.npz#frames[3],flat,0.01,20.5,6,1500.5,",
        '2,a.npy,scene,0.02,,,,clean.npy,"0:10,5:25"',
        header=HEADER + ",region",
    )
    scene, flat = read_table(path)
    assert scene == FrameRecord(2, "a.npy", "scene", 0.02, None, 0.0, None, "clean.npy", (0, 10, 5, 25))
    assert flat == FrameRecord(7, "b.npz#frames[3]", "flat", 0.01, 20.5, 6.0, 1500.5)


def test_region_without_quotation_marks_is_understood(tmp_path):
    path = table(tmp_path, "0,a.npy,dark,1,,,,,3:9,0:4", header=HEADER + ",region")
    assert read_table(path)[0].window == (3, 9, 0, 4)


def test_writing_then_reading_gives_the_same_records(tmp_path):
    records = [
        FrameRecord(0, "a,b.npy", "bias", 1e-5, -12.25, 3.0),
        FrameRecord(1, "c.npy", "flat", 0.1, None, 0.0, 0.1 + 0.2, None, (0, 4, 0, 8)),
    ]
    write_table(tmp_path / "frames.csv", records)
    assert read_table(tmp_path / "frames.csv") == records


@pytest.mark.parametrize(
    ("row", "named"),
    [
        ("x,a.npy,bias,0.1,20,0,,", "row 2, sequence"),
        ("0,,bias,0.1,20,0,,", "row 2, file"),
        ("0,a.npy,lamp,0.1,20,0,,", "row 2, kind"),
        ("0,a.npy,dark,,20,0,,", "row 2, exposure_s"),
        ("0,a.npy,dark,-1,20,0,,", "row 2, exposure_s"),
        ("0,a.npy,dark,nan,20,0,,", "row 2, exposure_s"),
        ("0,a.npy,dark,1,-300,0,,", "row 2, temperature_c"),
        ("0,a.npy,dark,1,warm,0,,", "row 2, temperature_c"),
        ("0,a.npy,dark,1,20,1000,,", "row 2, gain_db"),
        ("0,a.npy,flat,1,20,0,-5,", "row 2, photons"),
        ("0,a.npy,flat,1,20,0,5,,,,", "row 2"),
    ],
)
def test_bad_cell_is_named_in_one_line(tmp_path, row, named):
    with pytest.raises(InputError) as caught:
        read_table(table(tmp_path, row))
    message = str(caught.value)
    assert "frames.csv" in message
    assert named in message
    assert "\n" not in message


@pytest.mark.parametrize("header", ["file,kind", HEADER + ",colour", HEADER + ",kind", ""])
def test_bad_header_is_refused(tmp_path, header):
    with pytest.raises(InputError, match=r"frames.csv"):
        read_table(table(tmp_path, "0,a.npy,bias,0.1,20,0,,", header=header))


def test_sequence_must_be_unique(tmp_path):
    with pytest.raises(InputError, match="row 2"):
        read_table(table(tmp_path, "4,a.npy,bias,0,,,,", "4,b.npy,bias,0,,,,"))


@pytest.mark.parametrize("text", ["", "1:2", "1:2,3", "a:b,c:d", "1:2,3:4,5:6"])
def test_bad_window_text_is_refused(text):
    with pytest.raises(InputError, match="r0:r1,c0:c1"):
        parse_window(text)


@pytest.mark.parametrize("window", [(5, 5, 0, 4), (-1, 5, 0, 4), (0, 5, 4, 3)])
def test_impossible_window_is_refused(window):
    with pytest.raises(InputError, match="region"):
        FrameRecord(0, "a.npy", "dark", 1.0, window=window)


def test_groups_part_on_every_condition_and_keep_the_order():
    base = FrameRecord(0, "a", "flat", 0.1, 20.0, 0.0, 100.0)
    others = [
        dataclasses.replace(base, **change)
        for change in (
            {},
            {"kind": "scene"},
            {"exposure_s": 0.2},
            {"temperature_c": 21.0},
            {"gain_db": 3.0},
            {"photons": 101.0},
            {"clean": "c.npy"},
            {"window": (0, 1, 0, 1)},
            {},
        )
    ]
    groups = group_records((base, *others))
    assert [g.indices for g in groups] == [(0, 1, 9), (2,), (3,), (4,), (5,), (6,), (7,), (8,)]
