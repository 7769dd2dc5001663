import dataclasses

import pytest

from visaug.core.errors import InputError
from visaug.frames import FrameRecord, read_table, write_table
from visaug.frames.names import is_master, kind_of
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


@pytest.mark.parametrize("name", ["a.npz#frames[3,0]", "a.npz#d[:,:,3]", "a.npz#frames[3]", "b [1].npy"])
def test_an_index_without_quotation_marks_is_understood(tmp_path, name):
    path = table(tmp_path, f"0,{name},dark,1,20,0,,")
    assert read_table(path) == [FrameRecord(0, name, "dark", 1.0, 20.0)]


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
        ("0,a.npy,flat,1,20,0,5,,7,", "row 2"),
        ("1.5,a.npy,flat,1,20,0,5,", "row 2, sequence"),
        ('0,a.npy,flat,1,20,0,"1,500",', "row 2, photons"),
    ],
)
def test_bad_cell_is_named_in_one_line(tmp_path, row, named):
    with pytest.raises(InputError) as caught:
        read_table(table(tmp_path, row))
    message = str(caught.value)
    assert "frames.csv" in message
    assert named in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "header",
    [
        "sequence,file",
        HEADER + ",kind",
        HEADER.replace("exposure_s", "exposure"),
        HEADER + ",setings",
        "",
        "file,kind",
    ],
)
def test_bad_header_is_refused(tmp_path, header):
    with pytest.raises(InputError, match=r"frames.csv"):
        read_table(table(tmp_path, "0,a.npy,bias,0.1,20,0,,", header=header))


def test_tables_as_laboratories_write_them(tmp_path):
    """Capitals, semicolons with decimal commas, tabs, further columns, no column that may be absent."""
    path = table(
        tmp_path,
        "b.npy;Bias Frame;;-9,5;x",
        "d.npy;DARK;0,001;;y",
        "m.npy;Master Flat;2;1,5;",
        header="File;Kind;Exposure_s;Temperature_C;remark",
    )
    warnings: list[str] = []
    assert read_table(path, warnings) == [
        FrameRecord(0, "b.npy", "bias", 0.0, -9.5),
        FrameRecord(1, "d.npy", "dark", 0.001),
        FrameRecord(2, "m.npy", "flat", 2.0, 1.5, combined=0),
    ]
    assert [w.split(":")[0] for w in warnings] == ["columns_ignored"]
    assert "remark" in warnings[0]
    path.write_text("file\tkind\texposure_s\nd.npy\tdark\t0.25\n")
    assert read_table(path) == [FrameRecord(0, "d.npy", "dark", 0.25)]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_tables_as_spreadsheets_write_them(tmp_path, encoding):
    path = tmp_path / "frames.csv"
    path.write_bytes("file;kind;exposure_s\r\nWeiß µ.npy;flat;0,5\r\n".encode(encoding))
    assert read_table(path) == [FrameRecord(0, "Weiß µ.npy", "flat", 0.5)]


def test_further_conditions_are_read_and_written(tmp_path):
    path = table(
        tmp_path,
        "a.npy,flat,1,100,10,525 nm,1,rggb,12,2026-01-31T23:59:58",
        "b.npy,flat,1,100,,,8,,,2026-01-31T23:59:57.5",
        header="file,kind,exposure_s,gain,offset,filter,combined,bayer,bit_depth,time_s",
    )
    moment = 1769903998.0  # date -d 2026-01-31T23:59:58Z +%s
    records = [
        FrameRecord(0, "b.npy", "flat", 1.0, setting="GAIN=100", combined=8, time_s=moment - 0.5),
        FrameRecord(
            1, "a.npy", "flat", 1.0, setting="GAIN=100 OFFSET=10", filter="525 nm", bayer="RGGB",
            bit_depth=12, time_s=moment,
        ),
    ]  # fmt: skip
    assert read_table(path) == records
    write_table(tmp_path / "again.csv", records)
    assert read_table(tmp_path / "again.csv") == records


@pytest.mark.parametrize(
    ("text", "kind", "master"),
    [
        ("Bias Frame", "bias", False),
        ("ZERO", "bias", False),
        ("Offset", "bias", False),
        ("Master Bias", "bias", True),
        ("masterdark_300s", "dark", True),
        ("superflat", "flat", False),
        ("Flat Dark", "dark", False),
        ("DOME FLAT", "flat", False),
        ("bias_000", "bias", False),
        ("Light Frame", "scene", False),
        ("lamp", None, False),
        ("unbiased", None, False),
        ("", None, False),
    ],
)
def test_kind_of_a_word(text, kind, master):
    assert kind_of(text) == kind
    assert is_master(text) == (master or text == "superflat")


def test_sequence_must_be_unique(tmp_path):
    with pytest.raises(InputError, match="row 2"):
        read_table(table(tmp_path, "4,a.npy,bias,0,,,,", "4,b.npy,bias,0,,,,"))


@pytest.mark.parametrize("text", ["", "1:2", "1:2,3", "a:b,c:d", "1:2,3:4,5:6"])
def test_bad_window_text_is_refused(text):
    with pytest.raises(InputError, match="r0:r1,c0:c1"):
        parse_window(text)


@pytest.mark.parametrize(
    "change",
    [{"bayer": "RGBG"}, {"combined": -1}, {"bit_depth": 40}, {"exposure_s": 1e-300}, {"exposure_s": -1.0}],
)
def test_impossible_condition_is_refused(change):
    with pytest.raises(InputError, match=next(iter(change))):
        FrameRecord(0, "a.npy", "dark", **change)


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
            {"setting": "GAIN=100"},
            {"filter": "V"},
            {"combined": 0},
            {"bayer": "RGGB"},
            {"time_s": 5.0},
        )
    ]
    groups = group_records((base, *others))
    assert [g.indices for g in groups] == [(0, 1, 13), *((i,) for i in range(2, 13))]


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("sequence", "0", "sequence: '0' is not valid"),
        ("file", None, "file: None is not valid"),
        ("exposure_s", "10ms", "exposure_s: '10ms' is not a number; expected seconds"),
        ("exposure_s", None, "exposure_s: None is not a number"),
        ("temperature_c", "20", "temperature_c: '20' is not a number"),
        ("window", "0:4,0:4", "region: '0:4,0:4' is not a window"),
        ("window", (0, 4), "region: (0, 4) is not a window"),
        ("window", (4, 0, 0, 4), "region: 4:0,0:4 is not a window"),
    ],
)
def test_a_record_refuses_values_of_another_kind(field, value, named):
    with pytest.raises(InputError) as told:
        FrameRecord(**({"sequence": 0, "file": "a.npy", "kind": "dark"} | {field: value}))
    assert str(told.value).startswith(named)
