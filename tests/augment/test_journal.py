"""The journal of `visaug augment` believes only what it wrote, and only of files that are as it left them."""

import pytest

from visaug.augment.journal import JOURNAL, Journal
from visaug.core.errors import InputError

SETTINGS = {"camera": "x", "seed": 3}


@pytest.fixture
def made(tmp_path):
    """A folder with a copy that is done: (folder, original)."""
    source, folder = tmp_path / "a.png", tmp_path / "out"
    source.write_bytes(b"original")
    with Journal(folder, SETTINGS) as journal:
        (folder / "a.png").write_bytes(b"the copy")
        journal.add("a.png", source)
    return folder, source


def holds(folder, source, settings=SETTINGS):
    with Journal(folder, settings) as journal:
        return journal.holds("a.png", source)


def test_a_copy_that_is_whole_is_held(made):
    assert holds(*made)
    assert holds(*made)
    assert not holds(*made, {"camera": "x", "seed": 4})
    assert not holds(*made)  # the other settings started the journal anew


@pytest.mark.parametrize("content", [b"", b"the cop", b"the bopy", b"the copy and more"])
def test_a_copy_that_was_changed_is_not(made, content):
    (made[0] / "a.png").write_bytes(content)
    assert not holds(*made)


def test_a_copy_that_is_gone_is_not(made):
    (made[0] / "a.png").unlink()
    (made[0] / "a.png").mkdir()
    assert not holds(*made)


@pytest.mark.parametrize(
    "line",
    [
        b"5",
        b"{}",
        b"\xff\xfe",
        b"[" * 9000,
        b'{"name": [], "original": 1, "copy": 2}',
        b'{"name": "a.png"',
        b"null",
    ],
)
def test_a_line_that_is_no_entry_is_passed_over(made, line):
    path = made[0] / JOURNAL
    path.write_bytes(path.read_bytes() + b"\n" + line + b"\n")
    assert holds(*made)


def test_a_link_in_the_place_of_the_journal_is_refused(made, tmp_path):
    (tmp_path / "other").write_text("kept")
    (made[0] / JOURNAL).unlink()
    (made[0] / JOURNAL).symlink_to(tmp_path / "other")
    with pytest.raises(InputError, match="link"):
        holds(*made)
    assert (tmp_path / "other").read_text() == "kept"


def test_two_runs_into_one_folder_are_refused(made):
    with Journal(made[0], SETTINGS), pytest.raises(InputError, match="another"):
        holds(*made, {"camera": "y"})
    assert holds(*made)
