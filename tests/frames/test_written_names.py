"""Names of frames to write: no two in one place, none in another's way, none outside; else nothing is written."""

import numpy as np
import pytest

from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet


def frame_set(*names, clean=None):
    records = [
        FrameRecord(i, name, "scene" if clean else "bias", 0.0, clean=clean) for i, name in enumerate(names)
    ]
    frames = np.arange(len(names) * 12, dtype=np.uint16).reshape(len(names), 3, 4)
    return FrameSet.from_arrays(
        records, frames, {clean: np.ones((3, 4), np.float32)} if clean else {}, bit_depth=16
    )


@pytest.mark.parametrize(
    "names",
    [
        ("a.npy", "./a.npy"),
        ("x/a.npy", "x//a.npy"),
        ("a.npy", "a.npy/b.npy"),
        ("a/b.npy", "a"),
        ("camera.yaml/x.npy",),
        ("camera.yaml",),
        ("frames.csv",),
        ("./frames.csv",),
        ("frames.csv/a.npy",),
        ("../a.npy",),
        ("/a.npy",),
        ("a.npy", "a.npy#[1]"),
        ("a.npy#k[0]", "a.npy#l[0]"),
        ("a.npz",),
        ("a.npz#k", "a.npz#k[1]"),
        ("a.npz#k[3000000]",),
        ("a.npz#k[0,0]", "a.npz#k[99999999,99999999]"),
        ("a.npy#[0]", "./a.npy#[0]"),
        ("a.gif",),
        (".",),
    ],
)
def test_names_that_are_refused(tmp_path, names):
    with pytest.raises(InputError):
        frame_set(*names).save(tmp_path / "out", keep_names=True)
    assert list(tmp_path.iterdir()) == []


def test_names_that_are_written(tmp_path):
    names = ["a.npy", "x/b.tif", "c.npz#file[1]", "c.npz#file[0]", "c.npz#x/y", "d.npy#[0]", "d.npy#[2]"]
    made = frame_set(*names, clean="a.tif#[0]")
    read = FrameSet.load(made.save(tmp_path / "out", keep_names=True))
    assert [r.file for r in read.records] == names
    for i in range(len(names)):
        assert (read.read(i) == made.read(i)).all()
        assert (read.clean(i) == 1).all()


def test_a_folder_that_is_no_frame_set_is_not_replaced(tmp_path):
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").touch()
    with pytest.raises(InputError, match="no frame set"):
        frame_set("a.npy").save(tmp_path / "notes", overwrite=True)
    assert (tmp_path / "notes" / "mine.txt").exists()


@pytest.mark.parametrize("where", ["elsewhere", "in it"])
def test_replacing_a_set_keeps_what_is_not_of_it(tmp_path, monkeypatch, where):
    place = frame_set("a.npy", "x/b.npy").save(tmp_path / "out", keep_names=True)
    if where == "in it":
        monkeypatch.chdir(place)
    (place / "notes.txt").write_text("mine")
    (place / "x" / "thesis.txt").write_text("mine too")
    target = "." if where == "in it" else place
    frame_set("x/b.npy").save(target, keep_names=True, overwrite=True)
    left = sorted(path.relative_to(place).as_posix() for path in place.rglob("*") if path.is_file())
    assert left == ["frames.csv", "notes.txt", "x/b.npy", "x/thesis.txt"]
    assert (place / "x" / "thesis.txt").read_text() == "mine too"


def test_a_format_that_is_not_written_is_named_as_in_the_table(tmp_path):
    with pytest.raises(InputError) as told:
        frame_set("a.gif").save(tmp_path / "out", keep_names=True)
    assert "'a.gif' cannot be written" in str(told.value)
    half = FrameSet.from_arrays([FrameRecord(0, "x/b.png", "dark", 1.0)], np.full((1, 2, 2), 1.5, np.float32))
    with pytest.raises(InputError) as told:
        half.save(tmp_path / "out", keep_names=True)
    assert str(told.value).startswith("x/b.png: float32 pixels cannot be written as .png")
