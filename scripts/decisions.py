"""Records what `diagnose` decides on small problems, with every simulated candidate, and compares decision rules on the records.

    python -m scripts.decisions record RECORDS 100-399        (resumes; about half a minute of a core each)
    python -m scripts.decisions compare RECORDS [--form 0.1] [--share 0.8] [--odds 7]

A problem is a set of 47 frames of 64 x 80 pixels by the benchmark's camera: one effect, two, none, one that is removed from
the catalogue, or one that no catalogue has, at 0.8 to 4 times the faint strength. A record holds one entry per step of the
search: the state before, and of each simulated candidate the state with it. Rules can then be compared on the same states,
without a simulation.

The likelihood rule. Each statistic of the discovery and of the hold-out frames has, under a model M with residual r, the density

    p(r | M) = (1 - e) N(r; 0, s_M^2 + (form * explained)^2) + e / (2 |r| log R),

a normal distribution with the standard deviation of the model's own refitted simulated sets and with the model discrepancy of
an effect's form, and, for what another effect causes, a log-uniform outlier (e = 1 %, R = 10^4). The evidence of an effect is
the sum of log p(with) - log p(without). Its share is that sum over the statistics that it shifts, relative to the sum if no
residual were left in them. A candidate is accepted if its evidence, less half the logarithm of the number of statistics per
free parameter, exceeds `odds` on both uses of the frames together and is positive on the hold-out frames, and its share
exceeds `share`.
"""

import argparse
import pickle
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmark import effects, foreign
from benchmark.camera import Sensor, take
from benchmark.commands import seeds_of
from benchmark.randomness import stream
from benchmark.sets import camera_yaml
from benchmark.small import CHART, PLAN, SENSOR, chart
from benchmark.strengths import scaled
from visaug import Camera, FrameSet
from visaug.diagnosis import search
from visaug.diagnosis.acceptance import State
from visaug.diagnosis.adding import Adding
from visaug.diagnosis.chance import Chance
from visaug.diagnosis.choice import Accepted, Choice
from visaug.diagnosis.refinement import Refined
from visaug.frames import FrameRecord

KINDS = {"single": 0.45, "pair": 0.2, "clean": 0.1, "leave_out": 0.15, "foreign": 0.1}
CALIBRATED = 2  # the benchmark's camera whose faint strengths are taken
SETS = 120
OUTLIERS = 0.01  # share of statistics that another effect shifts
RANGE = 1e4  # ratio of the largest outlier to the smallest
LEAST = 3.0  # the smallest outlier, in standard deviations
SHIFTED = 3.0  # standard deviations of a change from which an effect shifts a statistic


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
        return set(self.names) if self.kind in ("single", "pair") else set()


def problem(seed: int) -> Problem | None:
    """The problem of a seed; None where an effect cannot be made that strong."""
    rng = stream(seed, "decisions")
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    e_per_dn = float(rng.choice([0.7, 1.5, 2.4]))
    sensor = replace(
        SENSOR, read_e=float(rng.uniform(2, 5)), e_per_dn=e_per_dn, efficiency=float(rng.uniform(0.4, 0.7)),
        bits=14 if e_per_dn < 1 else 12, well_e=9000.0 if e_per_dn < 2 else 8800.0,
    )  # fmt: skip
    known = [k.name for k in (foreign.KINDS if kind == "foreign" else effects.KINDS)]
    number = {"clean": 0, "pair": 2}.get(kind, 1)
    hidden = []
    for name in rng.choice(known, number, replace=False).tolist():
        faint = scaled(CALIBRATED, name, "default", "plain")
        if faint is None:
            return None
        hidden.append((name, faint * float(np.exp(rng.uniform(np.log(0.8), np.log(4))))))
    return Problem(seed, kind, sensor, tuple(hidden))


def frames_of(one: Problem) -> FrameSet:
    kinds = effects.BY_NAME | {k.name: k for k in foreign.KINDS}
    hidden = effects.in_order([kinds[name].at(strength) for name, strength in one.hidden])
    plan, targets = (*PLAN, *CHART), {"chart.npy": chart(one.sensor)}
    taken = take(one.sensor, plan, targets, one.seed, hidden)
    records = [
        FrameRecord(i, f"{i}.npy", s.kind, s.seconds, s.celsius, 0.0, s.photons, clean=s.target)
        for i, s in enumerate(plan)
    ]
    return FrameSet.from_arrays(records, list(taken), targets, bit_depth=one.sensor.bits)


