"""Whether the tests notice wrong laws: each mutation changes one line of a copy of the tree, and the tests named for it must fail.

    python scripts/mutations.py                        # all of scripts/mutations.yaml, on from where an earlier run stopped
    python scripts/mutations.py --only statistics      # those whose file, old or new text contains "statistics"

Results are kept in .cache/mutations/ and hold as long as neither the package, the tests named nor the mutation changes. The exit
status is 1 if more than 5 % survive, or if a mutation could not be tried: its text is gone, its tests fail without it, or it
breaks more than a law (pytest ends with an error and not with failed tests).
"""

import argparse
import hashlib
import importlib
import json
import multiprocessing
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
TABLE = Path(__file__).with_suffix(".yaml")
RESULTS = ROOT / ".cache" / "mutations"
COPIED = (
    "visaug",
    "train",
    "benchmark",
    "configs",
    "tests",
    "scripts",
    "docs",
    "typings",
    "pyproject.toml",
    "README.md",
)
MOST_SURVIVORS = 0.05  # share of the mutations tried
PRELOADED = (
    "torch",
    "numba",
    "scipy.stats",
    "scipy.optimize",
    "matplotlib.figure",
    "pydantic",
    "hypothesis",
    "click",
    "rich",
)
PATIENCE_S = 1800  # after which the tests are stopped
KILLED, SURVIVED, BROKEN = "killed", "survived", "broken"
FAILED = 1  # pytest's exit status where tests ran and some failed


@dataclass(frozen=True)
class Mutation:
    """One change of a law.

    Attributes:
        file: of the package, from the root.
        old, new: text that stands once in the file, and what replaces it.
        tests: arguments of pytest.
    """

    file: str
    old: str
    new: str
    tests: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.file}: {' '.join(self.old.split())}  ->  {' '.join(self.new.split())}"

    def applied(self, text: str) -> str:
        if text.count(self.old) != 1:
            raise ValueError(f"the old text stands {text.count(self.old)} times in the file")
        return text.replace(self.old, self.new)

    def key(self) -> str:
        """Of the mutation and of the files that decide what becomes of it."""
        named = [word for word in self.tests if word.startswith("tests/")]
        files = [*sorted((ROOT / "visaug").rglob("*.py")), *(ROOT / word.split("::")[0] for word in named)]
        digest = hashlib.blake2b(repr(self).encode(), digest_size=12)
        for file in files:
            digest.update(file.read_bytes())
        return digest.hexdigest()


def table() -> list[Mutation]:
    """All mutations of scripts/mutations.yaml."""
    entries = yaml.safe_load(TABLE.read_text())
    return [
        Mutation(entry["file"], old, new, tuple(shlex.split(entry["tests"])))
        for entry in entries
        for old, new in entry["changes"]
    ]


def copy_tree(folder: Path) -> None:
    """What the tests need; without `__pycache__`, since a stale one could hide a mutation of the same second and size."""
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            left_out = shutil.ignore_patterns("__pycache__")
            shutil.copytree(source, folder / name, symlinks=True, ignore=left_out)
        else:
            shutil.copy2(source, folder / name)
    compiled = [
        sys.executable,
        "-m",
        "compileall",
        "-q",
        "--invalidation-mode",
        "checked-hash",
        "visaug",
        "tests",
    ]
    subprocess.run(compiled, cwd=folder, check=True)


def pytest_status(folder: Path, tests: tuple[str, ...]) -> int | None:
    """Exit status; None where the tests did not end in time. A fork has what `preload` imported."""
    process = multiprocessing.get_context("fork").Process(target=_run_pytest, args=(folder, tests))
    process.start()
    process.join(PATIENCE_S)
    if process.is_alive():
        process.kill()
        process.join()
        return None
    return process.exitcode


def _run_pytest(folder: Path, tests: tuple[str, ...]) -> None:
    os.chdir(folder)
    here = [str(folder), str(folder / "typings")]
    os.environ |= {"PYTHONPATH": os.pathsep.join(here), "VISAUG_CACHE": str(folder / "cache")}
    os.environ["PYTHONDONTWRITEBYTECODE"], sys.dont_write_bytecode = "1", True
    sys.path[:] = here + [
        entry for entry in sys.path if not Path(entry).is_relative_to(ROOT) or ".venv" in entry
    ]
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    sys.exit(int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *tests])))


def preload() -> None:
    """Imports what most tests need of other packages and nothing of visaug, which each fork imports from its copy."""
    for name in PRELOADED:
        importlib.import_module(name)


def outcome(folder: Path, mutation: Mutation, sound: dict[tuple[str, ...], bool]) -> str:
    """What becomes of a mutation in the copied tree, which is restored afterwards."""
    place = folder / mutation.file
    text = place.read_text()
    try:
        changed = mutation.applied(text)
    except ValueError as error:
        print(f"  {error}")
        return BROKEN
    try:
        place.write_text(changed)
        status = pytest_status(folder, mutation.tests)
    finally:
        place.write_text(text)
    if status == 0:
        return SURVIVED
    if mutation.tests not in sound:
        sound[mutation.tests] = pytest_status(folder, mutation.tests) == 0
    return KILLED if status == FAILED and sound[mutation.tests] else BROKEN


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", metavar="PATTERN", help="mutations that contain this text")
    asked = parser.parse_args().only
    chosen = [mutation for mutation in table() if asked in str(mutation)]
    preload()
    RESULTS.mkdir(parents=True, exist_ok=True)
    counts: Counter[str] = Counter()
    sound: dict[tuple[str, ...], bool] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copy_tree(folder)
        for i, mutation in enumerate(chosen):
            kept = RESULTS / f"{mutation.key()}.json"
            start = time.monotonic()
            if kept.is_file():
                result = json.loads(kept.read_text())["outcome"]
            else:
                result = outcome(folder, mutation, sound)
                scratch = kept.with_suffix(".partial")
                scratch.write_text(json.dumps({"outcome": result, "mutation": str(mutation)}))
                scratch.replace(kept)
            counts[result] += 1
            print(
                f"{i + 1}/{len(chosen)} {result:9}{time.monotonic() - start:6.0f} s  {mutation}", flush=True
            )
    tried = counts[KILLED] + counts[SURVIVED]
    print(
        f"{tried} tried: {counts[KILLED]} killed, {counts[SURVIVED]} survived; {counts[BROKEN]} could not be tried"
    )
    return int(counts[BROKEN] > 0 or counts[SURVIVED] > MOST_SURVIVORS * tried)


if __name__ == "__main__":
    sys.exit(main())
