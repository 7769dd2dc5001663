"""Let the program answer, keep what it says, and count."""

from __future__ import annotations

import fnmatch
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle, islice
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np


def beside(folder: Path, what: str) -> Path:
    """The folder of answers or results that belongs to a folder of sets."""
    return folder.parent / f"{folder.name}_{what}"


def run_all(
    folder: Path,
    match: str,
    effects_file: Path | None,
    limit_s: float,
    workers: int = 1,
    until_s: float = np.inf,
) -> None:
    """Diagnose each set without a result, `workers` beside each other with a core each, in a fixed random order.

    A failure is kept too, with what the program said. Delete it to try again. No set is begun after `until_s` seconds.
    """
    began = time.monotonic()
    results = beside(folder, "results")
    results.mkdir(parents=True, exist_ok=True)
    names = sorted(file.stem for file in beside(folder, "answers").glob("*.json"))
    random.Random(0).shuffle(names)
    left = [n for n in names if fnmatch.fnmatch(n, match) and not (results / f"{n}.json").exists()]
    cores = SimpleQueue[int]()
    for core in islice(cycle(sorted(os.sched_getaffinity(0))), workers):
        cores.put(core)

    def own_core() -> None:
        if workers > 1:
            os.sched_setaffinity(0, {cores.get()})  # of this thread, and of what it starts

    def run_one(identity: str) -> None:
        if time.monotonic() - began < until_s:
            _run(folder, identity, effects_file, limit_s)

    with ThreadPoolExecutor(workers, initializer=own_core) as pool:
        list(pool.map(run_one, left))


def _run(folder: Path, identity: str, effects_file: Path | None, limit_s: float) -> None:
    results = beside(folder, "results")
    answer = json.loads((beside(folder, "answers") / f"{identity}.json").read_text())
    report = results / f"{identity}.diagnosis.tmp"
    command = [sys.executable, "-m", "visaug", "diagnose", str(folder / identity)]
    command += ["--camera", str(folder / identity / "camera.yaml"), "--json", str(report), "--seed", "0"]
    if answer["without"]:
        command += ["--without", answer["without"]]
    if effects_file:
        command += ["--effects", str(effects_file)]
    start = time.monotonic()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s)
        status, said = done.returncode, (done.stdout + done.stderr)[-2000:]
    except subprocess.TimeoutExpired:
        status, said = 124, f"no answer in {limit_s:g} s"
    seconds = round(time.monotonic() - start, 1)
    diagnosis = json.loads(report.read_text()) if status == 0 and report.exists() else None
    report.unlink(missing_ok=True)
    kept = {
        "status": status,
        "seconds": seconds,
        "said": said if status else "",
        "diagnosis": diagnosis,
        "effects": effects_file and effects_file.name,
    }
    (results / f"{identity}.json").write_text(json.dumps(kept))
    told = diagnosis["accepted"] if diagnosis else f"status {status}"
    print(f"{identity}: {told} in {seconds} s", flush=True)


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """95 % interval of a proportion (Wilson 1927)."""
    if trials == 0:
        return 0.0, 1.0
    z, share = 1.959964, successes / trials
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    return max(0.0, middle - half), min(1.0, middle + half)


def verdict(answer: dict[str, Any], result: dict[str, Any], usual: Sequence[str] = ()) -> dict[str, Any]:
    """Judge one diagnosis; `usual` holds names that a real camera has anyway.

    right: exactly the expected names. Where the effect is in no catalogue: "unexplained", with the clearest axis
    and the growth as expected; where it hides beside a known one, that one's name and "unexplained".
    wrong: a name that should not be there, told without reservation. A mistake in the camera file is right where it alone is told.
    """
    diagnosis = result["diagnosis"]
    if diagnosis is None:
        return {"right": False, "wrong": False, "after": None, "axis": False, "failed": True}
    accepted, expected = set(diagnosis["accepted"]) - set(usual), set(answer["expect"])
    unexplained = diagnosis["unexplained"]
    told_axis = (unexplained or {}).get("axis") or []
    told_growth = set((unexplained or {}).get("grows_with") or [])
    growth = set(answer["grows"]) <= told_growth <= set(answer["grows"]) | set(answer["may_grow"])
    axis = told_axis[:1] != [] and told_axis[0] in answer["axis"] and growth  # the clearest is told first
    in_no_catalogue = answer["kind"] == "foreign" or (answer.get("hidden") and not answer["expect"])
    mistakes = [(m["key"], m["mistake"]) for m in diagnosis.get("camera_file", [])]
    outside = bool(answer["without"]) or (in_no_catalogue and not result.get("effects"))
    if outside:
        right, wrong = unexplained is not None and axis, bool(accepted) and unexplained is None
    else:
        right, wrong = accepted == expected - set(usual), bool(accepted - expected)
        right = right and (answer["kind"] != "mixed" or unexplained is not None)
    if answer.get("mistake"):
        right = right and names_mistake(answer["mistake"], mistakes)
    else:
        wrong = wrong or bool(mistakes)
    return {
        "right": right,
        "wrong": wrong,
        "after": (diagnosis.get("error") or {}).get("after"),
        "axis": axis,
        "failed": False,
    }


