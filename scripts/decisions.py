"""Records what `diagnose` decides on small problems, with the evidence of every candidate, and counts decisions by the criterion.

    python -m scripts.decisions record RECORDS 100-399        (resumes; about a minute of a core each)
    python -m scripts.decisions further RECORDS 1-4 [--names dust,fringing]
    python -m scripts.decisions count RECORDS [--odds 3] [--share 0.55]

A problem is a set of 47 frames of 64 x 80 pixels by the benchmark's camera: one effect, two, none, one that is removed from
the catalogue, or one that no catalogue has, at 0.8 to 4 times the faint strength. `further` diagnoses the effects in
`benchmark/further.py`, one at a time and at typical strength, with frames that show them (`SHOWN_BY`). `--propose` adds effects
that a diagnosis does not try by itself. `count` applies the criterion with other constants to the recorded evidence
(`visaug/diagnosis/criterion.py`).
"""

import argparse
import pickle
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml

from benchmark import effects, foreign, further
from benchmark.camera import Sensor, Shot, take
from benchmark.commands import seeds_of
from benchmark.randomness import stream
from benchmark.sets import camera_yaml
from benchmark.small import CHART, PLAN, SENSOR, chart
from benchmark.strengths import TYPICAL, scaled
from scripts.processor import processor_s
from visaug import Camera, FrameSet
from visaug.characterization.alarms import alarms
from visaug.diagnosis import choice, criterion, search, stage
from visaug.diagnosis.criterion import Evidence
from visaug.diagnosis.state import State
from visaug.effects import catalogue
from visaug.frames import FrameRecord

KINDS = {"single": 0.45, "pair": 0.2, "clean": 0.1, "leave_out": 0.15, "foreign": 0.1}
CALIBRATED = 2  # the benchmark's camera whose faint strengths are taken
SETS = 120
FURTHER = {kind.name: kind for kind in further.KINDS}
# Frames that show an effect beyond the plan of a small set: other exposures of equal light, and flats beyond the full well.
SHOWN_BY = {
    "parasitic_light": [Shot("flat", t, 20.0, 9000.0) for t in (0.001, 0.1) for _ in range(4)],
    "saturation_nonuniformity": [Shot("flat", 0.01, 20.0, p) for p in (20000.0, 40000.0) for _ in range(3)],
}


@dataclass(frozen=True)
class Problem:
    seed: int
    kind: str
    sensor: Sensor
    hidden: tuple[tuple[str, float], ...]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.hidden)

    @property
    def expected(self) -> set[str]:
        return set(self.names) if self.kind in ("single", "pair", "further") else set()

    @property
    def plan(self) -> tuple[Shot, ...]:
        return (*PLAN, *CHART, *(shot for name in self.names for shot in SHOWN_BY.get(name, ())))


def any_sensor(rng: np.random.Generator) -> Sensor:
    """The small sensor with another read noise, conversion gain and quantum efficiency."""
    e_per_dn = float(rng.choice([0.7, 1.5, 2.4]))
    return replace(
        SENSOR, read_e=float(rng.uniform(2, 5)), e_per_dn=e_per_dn, efficiency=float(rng.uniform(0.4, 0.7)),
        bits=14 if e_per_dn < 1 else 12, well_e=9000.0 if e_per_dn < 2 else 8800.0,
    )  # fmt: skip


def problem(seed: int) -> Problem | None:
    """The problem of a seed; None where an effect cannot be made that strong."""
    rng = stream(seed, "decisions")
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    sensor = any_sensor(rng)
    known = [k.name for k in (foreign.KINDS if kind == "foreign" else effects.KINDS)]
    number = {"clean": 0, "pair": 2}.get(kind, 1)
    hidden = []
    for name in rng.choice(known, number, replace=False).tolist():
        faint = scaled(CALIBRATED, name, "default", "plain")
        if faint is None:
            return None
        hidden.append((name, faint * float(np.exp(rng.uniform(np.log(0.8), np.log(4))))))
    return Problem(seed, kind, sensor, tuple(hidden))


def further_problem(seed: int, name: str) -> Problem:
    """One effect of `benchmark/further.py`, at typical strength."""
    return Problem(seed, "further", any_sensor(stream(seed, "further", name)), ((name, TYPICAL[name]),))


