"""The journal of `visaug augment` believes only what it wrote, and keeps what others wrote."""

import json

import pytest

from visaug.augment.journal import JOURNAL, Journal
from visaug.core.errors import InputError


@pytest.fixture
def folder(tmp_path):
    """A folder with a copy that is done."""
    folder = tmp_path / "out"
    with Journal(folder) as journal:
        journal.begin("a.png")
        (folder / "a.png").write_bytes(b"the copy")
        journal.add("a.png", "of these settings")
    return folder


def holds(folder, of="of these settings"):
    with Journal(folder) as journal:
        return journal.holds("a.png", of)


def test_a_copy_of_the_same_is_held(folder):
    assert holds(folder)
    assert not holds(folder, "of others")
    assert holds(folder)
    (folder / "a.png").unlink()
    (folder / "a.png").mkdir()
    assert not holds(folder)


@pytest.mark.parametrize("content", [b"the cOpy", b"the", b""])
def test_a_copy_that_was_changed_is_not_held(folder, content):
    (folder / "a.png").write_bytes(content)
    assert not holds(folder)


def test_a_copy_of_another_size_is_not_read(folder, monkeypatch):
    (folder / "a.png").write_bytes(b"the")
    monkeypatch.setattr("visaug.augment.journal.content_of", None)
    assert not holds(folder)


def test_a_folder_in_the_place_of_a_copy_is_one_clear_line(folder):
    (folder / "a.png").unlink()
    (folder / "a.png").mkdir()
    with Journal(folder) as journal, pytest.raises(InputError, match="was changed since"):
        journal.begin("a.png")


def test_a_journal_without_sizes_is_believed(folder):
    """As earlier versions wrote it."""
    path = folder / JOURNAL
    lines = [json.loads(line) for line in path.read_text().splitlines() if line]
    path.write_text(
        "".join(json.dumps({k: line[k] for k in ("name", "of", "copy")}) + "\n" for line in lines)
    )
    assert holds(folder)
    (folder / "a.png").write_bytes(b"the cOpy")
    assert not holds(folder)


def test_an_interrupted_copy_is_its_own_but_not_done(folder):
    with Journal(folder) as journal:
        journal.begin("a.png")
    assert not holds(folder)
    with Journal(folder) as journal:
        journal.check_new(["a.png"])
        journal.begin("a.png")


def test_what_another_program_wrote_is_not_replaced(folder):
    (folder / "b.png").write_bytes(b"foreign")
    with Journal(folder) as journal:
        with pytest.raises(InputError, match=r"b\.png: exists, and visaug did not write it"):
            journal.check_new(["a.png", "b.png"])
        with pytest.raises(InputError, match="did not write it"):
            journal.begin("b.png")
    (folder / "a.png").write_bytes(b"the cOpy")  # of the same size
    with Journal(folder) as journal, pytest.raises(InputError, match="was changed since"):
        journal.begin("a.png")
    with Journal(folder, force=True) as journal:
        journal.check_new(["b.png"])
        journal.begin("a.png")


@pytest.mark.parametrize(
    "line", [b"5", b"{}", b"\xff\xfe", b"[" * 9000, b'{"name": [], "of": 1}', b'{"name": "a.png"', b"null"]
)
def test_a_line_that_is_no_entry_is_passed_over(folder, line):
    path = folder / JOURNAL
    path.write_bytes(path.read_bytes() + b"\n" + line + b"\n")
    assert holds(folder)


def test_a_link_in_the_place_of_the_journal_is_refused(folder, tmp_path):
    (tmp_path / "other").write_text("kept")
    (folder / JOURNAL).unlink()
    (folder / JOURNAL).symlink_to(tmp_path / "other")
    with pytest.raises(InputError, match="link"):
        holds(folder)
    assert (tmp_path / "other").read_text() == "kept"


def test_two_runs_into_one_folder_are_refused(folder):
    with Journal(folder), pytest.raises(InputError, match="another"):
        holds(folder)
    assert holds(folder)
