"""What the documentation shows runs: Python blocks are executed, options of commands exist."""

import re
import shlex
from pathlib import Path

import click
import numpy as np
import pytest
from PIL import Image

import visaug.augment
import visaug.characterization
import visaug.diagnosis
import visaug.effects
import visaug.frames
from visaug.app.cli.root import program

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs/reference").glob("*.md")),
]
BLOCK = re.compile(r"(<!-- not run[^>]*-->\s*)?^```(\w+)[^\n]*\n(.*?)^```", re.M | re.S)
EXAMPLE = ROOT / "visaug/data/hidden_effect"


def blocks(page: Path, language: str) -> list[str]:
    """The blocks of a page in one language, without those that are marked as not run."""
    return [
        code for skipped, word, code in BLOCK.findall(page.read_text()) if word == language and not skipped
    ]


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A folder with what the pages take for granted: photos/, frames/, camera.yaml."""
    (tmp_path / "photos").mkdir()
    picture = np.linspace(0, 255, 48 * 64 * 3).reshape(48, 64, 3).astype(np.uint8)
    for name in ("a.png", "b.jpg"):
        Image.fromarray(picture).save(tmp_path / "photos" / name)
    Image.fromarray(picture).save(tmp_path / "photo.png")
    (tmp_path / "visaug").symlink_to(ROOT / "visaug")
    (tmp_path / "frames").symlink_to(EXAMPLE)
    (tmp_path / "camera.yaml").write_text((EXAMPLE / "camera.yaml").read_text())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python")], ids=lambda p: p.stem)
def test_python_runs(page, desk):
    names: dict = {}
    for code in blocks(page, "python"):
        exec(compile(code, str(page), "exec"), names)


def commands(page: Path) -> list[list[str]]:
    text = "\n".join(code for _, word, code in BLOCK.findall(page.read_text()) if word in ("bash", "sh"))
    lines = text.replace("\\\n", " ").splitlines()
    words = [shlex.split(line, comments=True) for line in lines if line.strip()]
    return [w[1:] for w in words if w and w[0].endswith("visaug")]


@pytest.mark.parametrize("page", [p for p in PAGES if commands(p)], ids=lambda p: p.stem)
def test_commands_and_options_exist(page):
    for words in commands(page):
        command: click.Command = program
        while isinstance(command, click.Group) and words and words[0] in command.commands:
            command = command.commands[words.pop(0)]
        assert command is not program, f"{page.name}: no such command: visaug {' '.join(words)}"
        known = {name for parameter in command.params for name in parameter.opts} | {"--help", "-h"}
        given = {word.split("=")[0] for word in words if re.fullmatch(r"--?[a-z][\w-]*(=.*)?", word)}
        assert given <= known, f"{page.name}: visaug {command.name} has no {', '.join(given - known)}"


PUBLIC = [visaug, visaug.augment, visaug.characterization, visaug.diagnosis, visaug.effects, visaug.frames]


@pytest.mark.parametrize("module", PUBLIC, ids=lambda module: module.__name__)
def test_every_public_name_is_in_the_reference(module):
    shown = {
        line.split(".")[-1]
        for page in (ROOT / "docs/reference").glob("*.md")
        for line in page.read_text().splitlines()
        if line.startswith("::: ")
    }
    public = {name for name in module.__all__ if not name.isupper() and not name.startswith("__")}
    assert public - shown == set()
    undocumented = [name for name in sorted(public) if not (getattr(module, name).__doc__ or "").strip()]
    assert undocumented == []


COMMIT = re.compile(r"\b(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}\b")


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))], ids=lambda p: p.stem
)
def test_names_no_commit(page):
    assert COMMIT.findall(page.read_text()) == []


def test_commits_are_recognised():
    assert COMMIT.findall("since 4bfd655 and b479d4b1, not 1234567 or 0.2.0 or 1e-07") == [
        "4bfd655",
        "b479d4b1",
    ]


def test_every_effect_has_a_page_and_the_readme_counts_them():
    # other tests may have loaded effects of their own
    effects = {n: e for n, e in visaug.effects.catalogue().items() if e.__module__.startswith("visaug.")}
    pages = {path.stem for path in (ROOT / "docs/effects").glob("*.md")}
    assert pages == {*effects, "index"}
    further = sum(not effect.base for effect in effects.values())
    said = (
        f"{len(effects)} effects: {len(effects) - further} terms of the base chain and {further} further ones"
    )
    assert said in " ".join((ROOT / "README.md").read_text().split())