def frames_of(one: Problem) -> FrameSet:
    kinds = effects.BY_NAME | {k.name: k for k in foreign.KINDS} | FURTHER
    hidden = effects.in_order([kinds[name].at(strength) for name, strength in one.hidden])
    plan, targets = one.plan, {"chart.npy": chart(one.sensor)}
    taken = take(one.sensor, plan, targets, one.seed, hidden)
    records = [
        FrameRecord(i, f"{i}.npy", s.kind, s.seconds, s.celsius, 0.0, s.photons, clean=s.target)
        for i, s in enumerate(plan)
    ]
    return FrameSet.from_arrays(records, list(taken), targets, bit_depth=one.sensor.bits)


class Recorder:
    """Keeps the evidence of each candidate of one diagnosis."""

    def __init__(self) -> None:
        self.steps: list[dict[str, Any]] = []

    @contextmanager
    def recording(self) -> Iterator[None]:
        decide, judge = search.accepted, choice._judged
        seen: list[choice.Judged] = []

        def judged(*arguments: Any) -> choice.Judged:
            seen.append(judge(*arguments))
            return seen[-1]

        def accepted(state: State, *arguments: Any) -> choice.Accepted | None:
            seen.clear()
            found = decide(state, *arguments)
            candidates = [
                {"effect": j.refined.effect, "gain": j.refined.gain, "evidence": j.evidence} for j in seen
            ]
            standing = (
                {j.refined.effect: o for j, o in zip(found.standing, found.odds, strict=True)}
                if found
                else {}
            )
            self.steps.append({"had": state.accepted, "standing": standing, "candidates": candidates})
            return found

        with patch.object(search, "accepted", accepted), patch.object(choice, "_judged", judged):
            yield


def propose(names: list[str]) -> None:
    """Makes a diagnosis try effects that it does not try by itself."""
    for name in names:
        catalogue()[name].proposed = True


def record(folder: Path, seeds: list[int]) -> None:
    for seed in seeds:
        one = problem(seed)
        if one is not None:
            record_one(folder / f"{seed}.pkl", one)


def record_further(folder: Path, seeds: list[int], names: list[str]) -> None:
    for seed in seeds:
        for name in names:
            record_one(folder / f"{name}-{seed}.pkl", further_problem(seed, name))


def record_one(file: Path, one: Problem) -> None:
    """Diagnoses a problem and keeps what was decided, with the evidence of every candidate; not again if the file is there."""
    if file.exists():
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    start = processor_s()
    camera, frames = Camera.load(yaml.safe_load(camera_yaml(one.sensor))), frames_of(one)
    # Of clean sets the search is made to go on, so that there are candidates to refuse.
    level = patch.object(stage, "SIGNIFICANT", 2.0 if one.kind == "clean" else stage.SIGNIFICANT)
    left_out = one.names if one.kind == "leave_out" else ()
    recorder = Recorder()
    with level, recorder.recording():
        found = search.diagnose(camera, frames, without=left_out, sets=SETS)
    kept = {
        "problem": one,
        "accepted": found.accepted,
        "steps": recorder.steps,
        "ambiguous": [pair["effects"] for pair in found.ambiguous],
        "unexplained": found.unexplained is not None,
        "p": (found.p_value_before, found.p_value_after),
        "ranking": [(entry.effect, entry.probability) for entry in found.ranking],
        "checks": [warning.partition(":")[0] for warning in alarms(frames)],
        "cpu_s": processor_s() - start,
    }
    partial = file.with_suffix(".partial")
    partial.write_bytes(pickle.dumps(kept))
    partial.rename(file)
    told = " ~ ".join("/".join(pair) for pair in kept["ambiguous"])
    rest = "unexplained" if kept["unexplained"] else ""
    checks = f"(checks: {', '.join(kept['checks'])})" if kept["checks"] else ""
    print(
        one.seed,
        one.kind,
        *one.names,
        "->",
        *found.accepted,
        told,
        rest,
        checks,
        f"{kept['cpu_s']:.0f} s",
        flush=True,
    )


