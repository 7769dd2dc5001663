"""Frames are decoded once, and read again as they were."""

import copy
import os
import pickle
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from weakref import WeakSet

import numpy as np
import pytest
import tifffile

from visaug.core.errors import InputError
from visaug.frames import FrameSet, kept
from visaug.frames.kept import KeptFrames
from visaug.frames.pixels import PixelReader
from visaug.frames.stores import FileStore

pytestmark = pytest.mark.skipif(not hasattr(os, "pread"), reason="no reading at a place of a file")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def write_table(folder, files):
    """Of bias frames, one for each file."""
    rows = [f"{k},{file},bias,0,20" for k, file in enumerate(files)]
    table = "\n".join(["sequence,file,kind,exposure_s,temperature_c", *rows]) + "\n"
    (folder / "frames.csv").write_text(table)


@pytest.fixture
def folder(tmp_path):
    """Three frames of 16 bit in a compressed array, with their table."""
    frames = np.random.default_rng(0).integers(0, 60000, (3, 20, 30)).astype(np.uint16)
    np.savez_compressed(tmp_path / "frames.npz", frames)
    write_table(tmp_path, [f"frames.npz#arr_0[{k}]" for k in range(3)])
    return tmp_path, frames


@pytest.fixture
def decoded(monkeypatch):
    """Names of the frames decoded so far."""
    names: list[str] = []
    ordinary = PixelReader.read

    def read(self, name, *rest):
        names.append(name)
        return ordinary(self, name, *rest)

    monkeypatch.setattr(PixelReader, "read", read)
    return names


def test_a_frame_is_decoded_once(folder, decoded):
    place, frames = folder
    read = FrameSet.load(place)
    for _ in range(3):
        for k in (2, 0, 1):
            np.testing.assert_array_equal(read.read(k), frames[k].astype(np.float32))
    last = decoded.count("frames.npz#arr_0[2]")
    assert read.read(2).dtype == np.float32
    assert decoded.count("frames.npz#arr_0[2]") == last <= 2  # once to find the bits, once to be kept


def test_nothing_stays_behind(folder, cache):
    place, _ = folder
    read = FrameSet.load(place)
    read.read(0)
    assert list(cache.iterdir()) == []  # the file has no name


def test_what_is_too_large_or_cannot_be_written_is_decoded_again(folder, decoded, monkeypatch, cache):
    place, frames = folder
    monkeypatch.setattr(kept, "LARGEST", 1200)  # bytes: one frame
    read = FrameSet.load(place)
    for _ in range(2):
        for k in range(3):
            np.testing.assert_array_equal(read.read(k), frames[k])
    assert decoded.count("frames.npz#arr_0[0]") < decoded.count("frames.npz#arr_0[1]")
    cache.rmdir()
    cache.write_text("no folder")
    read = FrameSet.load(place)
    for _ in range(2):
        np.testing.assert_array_equal(read.read(1), frames[1])


def test_a_damaged_frame_is_refused_each_time(folder):
    place, _ = folder
    np.savez_compressed(place / "frames.npz", np.full((3, 20, 30), np.nan))
    read = FrameSet.load(place)
    for _ in range(2):
        with pytest.raises(InputError):
            read.read(0)


def test_a_copy_in_another_process_begins_with_nothing():
    one = KeptFrames()
    one.keep(0, np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(one.read(0), [[0, 1, 2], [3, 4, 5]])
    for other in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one)):
        assert other.read(0) is None
        other.keep(0, np.zeros((1, 2), np.uint8))
        np.testing.assert_array_equal(other.read(0), [[0, 0]])


def test_a_forked_process_adds_nothing():
    """It would write where its parent writes."""
    one = KeptFrames()
    one.keep(0, np.ones((2, 2)))
    child = os.fork()
    if child == 0:
        one.keep(1, np.zeros((2, 2)))
        os._exit(0 if one.read(1) is None and (one.read(0) == 1).all() else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_threads_that_begin_together_find_one_layout(tmp_path, monkeypatch):
    """A frame read before the place of its bits is found would be kept 16 times too large."""
    values = np.full((40, 50), 100, np.uint16)
    for k in range(6):
        tifffile.imwrite(tmp_path / f"{k}.tif", (values + k) << 4)
    write_table(tmp_path, [f"{k}.tif" for k in range(6)])
    ordinary = FileStore._find_shift
    monkeypatch.setattr(FileStore, "_find_shift", lambda self: (time.sleep(0.2), ordinary(self)))
    read = FrameSet.load(tmp_path, bits_at="top")
    with ThreadPoolExecutor(6) as pool:
        list(pool.map(read.read, range(6)))
    assert [read.read(k).max() for k in range(6)] == [100 + k for k in range(6)]


def test_many_sets_do_not_use_up_the_files_that_may_be_open(monkeypatch):
    monkeypatch.setattr(kept, "_open", WeakSet())
    many = [KeptFrames() for _ in range(40)]
    for one in many:
        one.keep(0, np.zeros((2, 2)))
    assert sum(one.read(0) is not None for one in many) == kept.MOST_OPEN


def test_threads_do_not_write_over_one_another():
    """The lab's server reads frames of one set in several threads."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        one = KeptFrames()
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(lambda i: one.keep(i, np.full((3, 5), i)), range(2000)))
    finally:
        sys.setswitchinterval(interval)
    for i in range(2000):
        np.testing.assert_array_equal(one.read(i), np.full((3, 5), i))
