"""Files appear whole or not at all."""

import errno
import json
import os
import signal
import subprocess
import sys

import pytest

from visaug.core import files
from visaug.core.errors import InputError
from visaug.core.files import folder_lock, whole_file, whole_folder, write_json, write_text


def test_a_broken_write_leaves_nothing(tmp_path):
    target = tmp_path / "inner" / "a.json"
    with pytest.raises(RuntimeError, match="stop"), whole_file(target) as temporary:
        temporary.write_text("half")
        raise RuntimeError("stop")
    assert list(target.parent.iterdir()) == []


def test_a_broken_write_keeps_the_old_file(tmp_path):
    target = tmp_path / "a.json"
    write_json(target, {"a": 1})
    with pytest.raises(ValueError, match="JSON"):
        write_json(target, {"a": float("nan")})
    assert json.loads(target.read_text()) == {"a": 1}
    assert list(tmp_path.iterdir()) == [target]


def test_permissions_are_those_of_any_new_file(tmp_path):
    write_text(tmp_path / "ours", "x")
    (tmp_path / "plain").write_text("x")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_folder_appears_whole(tmp_path):
    place = tmp_path / "inner" / "out"
    with pytest.raises(RuntimeError), whole_folder(place) as temporary:
        (temporary / "a").write_text("half")
        raise RuntimeError
    assert list(place.parent.iterdir()) == []
    with whole_folder(place) as temporary:
        (temporary / "a").write_text("one")
    with pytest.raises(InputError, match="not empty"), whole_folder(place):
        pass
    with whole_folder(place, overwrite=True) as temporary:
        (temporary / "b").write_text("two")
    assert [file.name for file in place.iterdir()] == ["b"]
    assert list(place.parent.iterdir()) == [place]


DIES = """
import os, signal, sys
from visaug.core import files
if sys.argv[1] == "file":
    with files.whole_file(sys.argv[2]) as half:
        half.write_text("half")
        os.kill(os.getpid(), signal.SIGKILL)
with files.whole_folder(sys.argv[2], overwrite=True) as half:
    (half / "half").touch()
    if sys.argv[1] == "folder":
        os.kill(os.getpid(), signal.SIGKILL)
    files._flush = lambda _: None
    files.Path.replace = files.Path.rename = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
    if sys.argv[1] == "between":
        os.rename(sys.argv[2], files.Path(sys.argv[2]).parent / (files._OLD + files.Path(sys.argv[2]).name))
"""


@pytest.mark.parametrize("moment", ["file", "folder", "between"])
def test_what_a_kill_left_goes_with_the_next_run_and_nothing_is_lost(tmp_path, moment):
    place = tmp_path / "out"
    if moment != "file":
        place.mkdir()
        (place / "mine").write_text("mine")
    died = subprocess.run([sys.executable, "-c", DIES, moment, str(place)], check=False)
    assert died.returncode == -signal.SIGKILL
    assert len(list(tmp_path.glob(".visaug-*"))) >= 1
    if moment == "file":
        write_text(place, "whole")
        assert place.read_text() == "whole"
    else:
        with pytest.raises(InputError, match="not empty"), whole_folder(place):
            pass
        assert (place / "mine").read_text() == "mine"
    assert list(tmp_path.iterdir()) == [place]


def test_what_others_are_writing_stays(tmp_path):
    others = [
        tmp_path / f".visaug-half-{host}-{pid}-x"
        for host, pid in (("00000000", 4), (files._HOST, os.getpid()))
    ]
    for other in others:
        other.touch()
    write_text(tmp_path / "a", "a")
    assert sorted(tmp_path.iterdir()) == sorted([*others, tmp_path / "a"])


def test_a_locked_folder_is_refused_and_free_again_after(tmp_path):
    refused = pytest.raises(InputError, match="another visaug command")
    with folder_lock(tmp_path / "out"), refused, folder_lock(tmp_path / "out"):
        pass
    with folder_lock(tmp_path / "out"):
        pass


def test_a_file_is_no_folder_to_write_into(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="out: is a file; expected a folder"), folder_lock(tmp_path / "out"):
        pass


