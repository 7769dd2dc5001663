"""The table of wrong laws fits the package: scripts/nightly tries them."""

from pathlib import Path

import mutations
import pytest

TABLE = mutations.table()


def test_there_are_enough_and_each_is_of_its_own():
    assert len(set(TABLE)) == len(TABLE)
    assert len(TABLE) >= 60


@pytest.mark.parametrize("mutation", TABLE, ids=str)
def test_its_text_stands_once_in_its_file_and_its_tests_exist(mutation):
    text = (mutations.ROOT / mutation.file).read_text()
    compile(mutation.applied(text), mutation.file, "exec")
    assert [word for word in mutation.tests if word.startswith("tests/")]
    for word in mutation.tests:
        assert not word.startswith("tests/") or Path(mutations.ROOT / word).is_file()


def test_a_law_without_a_test_survives_and_one_with_a_test_is_killed(tmp_path):
    (tmp_path / "law.py").write_text("def square(x):\n    return x * x\n")
    for name, number in (("two", 2), ("three", 3)):  # 2 + 2 is 2 * 2
        (tmp_path / f"test_{name}.py").write_text(
            f"import law\n\ndef test():\n    assert law.square({number}) == {number**2}\n"
        )
    for tests, expected in (
        ("test_two.py", mutations.SURVIVED),
        ("test_three.py", mutations.KILLED),
        ("test_none.py", mutations.BROKEN),
    ):
        mutation = mutations.Mutation("law.py", "x * x", "x + x", (tests,))
        assert mutations.outcome(tmp_path, mutation, {}) == expected
        assert (tmp_path / "law.py").read_text() == "def square(x):\n    return x * x\n"
