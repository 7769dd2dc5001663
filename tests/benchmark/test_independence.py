"""The camera that visaug is judged on shares no code with visaug."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BENCHMARK = ROOT / "benchmark"
OF_A_USER = {BENCHMARK / "user_effects.py"}
FILES = sorted(set(BENCHMARK.glob("**/*.py")) - OF_A_USER)
ALLOWED = set(sys.stdlib_module_names) | {"numpy", "scipy", "PIL", "benchmark"}
OTHERS = {"getframes_sets.py": {"getframes"}, "pyxel_sets.py": {"pyxel"}}  # cameras of other authors


def imported(tree: ast.AST) -> set[str]:
    """Top-level names of every import, wherever in the file it stands."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add((node.module or "").split(".")[0])
    return names


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_imports_numpy_scipy_and_itself_only(path):
    tree = ast.parse(path.read_text())
    assert imported(tree) <= ALLOWED | OTHERS.get(path.name, set())
    calls = {
        node.func.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    assert not calls & {"__import__", "exec", "eval"}
    assert "importlib" not in imported(tree)


def test_scan_sees_every_kind_of_import():
    code = "import visaug.effects as e\ndef f():\n    from visaug import camera\n"
    assert imported(ast.parse(code)) == {"visaug"}


def test_nothing_of_visaug_is_loaded():
    code = (
        "import sys, benchmark.commands\n"
        "print([name for name in sys.modules if name.split('.')[0] in ('visaug', 'visaug_train', 'torch')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"
