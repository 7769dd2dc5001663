"""Counts probabilities of right and wrong names of strong effects, some in another form, some with a cause outside the catalogue.

    python -m scripts.outside record RECORDS 8001,8005-8012    (resumes; about half a minute of a core each)
    python -m scripts.outside count RECORDS

A problem is a set of 47 frames of 64 x 80 pixels by the benchmark's camera, with one effect at 0.5 to 2 times its typical strength:
in the default form, in its other form, taken out of the catalogue, or one that no catalogue has. To be fast a diagnosis tries few
effects: the hidden one alone, or where it is not in the catalogue those that act alike (`ALIKE`). At most two are added.
"""

import argparse
import pickle
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
import yaml

from benchmark import effects, foreign
from benchmark.camera import Sensor, take
from benchmark.commands import seeds_of
from benchmark.randomness import stream
from benchmark.sets import camera_yaml
from benchmark.small import CHART, PLAN, chart
from benchmark.strengths import TYPICAL
from scripts.decisions import any_sensor
from visaug import Camera, FrameSet
from visaug.diagnosis import search
from visaug.effects import catalogue
from visaug.frames import FrameRecord

KINDS = {"single": 0.3, "other": 0.3, "leave_out": 0.2, "foreign": 0.2}
SETS = 120
MOST = 2  # effects that a diagnosis adds
GROUPS = (
    "vignetting smear lens_flare veiling_glare fixed_pattern_structure tap_mismatch dust nonlinearity",
    "brighter_fatter interpixel_crosstalk point_spread charge_transfer_inefficiency blooming veiling_glare image_lag",
    "tap_mismatch column_parity row_parity fixed_pattern_structure column_noise missing_codes",
    "row_noise flicker_noise periodic_banding black_level_drift light_drift column_noise lamp_flicker",
    "amplifier_glow hot_pixels dark_current_nonuniformity rts_noise dark_current_rts fixed_pattern_structure clock_induced_charge",
    "dead_pixels dust hot_pixels cosmic_rays rts_noise dark_current_rts",
    "nonlinearity dual_gain missing_codes code_widths bit_truncation tap_mismatch column_parity",
    "image_lag charge_transfer_inefficiency blooming interpixel_crosstalk smear point_spread",
)  # effects of the catalogue that act alike
ALIKE = {
    "row_gain_noise": "light_drift row_noise lamp_flicker flicker_noise tap_mismatch",
    "patchwork": "row_noise rts_noise point_spread flicker_noise",
    "row_loading": "tap_mismatch veiling_glare smear nonlinearity vignetting",
    "electronic_ghost": "tap_mismatch charge_transfer_inefficiency veiling_glare smear image_lag",
    "bit_flips": "cosmic_rays rts_noise dark_current_rts dead_pixels hot_pixels",
    "checkerboard": "fixed_pattern_structure column_parity row_parity tap_mismatch",
    "converter_step": "nonlinearity dual_gain missing_codes bit_truncation code_widths",
    "despeckle": "point_spread interpixel_crosstalk brighter_fatter dead_pixels",
}  # and those that resemble what no catalogue has


@dataclass(frozen=True)
class Problem:
    seed: int
    kind: str
    sensor: Sensor
    effect: effects.Kind
    strength: float

    @property
    def is_known(self) -> bool:
        """Whether the effect is in the catalogue."""
        return self.kind in ("single", "other")

    @property
    def tried(self) -> set[str]:
        name = self.effect.name
        if self.is_known:
            return {name}
        groups = [ALIKE[name]] if name in ALIKE else [g for g in GROUPS if name in g.split()]
        return set(" ".join(groups).split()) - {name}


def problem(seed: int) -> Problem:
    rng = stream(seed, "odds-strong")
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    sensor = any_sensor(rng)
    among = [k for k in (foreign if kind == "foreign" else effects).KINDS if k.other_form or kind != "other"]
    effect = among[int(rng.integers(len(among)))]
    strength = TYPICAL[effect.name] * float(np.exp(rng.uniform(np.log(0.5), np.log(2))))
    return Problem(seed, kind, sensor, effect, min(strength, effect.largest))


def frames_of(one: Problem) -> FrameSet:
    form = one.effect.other_form if one.kind == "other" else "default"
    plan, targets = (*PLAN, *CHART), {"chart.npy": chart(one.sensor)}
    taken = take(one.sensor, plan, targets, one.seed, (one.effect.at(one.strength, form or "default"),))
    records = [
        FrameRecord(i, f"{i}.npy", s.kind, s.seconds, s.celsius, 0.0, s.photons, clean=s.target)
        for i, s in enumerate(plan)
    ]
    return FrameSet.from_arrays(records, list(taken), targets, bit_depth=one.sensor.bits)


def record(folder: Path, seeds: list[int]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for one in map(problem, seeds):
        file = folder / f"{one.seed}.pkl"
        if file.exists():
            continue
        camera = Camera.load(yaml.safe_load(camera_yaml(one.sensor)))
        without = [name for name in catalogue() if name not in one.tried]
        with patch.object(search, "MOST", MOST):
            found = search.diagnose(camera, frames_of(one), without=without, sets=SETS)
        of = {entry.effect: entry.probability for entry in found.ranking}
        names = [(of[name], one.is_known and name == one.effect.name) for name in found.accepted]
        file.write_bytes(pickle.dumps({"kind": one.kind, "names": names, "outside": found.outside}))
        said = [f"{name} {of[name]:.2f}" for name in found.accepted]
        print(one.seed, one.kind, one.effect.name, "->", *said, flush=True)


def count(folder: Path) -> None:
    kept = [pickle.loads(file.read_bytes()) for file in sorted(folder.glob("*.pkl"))]
    told = np.array([(p, k["outside"], right) for k in kept for p, right in k["names"]], float)
    print(len(kept), "problems\n\n| | without a cause outside the catalogue | with it |\n| --- | --- | --- |")
    right = told[:, 2] > 0
    columns = [told[:, 0] / (1 - told[:, 1]), told[:, 0]]
    for word, rows in (("right", right), ("wrong", ~right)):
        print("|", word, *(f"| {np.sum(p[rows] > 0.5)} of {rows.sum()} above 0.5" for p in columns), "|")
    print("| calibration error", *(f"| {calibration_error(p, right):.2f}" for p in columns), "|")
    log = [np.log(np.clip(np.where(right, p, 1 - p), 1e-3, 1)).mean() for p in columns]
    print("| mean log score", *(f"| {value:.2f}" for value in log), "|")


def calibration_error(p: np.ndarray, right: np.ndarray) -> float:
    """Expected calibration error, of ten bins."""
    bins = np.minimum((10 * p).astype(int), 9)
    return float(sum(abs((p - right)[bins == k].sum()) for k in range(10)) / len(p))


def main() -> None:
    top = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    command = commands.add_parser("record", help="diagnose problems")
    command.add_argument("folder", type=Path)
    command.add_argument("seeds", type=seeds_of)
    command.set_defaults(go=lambda a: record(a.folder, a.seeds))
    command = commands.add_parser("count", help="probabilities of right and of wrong names")
    command.add_argument("folder", type=Path)
    command.set_defaults(go=lambda a: count(a.folder))
    arguments = top.parse_args()
    arguments.go(arguments)


if __name__ == "__main__":
    main()