def _state(state: State) -> dict[str, np.ndarray]:
    """What a rule may use: residuals and simulated residuals of discovery and hold-out frames, one after the other."""
    f, r = state.fitted, state.fitted.reference
    uses = ((f.residual, r.null), (f.confirm_residual, r.confirm_null))
    return {
        "residual": np.concatenate([left for left, _ in uses]),
        "sets": np.hstack([null.residuals for _, null in uses]).astype(np.float32),
        "scale": np.concatenate([null.scale for _, null in uses]),
        "finding": np.arange(sum(len(left) for left, _ in uses)) < len(f.residual),
        "allowance": np.concatenate([state.allowance, np.zeros(len(f.confirm_residual))]),
    }


class Recorder:
    """Keeps the states of one diagnosis: it stands in for the methods that choose and simulate candidates."""

    def __init__(self) -> None:
        self.steps: list[dict[str, Any]] = []
        self._sketches: dict[str, State] = {}
        self._simulated: dict[str, tuple[Refined, State | None]] = {}

    @contextmanager
    def recording(self) -> Iterator[None]:
        sketched, simulated, accepted = Adding._sketched, Choice._simulated, Choice.accepted

        def keep_sketch(adding: Adding, state: State, candidate: Refined) -> State:
            self._sketches[candidate.effect] = after = sketched(adding, state, candidate)
            return after

        def keep(choice: Choice, state: State, candidate: Refined) -> tuple[Refined, State | None]:
            told, after = simulated(choice, state, candidate)
            self._simulated[told.effect] = (told, after)
            return told, after

        def step(choice: Choice, state: State, found: list[Refined], by_chance: Chance) -> Accepted | None:
            self._sketches.clear()
            self._simulated.clear()
            result = accepted(choice, state, found, by_chance)
            self._note(state, result.refined.effect if result else None, by_chance.p_value)
            return result

        with (
            patch.object(Adding, "_sketched", keep_sketch),
            patch.object(Choice, "_simulated", keep),
            patch.object(Choice, "accepted", step),
        ):
            yield

    def _note(self, state: State, accepted: str | None, p_value: float) -> None:
        candidates = []
        for effect, (told, after) in self._simulated.items():
            told_by = after or self._sketches.get(effect)
            if told_by is not None:
                numbers = {"effect": effect, "parameters": len(told.coordinates), "full": after is not None}
                candidates.append({**numbers, "after": _state(told_by)})
        self.steps.append(
            {
                "before": _state(state),
                "had": state.accepted,
                "p": p_value,
                "accepted": accepted,
                "candidates": candidates,
            }
        )


