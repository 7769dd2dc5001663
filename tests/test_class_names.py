"""A class name has one meaning."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]


def public_classes(*folders: Path) -> dict[str, list[str]]:
    """Name -> files that define a class of that name, for names that do not begin with an underscore."""
    found = defaultdict(list)
    for file in sorted(file for folder in folders for file in folder.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(file.name)
    return found


def test_every_public_class_name_stands_once():
    classes = public_classes(ROOT / "visaug", ROOT / "train")
    assert len(classes) > 100
    assert {name: files for name, files in classes.items() if len(files) > 1} == {}


def test_a_name_that_stands_twice_is_found(tmp_path):
    (tmp_path / "a.py").write_text("class Law: ...\nclass _Own: ...\n")
    (tmp_path / "b.py").write_text("def f():\n    class Law: ...\nclass _Own: ...\n")
    assert public_classes(tmp_path) == {"Law": ["a.py", "b.py"]}