def names_mistake(mistake: Sequence[str], named: Sequence[tuple[str, str]]) -> bool:
    """Whether a mistake (key, kind) is among those named, and all others are in the same part of the file."""
    part = mistake[0].split(".")[0]
    return tuple(mistake) in named and all(key.split(".")[0] == part for key, _ in named)


def answered(folders: Iterable[Path]) -> list[tuple[Path, dict[str, Any], dict[str, Any]]]:
    """Folder, answer and result of each set that has a result."""
    return [
        (
            folder,
            json.loads((beside(folder, "answers") / kept.name).read_text()),
            json.loads(kept.read_text()),
        )
        for folder in folders
        for kept in sorted(beside(folder, "results").glob("*.json"))
    ]


def _usual(folder: Path, answer: dict[str, Any]) -> list[str]:
    """What the program finds in the untouched frames of the real camera."""
    if answer["kind"] != "real" or not answer["hidden"]:
        return []
    untouched = beside(folder, "results") / f"real-nothing-{answer['seed']}.json"
    diagnosis = json.loads(untouched.read_text())["diagnosis"] if untouched.exists() else None
    return diagnosis["accepted"] if diagnosis else []


def share(hits: int, of: int) -> str:
    low, high = wilson(hits, of)
    return f"{hits}/{of} ({100 * low:.0f}-{100 * high:.0f} %)"


def _row(label: str, judged: list[dict[str, Any]], seconds: Iterable[float]) -> str:
    after = [j["after"] for j in judged if j["after"] is not None]
    error = f"{np.median(after):.2f} / {np.percentile(after, 90):.2f}" if after else "-"
    n = len(judged)
    counts = [sum(bool(j[key]) for j in judged) for key in ("right", "wrong", "axis", "failed")]
    time_s = np.median(list(seconds) or [0])
    cells = [label, share(counts[0], n), counts[1], error, counts[2], counts[3], f"{time_s:.0f}"]
    return "| " + " | ".join(map(str, cells)) + " |"


def report(folders: list[Path]) -> str:
    """Markdown: for each kind and strength a pooled line and one for each effect."""
    groups: dict[tuple[str, str], dict[str, list[tuple[dict[str, Any], float]]]] = {}
    for folder, answer, result in answered(folders):
        label = " + ".join(answer["expect"]) or "nothing"
        judged = verdict(answer, result, _usual(folder, answer))
        group = groups.setdefault((answer["kind"], answer["strength"]), {})
        group.setdefault(label, []).append((judged, result["seconds"]))
    lines: list[str] = []
    for (kind, strength), by_label in sorted(groups.items()):
        lines += [f"### {kind}, {strength}", ""]
        lines += [
            "| hidden | right (95 %) | wrong name | error after: median / 90 % | axis, growth | failed | s |"
        ]
        lines += ["| --- | --- | --- | --- | --- | --- | --- |"]
        pooled = [pair for pairs in by_label.values() for pair in pairs]
        lines.append(_row("**all**", [p[0] for p in pooled], [p[1] for p in pooled]))
        for label, pairs in sorted(by_label.items()) if kind != "pairs" else []:
            lines.append(_row(label, [p[0] for p in pairs], [p[1] for p in pairs]))
        lines.append("")
    return "\n".join(lines)
