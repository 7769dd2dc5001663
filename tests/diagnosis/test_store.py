"""Entries of the store are whole and unchanged, or not there; no other file is touched."""

import os
import pickle
import sqlite3
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from visaug.diagnosis import store

VALUES = (np.arange(60.0), np.array([]), np.array([np.nan, -np.inf]))


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path))
    return tmp_path


def loaded(name):
    return store.load([name]).get(name)


def changed(name, content):
    with sqlite3.connect(store.file()) as base:
        base.execute("UPDATE sets SET content = ? WHERE name = ?", (bytes(content), name))


def test_what_is_kept_is_loaded(place):
    assert store.load(["one"]) == {}
    store.keep({"one": VALUES, "two": VALUES[:1]})
    found = store.load(["one", "three", "two"])
    assert list(found) == ["one", "two"]
    for array, value in zip(found["one"], VALUES, strict=True):
        np.testing.assert_array_equal(array, value)


@settings(max_examples=int(os.environ.get("VISAUG_EXAMPLES", "200")), deadline=None)
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7), cut=st.booleans())
def test_a_flipped_bit_or_a_cut_makes_an_entry_absent(tmp_path_factory, where, bit, cut):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VISAUG_CACHE", str(tmp_path_factory.getbasetemp() / "damage"))
        store.keep({"one": VALUES})
        content = bytearray(store._packed("one", VALUES))
        at = int(where * len(content))
        if cut:
            del content[at:]
        else:
            content[at] ^= 1 << bit
        changed("one", content)
        assert loaded("one") is None
        store.keep({"one": VALUES})
        assert loaded("one") is not None


class Evil:
    def __reduce__(self):
        return os.mkdir, ("evil",)


def test_an_entry_with_any_content_and_the_right_checksum_runs_no_code(place, monkeypatch):
    monkeypatch.chdir(place)
    store.keep({"one": VALUES})
    lengths = np.array([2, 10**15, -3], "<i8").tobytes()
    for content in (b"", b"123", pickle.dumps(Evil()), lengths):
        changed("one", store._check("one", content) + content)
        assert loaded("one") is None
    assert not (place / "evil").exists()


def test_an_entry_under_another_name_is_none(place):
    store.keep({"one": VALUES})
    with sqlite3.connect(store.file()) as base:
        base.execute("UPDATE sets SET name = 'two'")
    assert loaded("two") is None


@pytest.mark.parametrize("damage", [b"", b"no database at all" * 100, None])
def test_a_damaged_file_is_made_anew(place, damage):
    store.keep({f"n{i}": [np.full(5000, 1.0)] for i in range(10)})
    whole = store.file().read_bytes()
    store.file().write_bytes(whole[: len(whole) // 2] if damage is None else damage)
    for name in ("n0", "n9"):
        assert loaded(name) is None or (loaded(name)[0] == 1.0).all()
    store.keep({"one": VALUES})
    store.keep({"one": VALUES})  # the first may have found the damage
    assert loaded("one") is not None


def test_what_was_not_used_for_longest_makes_room_and_other_files_stay(place, monkeypatch):
    monkeypatch.setattr(store, "MOST", 2500)
    store.file().parent.mkdir()
    foreign = [place / "frames.npz", store.file().parent / "mine.npz"]
    for path in foreign:
        path.write_bytes(b"x" * 5000)
    now = iter(range(1000))
    monkeypatch.setattr(store.time, "time", lambda: float(next(now)))
    store.keep({"first": [np.zeros(100)]})
    store.keep({"second": [np.zeros(100)]})
    assert loaded("first") is not None  # used now, so the second is the older
    store.keep({"third": [np.zeros(100)]})
    store.keep({"fourth": [np.zeros(100)]})
    assert "second" not in store.load(["first", "second", "third", "fourth"])
    assert loaded("fourth") is not None
    assert all(path.stat().st_size == 5000 for path in foreign)


def test_a_store_that_cannot_be_written_is_done_without(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path / "file"))
    store.keep({"one": VALUES})
    assert loaded("one") is None


WRITER = f"""
import runpy
import types
import numpy as np
store = types.SimpleNamespace(**runpy.run_path({store.__file__!r}))  # without what the package imports
store.load.__globals__["MOST"] = 20_000
for i in range(100):
    name, value = f"n{{i % 7}}", float(i % 7)
    kept = store.load([name]).get(name)
    assert kept is None or (kept[0] == value).all()
    store.keep({{name: [np.full(500, value)]}})
"""


def test_two_processes_share_a_store(place):
    running = [
        subprocess.Popen([sys.executable, "-c", WRITER], env=os.environ | {"VISAUG_CACHE": str(place)})
        for _ in "ab"
    ]
    assert [process.wait(120) for process in running] == [0, 0]
    assert any(store.load([f"n{i}" for i in range(7)]))


@pytest.mark.skipif(sys.platform != "linux", reason="mounts a tmpfs")
def test_a_full_disk_keeps_nothing_and_stops_nobody(tmp_path, monkeypatch):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", disk]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("cannot mount a file system")
    try:
        monkeypatch.setenv("VISAUG_CACHE", str(disk))
        store.keep({"large": [np.random.default_rng(1).random(40_000)]})
        assert loaded("large") is None
        store.keep({"one": VALUES})
        assert loaded("one") is not None
    finally:
        subprocess.run(["umount", disk], check=True)