def record(folder: Path, seeds: list[int]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        one, file = problem(seed), folder / f"{seed}.pkl"
        if one is None or file.exists():
            continue
        camera = folder / "camera.partial"
        camera.write_text(camera_yaml(one.sensor))
        # Of clean sets the search is made to go on, so that there are candidates to refuse.
        level = patch.object(search, "SIGNIFICANT", 2.0 if one.kind == "clean" else search.SIGNIFICANT)
        left_out = one.names if one.kind == "leave_out" else ()
        recorder = Recorder()
        with level, recorder.recording():
            found = search.diagnose(Camera.load(camera), frames_of(one), without=left_out, sets=SETS)
        kept = {"problem": one, "accepted": found.accepted, "steps": recorder.steps}
        kept["unexplained"] = found.unexplained is not None
        partial = file.with_suffix(".partial")
        partial.write_bytes(pickle.dumps(kept))
        partial.rename(file)
        print(seed, one.kind, *one.names, "->", *found.accepted, flush=True)


@dataclass(frozen=True)
class Evidence:
    """Of one candidate by the likelihood rule.

    Attributes:
        found, confirmed: difference of log likelihood on the discovery and on the hold-out frames.
        share: of what the statistics that it shifts could gain at most.
        cost: of its free parameters.
    """

    found: float
    confirmed: float
    share: float
    cost: float


def evidence(before: dict, after: dict, parameters: int, form: float = 0.1) -> Evidence:
    """The evidence of an effect from the states (see `_state`) without and with it."""
    used = (before["scale"] > 0) & (after["scale"] > 0)
    scale = before["scale"][used]
    was, left = before["residual"][used], after["residual"][used]
    allowed = before["allowance"][used]
    spread = np.sqrt(
        after["scale"][used] ** 2 + allowed**2 + (form * np.maximum(np.abs(was) - np.abs(left), 0)) ** 2
    )
    without = log_density(was, np.hypot(scale, allowed), scale)
    gain = log_density(left, spread, scale) - without
    most = log_density(np.zeros_like(left), spread, scale) - without
    shifted = np.abs(was - left) > SHIFTED * scale
    finding = before["finding"][used]
    share = float(gain[shifted].sum() / most[shifted].sum()) if shifted.any() else 0.0
    cost = 0.5 * np.log(max(used.sum(), 1)) * parameters
    return Evidence(float(gain[finding].sum()), float(gain[~finding].sum()), share, float(cost))


def log_density(residual: np.ndarray, spread: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """Log density of each residual: normal with standard deviation `spread`, or an outlier of LEAST * unit and more."""
    size = np.abs(residual)
    normal = np.exp(-0.5 * (size / spread) ** 2) / (spread * np.sqrt(2 * np.pi))
    outlier = 1 / (2 * np.log(RANGE) * np.maximum(size, LEAST * unit))
    return np.log((1 - OUTLIERS) * normal + OUTLIERS * outlier)


def judged(folder: Path, form: float, share: float, odds: float) -> Iterator[tuple[str, str, str, str]]:
    """(kind, expected, by today's rules, by the likelihood rule) for each step of each record.

    A decision is `right` (a hidden effect), `wrong` (another), or `none`. Expected is `effect` where a hidden one is missing and
    was simulated, `unseen` where it was not simulated, else `none`.
    """
    for file in sorted(folder.glob("*.pkl")):
        kept = pickle.loads(file.read_bytes())
        one: Problem = kept["problem"]
        for step in kept["steps"]:
            missing = one.expected - set(step["had"])
            there = missing & {c["effect"] for c in step["candidates"]}
            told = {
                c["effect"]: evidence(step["before"], c["after"], c["parameters"], form)
                for c in step["candidates"]
            }
            passing = {
                name: e.found + e.confirmed - e.cost for name, e in told.items()
                if e.found + e.confirmed - e.cost > odds and e.confirmed > 0 and e.share > share
            }  # fmt: skip
            best = max(passing, key=lambda name: passing[name], default=None)
            expected = "effect" if there else "unseen" if missing else "none"
            today, ours = (
                "none" if n is None else "right" if n in missing else "wrong"
                for n in (step["accepted"], best)
            )
            yield one.kind, expected, today, ours
            lines = "; ".join(
                f"{n} {e.found:.0f} + {e.confirmed:.0f} - {e.cost:.0f}, share {e.share:.2f}"
                for n, e in told.items()
            )
            print(
                f"{one.seed} {one.kind} {'+'.join(one.names)}: today {step['accepted']}, likelihood {best} ({lines})"
            )


def compare(folder: Path, form: float, share: float, odds: float) -> None:
    counts = Counter(judged(folder, form, share, odds))
    print("\n| kind | expected | today | likelihood | steps |\n| --- | --- | --- | --- | --- |")
    for key, number in sorted(counts.items()):
        print("|", " | ".join(key), "|", number, "|")


def main() -> None:
    top = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    command = commands.add_parser("record", help="diagnose problems and keep every state")
    command.add_argument("folder", type=Path)
    command.add_argument("seeds", type=seeds_of)
    command.set_defaults(go=lambda a: record(a.folder, a.seeds))
    command = commands.add_parser("compare", help="count decisions by kind")
    command.add_argument("folder", type=Path)
    command.add_argument("--form", type=float, default=0.1, help="tolerance of an effect's form, relative")
    command.add_argument("--share", type=float, default=0.8, help="least share of what could be gained")
    command.add_argument("--odds", type=float, default=7.0, help="least evidence, log")
    command.set_defaults(go=lambda a: compare(a.folder, a.form, a.share, a.odds))
    arguments = top.parse_args()
    arguments.go(arguments)


if __name__ == "__main__":
    main()
