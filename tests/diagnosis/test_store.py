"""Entries of the store are whole and unchanged, or not there; no other file is touched."""

import io
import os
import pickle
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from visaug.diagnosis.fitting import store

VALUES = {"values": np.arange(60.0).reshape(6, 10), "names": np.array(["a", "b"])}


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path))
    return tmp_path


def entry(name):
    return store.folder() / f"{name}{store.SUFFIX}"


def test_what_is_kept_is_loaded(place):
    assert store.load("one") is None
    store.keep("one", VALUES)
    for name, array in store.load("one").items():
        assert array.dtype == VALUES[name].dtype
        assert (array == VALUES[name]).all()


@settings(max_examples=int(os.environ.get("VISAUG_EXAMPLES", "200")), deadline=None)
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7), cut=st.booleans())
def test_a_flipped_bit_or_a_cut_makes_an_entry_absent(tmp_path_factory, where, bit, cut):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VISAUG_CACHE", str(tmp_path_factory.getbasetemp() / "damage"))
        store.keep("one", VALUES)
        content = bytearray(entry("one").read_bytes())
        at = int(where * len(content))
        if cut:
            del content[at:]
        else:
            content[at] ^= 1 << bit
        entry("one").write_bytes(content)
        assert store.load("one") is None
        assert not entry("one").exists()
        store.keep("one", VALUES)
        assert store.load("one") is not None


class Evil:
    def __reduce__(self):
        return os.mkdir, ("evil",)


def test_an_entry_with_any_content_and_the_right_checksum_runs_no_code(place, monkeypatch):
    monkeypatch.chdir(place)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as made:
        made.writestr("values.npy", pickle.dumps(Evil()))
    pickled = io.BytesIO()
    np.save(pickled, np.array([Evil()], object), allow_pickle=True)
    header = b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f8', 'fortran_order': False, 'shape': (10**18,)}".ljust(
        128
    )
    store.folder().mkdir()
    for content in (b"", archive.getvalue(), pickled.getvalue(), pickle.dumps(Evil()), header):
        entry("one").write_bytes(store._check("one", content) + content)
        found = store.load("one")
        assert found is None or all(isinstance(value, bytes) for value in found.values())
    assert not (place / "evil").exists()


def test_an_entry_under_another_name_is_none(place):
    store.keep("one", VALUES)
    entry("one").rename(entry("two"))
    assert store.load("two") is None


def test_what_was_not_used_for_longest_makes_room_and_other_files_stay(place, monkeypatch):
    monkeypatch.setattr(store, "MOST", 2500)
    foreign = [place / "frames.npz", place / "old.arrays", store.folder() / "mine.npz"]
    store.folder().mkdir()
    for file in foreign:
        file.write_bytes(b"x" * 5000)
        os.utime(file, ns=(0, 0))
    for age, name in enumerate(("first", "second")):
        store.keep(name, {"values": np.zeros(100)})
        os.utime(entry(name), ns=(age, age))
    assert store.load("first") is not None  # used now, so the second is the older
    store.keep("third", {"values": np.zeros(100)})
    assert {name for name in ("first", "second", "third") if entry(name).exists()} == {"first", "third"}
    assert all(file.stat().st_size == 5000 for file in foreign)


def test_what_a_killed_process_left_goes(place):
    store.keep("one", VALUES)
    left, fresh = store.folder() / f"{store.SCRATCH}left", store.folder() / f"{store.SCRATCH}fresh"
    left.touch()
    fresh.touch()
    os.utime(left, (0, 0))
    store.keep("two", VALUES)
    assert not left.exists()
    assert fresh.exists()


def test_a_store_that_cannot_be_written_is_done_without(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path / "file"))
    store.keep("one", VALUES)
    assert store.load("one") is None


WRITER = f"""
import runpy
import types
import numpy as np
store = types.SimpleNamespace(**runpy.run_path({store.__file__!r}))  # without what the package imports
store.load.__globals__["MOST"] = 20_000
for i in range(150):
    name, value = f"n{{i % 7}}", float(i % 7)
    kept = store.load(name)
    assert kept is None or (kept["values"] == value).all()
    store.keep(name, {{"values": np.full(500, value)}})
"""


def test_two_processes_share_a_store(place):
    running = [
        subprocess.Popen([sys.executable, "-c", WRITER], env=os.environ | {"VISAUG_CACHE": str(place)})
        for _ in "ab"
    ]
    assert [process.wait(120) for process in running] == [0, 0]
    assert not list(store.folder().glob(f"{store.SCRATCH}*"))


@pytest.mark.skipif(sys.platform != "linux", reason="mounts a tmpfs")
def test_a_full_disk_keeps_nothing_and_stops_nobody(tmp_path, monkeypatch):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", disk]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("cannot mount a file system")
    try:
        monkeypatch.setenv("VISAUG_CACHE", str(disk))
        store.keep("large", {"values": np.random.default_rng(1).random(40_000)})
        assert store.load("large") is None
        assert not [file for file in disk.rglob("*") if file.is_file()]
        store.keep("one", VALUES)
        assert store.load("one") is not None
    finally:
        subprocess.run(["umount", disk], check=True)
