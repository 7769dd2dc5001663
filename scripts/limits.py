"""Do the upper limits of absent effects hold? Each effect at 1.5 times its printed limit must be shown.

    python scripts/limits.py limits.jsonl 1-2         (resumes; about 10 minutes of a core for a seed)

A seed draws a small camera of `benchmark/`, takes 47 clean frames of 64 x 80 pixels and diagnoses them. Each effect that is
called absent is then simulated at 1.5 times its limit, with another specimen and other noise, and the test of adequacy (p < 0.02)
shows it or not. At least 95 % must be shown.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml

from benchmark.commands import seeds_of
from benchmark.judge import share
from benchmark.randomness import stream
from benchmark.sets import camera_yaml
from scripts.decisions import Problem, any_sensor, frames_of
from visaug import Camera, FrameSet, diagnose, simulate
from visaug.camera.paths import place_of
from visaug.diagnosis import search
from visaug.diagnosis.candidates.trials import Trial, strength_of, trials
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.verdict import Verdict
from visaug.statistics.tail import SIGNIFICANT

FACTOR = 1.5
SETS = 120


def at_factor(camera: Camera, verdict: Verdict) -> Camera | None:
    """The camera with an effect at `FACTOR` times its limit; None if the parameter cannot take that value."""
    assert verdict.parameter is not None
    assert verdict.limit is not None
    own = [t for t in trials(camera, frozenset()) if t.effect == verdict.effect and not t.is_other_form]
    at = {strength_of(camera, t): t for t in own}
    (path, strength), trial = next(
        (of, t) for of, t in at.items() if of[0] == verdict.parameter and of[1] > 0
    )
    without = camera.values().get(path, 0.0)
    distance = 1 / verdict.limit if not np.isfinite(without) else abs(verdict.limit - without)
    wanted: Trial = trial.times(FACTOR * distance / strength)
    parameter = place_of(path).parameter
    reached = strength_of(camera, wanted)[1] if wanted.fits(camera) else 0.0
    if parameter.integer or abs(reached - FACTOR * distance) > 0.01 * FACTOR * distance:
        return None
    return wanted.on(camera)


def p_value(frames: FrameSet, camera: Camera) -> float:
    """Of the test of adequacy, as `diagnose` makes it first."""
    lab = Laboratory(frames, camera)
    return search.tested(lab, camera, frozenset(), lambda *_: None, SETS)[2].p_value


def lines_of(seed: int) -> Iterator[dict]:
    sensor = any_sensor(stream(seed, "limits"))
    camera = Camera.load(yaml.safe_load(camera_yaml(sensor)))
    frames = frames_of(Problem(seed, "clean", sensor, ()))
    found = diagnose(camera, frames, sets=SETS)
    for k, verdict in enumerate(found.effects):
        if verdict.verdict != "absent":
            continue
        line = {
            "seed": seed,
            "effect": verdict.effect,
            "parameter": verdict.parameter,
            "limit": verdict.limit,
        }
        with_effect = at_factor(camera, verdict)
        if with_effect is not None:
            taken = simulate(with_effect, frames, seed=1_000_000 + 1000 * seed + k)
            yield line | {"p": p_value(taken, camera)}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path, help="a line of JSON for each limit")
    parser.add_argument("seeds", type=seeds_of)
    options = parser.parse_args()
    kept = (
        [json.loads(x) for x in options.results.read_text().splitlines()] if options.results.exists() else []
    )
    for seed in options.seeds:
        if seed not in {line["seed"] for line in kept}:
            new = list(lines_of(seed))  # a seed is kept as a whole
            with options.results.open("a") as file:
                file.writelines(json.dumps(line) + "\n" for line in new)
            kept += new
    hidden = [line for line in kept if line["p"] >= SIGNIFICANT]
    print(f"shown: {share(len(kept) - len(hidden), len(kept))}")
    for line in hidden:
        print(
            f"not shown: {line['effect']} at {FACTOR:g} x {line['limit']:.3g}, p = {line['p']:.2g}, seed {line['seed']}"
        )


if __name__ == "__main__":
    main()
