"""Hide physical effects in simulated cameras, let visaug look for them, and count how often it is right.

    python -m benchmark make 100-103 -o bench --kinds single,clean --strength plain
    python -m benchmark run bench
    python -m benchmark report bench

The cameras share no code with visaug, which is called as a user would call it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from . import (
    calibrate,
    calibration,
    cameras,
    effects,
    foreign,
    further,
    getframes_sets,
    judge,
    pictures_table,
    pyxel_sets,
    real,
    recipes,
)
from .sets import write_set
from .strengths import WORDS
from .textbook import sets as textbook_sets

PEERS = {"getframes": getframes_sets, "pyxel": pyxel_sets, "textbook": textbook_sets}
ALL_KINDS = (*recipes.KINDS, "real", *PEERS)


def seeds_of(text: str) -> list[int]:
    """Read `100-103,110` as 100, 101, 102, 103, 110."""
    seeds: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        seeds += range(int(first), int(last or first) + 1)
    return seeds


def make(arguments: argparse.Namespace) -> None:
    wanted = set(arguments.only.split(",")) if arguments.only else None
    folder, made = Path(arguments.output), 0
    if "real" in arguments.kinds:
        if arguments.frames is None:
            raise SystemExit("kind real needs --frames, the folder of EMVA1288_Data.txt")
        answers = judge.beside(folder, "answers")
        made += real.write_real_sets(arguments.frames, arguments.seeds, arguments.strength, folder, answers)
    for position, seed in enumerate(arguments.seeds):
        listed = arguments.cameras
        camera = listed[position % len(listed)] if listed else cameras.camera_of(seed)
        for kind in (kind for kind in arguments.kinds if kind in PEERS):
            answers = judge.beside(folder, "answers")
            made += PEERS[kind].write_sets(seed, camera, wanted, folder, answers)
        for kind in (kind for kind in arguments.kinds if kind in recipes.KINDS):
            for recipe in recipes.KINDS[kind](seed, camera, arguments.strength):
                if wanted and not wanted & set(recipe.expect):
                    continue
                own = calibrate.for_specimen(recipe)
                if own is None:
                    print(f"{recipe.identity}: cannot be made that strong, left out")
                    continue
                write_set(own, folder, judge.beside(folder, "answers"))
                made += 1
    print(f"{made} sets in {folder}, their answers in {judge.beside(folder, 'answers')}")


def kinds_of(text: str) -> list[str]:
    kinds = text.split(",")
    unknown = [kind for kind in kinds if kind not in ALL_KINDS]
    if unknown:
        raise argparse.ArgumentTypeError(f"unknown kind {unknown[0]}; known: {', '.join(ALL_KINDS)}")
    return kinds


def parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(
        prog="python -m benchmark", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = top.add_subparsers(required=True, metavar="COMMAND")

    command = commands.add_parser("make", help="write frame sets and their answers")
    command.add_argument(
        "seeds", type=seeds_of, help="such as 100-103,110; a seed draws camera, layout and noise"
    )
    command.add_argument(
        "-o", "--output", required=True, help="folder of the sets; answers go to OUTPUT_answers"
    )
    command.add_argument("--kinds", type=kinds_of, default=["single"], help=",".join(ALL_KINDS))
    command.add_argument("--strength", choices=WORDS, default="plain")
    command.add_argument("--cameras", type=seeds_of, help="take these of the ten in turn instead of drawing")
    command.add_argument("--only", help="names of effects, with commas")
    command.add_argument(
        "--frames", type=Path, help="for kind real: the folder of the EMVA 1288 reference set"
    )
    command.set_defaults(go=make)

    command = commands.add_parser("run", help="diagnose every set that has no result yet")
    command.add_argument("folder", type=Path)
    command.add_argument("--match", default="*", help="only sets whose folder name matches")
    command.add_argument("--effects", type=Path, help="a user's effect file to pass on")
    command.add_argument("--limit", type=float, default=1800, help="seconds for one set")
    command.add_argument("--workers", type=int, default=1, help="sets beside each other, one core each")
    command.add_argument(
        "--until", type=float, default=float("inf"), help="begin no set after so many seconds"
    )
    command.set_defaults(
        go=lambda a: judge.run_all(a.folder, a.match, a.effects, a.limit, a.workers, a.until)
    )

    command = commands.add_parser("report", help="print counts with intervals as Markdown")
    command.add_argument("folder", type=Path, nargs="+")
    command.set_defaults(go=lambda a: print(judge.report(a.folder), calibration.report(a.folder), sep="\n"))

    command = commands.add_parser("effects", help="list what can be hidden, and the forms")
    command.set_defaults(
        go=lambda a: [
            print(k.name, k.unit, k.other_form, sep=" | ")
            for k in (*effects.KINDS, *further.KINDS, *foreign.KINDS)
        ]
    )

    command = commands.add_parser(
        "calibrate", help="find the plain strengths of effects and add them to strengths.json"
    )
    command.add_argument("cameras", type=int, nargs="*", default=list(range(cameras.COUNT)))
    command.add_argument("--only", default="", help="names of effects, with commas")
    command.set_defaults(
        go=lambda a: calibrate.update(a.cameras, [name for name in a.only.split(",") if name])
    )

    command = commands.add_parser(
        "pictures", help="characterize pictures of known cameras and print what was found beside the truth"
    )
    command.add_argument("--update", type=Path, help="a page whose table is replaced")
    command.add_argument("--pictures", type=int, default=40, help="pictures of each camera")
    command.add_argument(
        "--cases",
        type=int,
        default=len(pictures_table.CASES),
        help="how many of the pairs of scenes and files",
    )
    command.set_defaults(go=lambda a: pictures_table.write(a.pictures, a.cases, a.update))
    return top


def main() -> None:
    chosen = parser().parse_args()
    chosen.go(chosen)
