"""What the measured component of an unexplained cause gives: errors with and without it, for causes that no catalogue has.

    python -m scripts.unexplained [SEED] [--names checkerboard,patchwork] [--times 12]

Each is diagnosed in a set of 47 frames of 64 x 80 pixels (see `scripts/decisions.py`), at a multiple of the strength at which it
is faint; about a minute of a core each.
"""

import argparse

import yaml

from benchmark import foreign
from benchmark.randomness import stream
from benchmark.sets import camera_yaml
from benchmark.strengths import scaled
from scripts.decisions import CALIBRATED, SETS, Problem, any_sensor, frames_of
from visaug import Camera
from visaug.core.wording import with_interval
from visaug.diagnosis import diagnose
from visaug.statistics.distance import Error


def row(seed: int, name: str, times: float) -> str:
    """Of one diagnosis, a row of the table."""
    faint = scaled(CALIBRATED, name, "default", "plain")
    if faint is None:
        return f"| {name} | not at this strength | | | |"
    one = Problem(seed, "foreign", any_sensor(stream(seed, "unexplained", name)), ((name, times * faint),))
    camera = Camera.load(yaml.safe_load(camera_yaml(one.sensor)))
    found = diagnose(camera, frames_of(one), sets=SETS).with_component()
    accepted = ", ".join(found.accepted) or "none"
    if found.component is None:
        return f"| {name} | {accepted} | nothing unexplained | {_told(found.error_after)} | |"
    part = found.component
    words = ", ".join(part.parts) or "no part is significant"
    return f"| {name} | {accepted} | {words} | {_told(part.error_before)} | {_told(part.error_after)} |"


def _told(error: Error | None) -> str:
    return "" if error is None else with_interval(error.value, error.low, error.high)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seed", nargs="?", type=int, default=1)
    parser.add_argument("--names", default=",".join(kind.name for kind in foreign.KINDS))
    parser.add_argument("--times", type=float, default=12.0)
    given = parser.parse_args()
    print("| cause | accepted effects | parts | error without | error with them |")
    print("| --- | --- | --- | --- | --- |")
    for name in given.names.split(","):
        print(row(given.seed, name, given.times), flush=True)


if __name__ == "__main__":
    main()