def test_a_place_where_no_file_can_be_is_told(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    for place, said in (("folder", "folder: is a folder"), ("file/below/a.json", "file: is a file")):
        with pytest.raises(InputError) as told:
            write_text(tmp_path / place, "x")
        assert str(told.value).startswith(f"{tmp_path}/{said}")
    for make in (whole_folder, folder_lock):
        with (
            pytest.raises(InputError, match="file: is a file; expected a folder"),
            make(tmp_path / "file" / "x"),
        ):
            pass
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


def test_a_link_stays_a_link_and_a_pipe_gets_the_content(tmp_path):
    """What a link leads to is replaced; a file in the place of a pipe would leave its reader waiting."""
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "a.txt").write_text("old")
    (tmp_path / "a.txt").symlink_to("real/a.txt")
    write_text(tmp_path / "a.txt", "new")
    assert (tmp_path / "a.txt").is_symlink()
    assert (tmp_path / "real" / "a.txt").read_text() == "new"
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_text(pipe, "content")
    assert os.read(reader, 100) == b"content"
    os.close(reader)
    assert pipe.is_fifo()
    assert {path.name for path in tmp_path.iterdir()} == {"real", "a.txt", "pipe"}


def test_a_read_only_folder_is_refused_before_any_work(tmp_path, monkeypatch):
    """For the superuser, who may run the tests, no folder is."""
    (tmp_path / "ours").mkdir()
    monkeypatch.setattr(files.os, "access", lambda path, _: str(path) not in (str(tmp_path), "/dev"))
    for make in (
        lambda: files.check_place(tmp_path / "new" / "a.json"),
        lambda: files.check_folder(tmp_path / "ours"),
        lambda: write_text(tmp_path / "a.json", "x"),
        lambda: whole_folder(tmp_path / "new").__enter__(),
        lambda: folder_lock(tmp_path / "new" / "below").__enter__(),
    ):
        with pytest.raises(InputError) as told:
            make()
        expected = f"{tmp_path}: is read-only; expected a folder that you may write to"
        assert str(told.value) == expected
    assert [path.name for path in tmp_path.iterdir()] == ["ours"]
    write_text(tmp_path / "ours" / "a.json", "x")
    files.check_place(files.Path("/dev/null"))  # is written to where it is


def test_an_error_of_the_system_names_what_was_to_be_written(tmp_path):
    """And not the temporary file, of which a user knows nothing."""
    for make in (whole_file, whole_folder):
        place = tmp_path / "out"
        with pytest.raises(OSError, match="No space left") as told, make(place) as half:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(half))
        assert told.value.filename == str(place)
        with pytest.raises(OSError, match="mine"), make(place):
            raise OSError(errno.ENOENT, "no such file", "mine")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="has no /proc")
def test_a_place_that_only_the_system_refuses_is_named():
    with pytest.raises(OSError, match="x") as told:
        write_text("/proc/visaug.txt", "x")
    assert told.value.filename == "/proc/visaug.txt"


@pytest.mark.parametrize(
    ("content", "ours"),
    [
        ("", True),
        ('{"schema": 1, "answer": "nothing"}', True),
        ('{"warnings": ["no_sensor_noise: none"]}', True),
        ('{"schema": 1}', False),
        ('{"schema": 2, "parameters": {}}', False),
        ('{"warnings": [], "rows": 3}', False),
        ("{}", False),
        ("row,column\n", False),
        ("<svg><dc:title>visaug</dc:title></svg>", True),
        ("<svg></svg>", False),
    ],
)
def test_results_are_known_by_what_they_hold(tmp_path, content, ours):
    (tmp_path / "file").write_text(content)
    assert files.is_result(tmp_path / "file") == ours


@pytest.mark.parametrize("held", ["shell", "mount"])
def test_a_folder_that_is_held_stays(tmp_path, monkeypatch, held):
    """A shell in a folder that was replaced would see an empty one, and a mounted one cannot be renamed."""
    place = tmp_path / "out"
    (place / "below").mkdir(parents=True)
    if held == "shell":
        monkeypatch.chdir(place / "below")
    else:
        monkeypatch.setattr(files.os.path, "ismount", lambda path: str(path) == str(place))
    before = place.stat().st_ino
    with pytest.raises(InputError, match="not empty"), whole_folder(place):
        pass
    with pytest.raises(RuntimeError), whole_folder(place, overwrite=True) as temporary:
        (temporary / "a").write_text("half")
        raise RuntimeError
    assert [file.name for file in place.iterdir()] == ["below"]
    (place / "below" / "old").touch()
    (place / "stale").touch()
    (place / "a").write_text("old")
    with whole_folder(place, overwrite=True) as temporary:
        (temporary / "a").write_text("new")
        (temporary / "below").mkdir()
        (temporary / "below" / "b").touch()
    assert sorted(str(file.relative_to(place)) for file in place.rglob("*")) == ["a", "below", "below/b"]
    assert (place / "a").read_text() == "new"
    assert place.stat().st_ino == before
    assert [file.name for file in tmp_path.iterdir()] == ["out"]