def decisions(folder: Path, odds: float, share: float, rare: float) -> Iterator[tuple[str, str, str, float]]:
    """(kind, expected, decision, probability) for each step of each record, by the criterion with these constants.

    Expected is `effect` where a hidden effect is missing and was tried, `untried` where it was not tried, else `none`. A decision
    is `right`, `wrong` or `none`. The probability is that of the accepted effect among those that were accepted when recorded.
    """

    def passes(e: Evidence) -> bool:
        reached = float(np.mean(e.joint_of_sets <= e.joint))
        return e.odds > odds and (e.share >= share or reached > rare)

    for file in sorted(folder.rglob("*.pkl")):
        kept = pickle.loads(file.read_bytes())
        one: Problem = kept["problem"]
        for step in kept["steps"]:
            missing = one.expected - set(step["had"])
            told: dict[str, Evidence] = {}
            for c in sorted(step["candidates"], key=lambda c: (passes(c["evidence"]), c["evidence"].score)):
                told[c["effect"]] = c["evidence"]  # of two forms the accepted one, as in `choice`
            standing = step["standing"] or {name: e.score for name, e in told.items()}
            passing = {name: standing.get(name, -np.inf) for name, e in told.items() if passes(e)}
            first = max(told, key=lambda name: told[name].score, default=None)
            best = max(passing, key=passing.__getitem__) if first in passing else None
            expected = "effect" if missing & set(told) else "untried" if missing else "none"
            decision = "none" if best is None else "right" if best in missing else "wrong"
            weights = np.exp(np.array(list(passing.values())) - passing.get(best or "", 0.0))
            yield one.kind, expected, decision, 1 / weights.sum() if best else 0.0


def named(folder: Path) -> None:
    """Prints what the recorded diagnoses named, by kind of problem; `--odds` and the like do not change it."""
    total: dict[str, Counter[str]] = {kind: Counter() for kind in (*KINDS, "further")}
    for file in sorted(folder.rglob("*.pkl")):
        kept = pickle.loads(file.read_bytes())
        one, accepted = kept["problem"], set(kept["accepted"])
        right, wrong = len(accepted & one.expected), len(accepted - one.expected)
        total[one.kind].update(
            problems=1, hidden=len(one.expected), right=right, wrong=wrong, misled=int(wrong > 0)
        )
    print("| kind | problems | hidden | named | wrong names | problems with a wrong name |")
    print("| --- | --- | --- | --- | --- | --- |")
    for kind, of in total.items():
        print("|", kind, *(f"| {of[key]}" for key in ("problems", "hidden", "right", "wrong", "misled")), "|")
    print()


def count(folder: Path, odds: float, share: float, rare: float) -> None:
    named(folder)
    told = list(decisions(folder, odds, share, rare))
    print("| kind | expected | decision | steps |\n| --- | --- | --- | --- |")
    for key, number in sorted(Counter(one[:3] for one in told).items()):
        print("|", " | ".join(key), "|", number, "|")
    print("\n| probability of the accepted effect | mean | right | steps |\n| --- | --- | --- | --- |")
    for low, high in pairwise((0.0, 0.5, 0.8, 0.95, 1.0)):
        here = [(p, d == "right") for _, _, d, p in told if d != "none" and low < p <= high]
        if here:
            mean, right = np.mean(here, axis=0)
            print(f"| {low:.2f} to {high:.2f} | {mean:.2f} | {right:.2f} | {len(here)} |")


def names_of(text: str) -> list[str]:
    return list(FURTHER) if text == "further" else text.split(",")


def main() -> None:
    top = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    command = commands.add_parser("record", help="diagnose problems and keep the evidence")
    command.add_argument("folder", type=Path)
    command.add_argument("seeds", type=seeds_of)
    command.add_argument(
        "--propose", type=names_of, default=[], help="effects that are also tried: a,b or `further`"
    )
    command.set_defaults(go=lambda a: (propose(a.propose), record(a.folder, a.seeds)))
    command = commands.add_parser("further", help="the same of effects in benchmark/further.py")
    command.add_argument("folder", type=Path)
    command.add_argument("seeds", type=seeds_of)
    command.add_argument("--names", type=names_of, default=list(FURTHER), help="which: a,b")
    command.add_argument("--propose", type=names_of, default=[], help="as of `record`")
    command.set_defaults(go=lambda a: (propose(a.propose), record_further(a.folder, a.seeds, a.names)))
    command = commands.add_parser("count", help="decisions by kind, and probabilities beside frequencies")
    command.add_argument("folder", type=Path)
    command.add_argument("--odds", type=float, default=criterion.ODDS, help="least log posterior odds")
    command.add_argument("--share", type=float, default=criterion.SHARE, help="least evidence, see there")
    command.add_argument("--rare", type=float, default=criterion.RARE, help="share of sets with less")
    command.set_defaults(go=lambda a: count(a.folder, a.odds, a.share, a.rare))
    arguments = top.parse_args()
    arguments.go(arguments)


if __name__ == "__main__":
    main()
