"""Kill commands with SIGKILL at random moments, run them again, and compare with an undisturbed run.

    python scripts/kills.py --kills 20 --seed 1 augment simulate
    python scripts/kills.py --kills 20                              # every command

Each kill has an output folder of its own. What must agree: every byte of every output, but for wall-clock times and what
ultralytics writes beside its weights; the weights themselves agree tensor by tensor. Nothing else may be left over.
"""

import argparse
import json
import multiprocessing
import os
import random
import sys
import tempfile
import time
from collections.abc import Callable
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import numpy as np

PRELOAD = [
    "torch",
    "kornia",
    "scipy.stats",
    "visaug.app.cli",
    "visaug.augment.files",
    "visaug.camera.simulation",
    "visaug.diagnosis",
]
CAMERA = (
    "{name: small, resolution: [48, 64], bit_depth: 12, gain_e_per_dn: 2.0, quantum_efficiency: 0.5, black_level_dn: 60,"
    " read_noise: {sigma_e: 4.0}, prnu: {pixel: 0.01}, dark_current: {a_e_per_s: 2.0}}"
)
STUDY = {
    "name": "killed",
    "output": "out",
    "data": {
        "rendered": {
            "width": 96,
            "height": 64,
            "samples": 1,
            "images": {
                "synthetic": {"train": 8, "validation": 4, "test": 4},
                "lightbox": {"test": 2},
                "sunlamp": {"test": 2},
            },
        }
    },
    "training": {"epochs": 3, "imgsz": 64, "batch": 4, "amp": False, "device": "cpu"},
    "arms": {"baseline": {"gaussian": {}}},
    "bootstrap": 10,
}
COMMANDS: dict[str, list[str]] = {
    "augment": ["augment", "photos", "-o", "out", "--camera", "camera.yaml", "--seed", "3"],
    "simulate": ["simulate", "plan.csv", "--camera", "camera.yaml", "-o", "out", "--seed", "3"],
    "diagnose": [
        "diagnose",
        "frames",
        "--camera",
        "camera.yaml",
        "--json",
        "out/d.json",
        "-o",
        "out/better.yaml",
    ],
    "train": ["train", "study.yaml"],
    "ablate": ["ablate", "study.yaml"],
}


def inputs(folder: Path, frames: int = 40) -> None:
    """What the commands work on."""
    from PIL import Image

    rng = np.random.default_rng(1)
    (folder / "photos").mkdir()
    for i in range(frames):
        Image.fromarray(rng.integers(0, 255, (96, 128, 3)).astype(np.uint8)).save(
            folder / "photos" / f"{i}.png"
        )
    (folder / "camera.yaml").write_text(CAMERA)
    rows = [f"{i},b{i}.tif,bias,0," for i in range(frames)] + [
        f"{frames + i},f{i}.npy,flat,0.01,{500 * (i // 4 + 1)}" for i in range(frames)
    ]
    (folder / "plan.csv").write_text("sequence,file,kind,exposure_s,photons\n" + "\n".join(rows) + "\n")
    (folder / "study.yaml").write_text(json.dumps(STUDY))


def run(folder: Path, words: list[str]) -> None:
    """The command in this process, silent."""
    os.chdir(folder)
    os.environ["VISAUG_CACHE"] = str(folder / "cache")
    os.environ.setdefault("YOLO_CONFIG_DIR", str(folder / "ultralytics"))
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    sys.stderr = open(folder / "stderr", "a")  # noqa: SIM115 - until the process ends
    from visaug.app.cli import main

    main(words)


def start(folder: Path, words: list[str]) -> ForkServerProcess:
    process = multiprocessing.get_context("forkserver").Process(target=run, args=(folder, words))
    process.start()
    return process


def outcome(folder: Path) -> dict[str, object]:
    """Name -> content of all that a command left in its output folder."""
    found: dict[str, object] = {}
    for file in sorted((folder / "out").rglob("*")):
        name = file.relative_to(folder).as_posix()
        if (
            not file.is_file()
            or file.suffix in (".html", ".cache", ".jsonl")
            or "ultralytics-settings" in name
        ):
            continue
        if name.endswith("weights/best.pt"):
            import torch

            state = torch.load(file, weights_only=False)["model"].state_dict()  # this script trained it
            found[name] = {key: value.numpy().tobytes() for key, value in state.items()}
        elif file.name in ("run.json", "ablation.json"):
            found[name] = _untimed(json.loads(file.read_text()))
        elif file.name == "results.csv":
            found[name] = [
                line.split(",")[:1] + line.split(",")[2:] for line in file.read_text().splitlines()
            ]
        elif name.endswith(("weights/last.pt", "args.yaml", "ultralytics/data.yaml")):
            found[name] = "there"  # for ultralytics: dates and absolute paths
        else:
            found[name] = file.read_bytes()
    return found


def _untimed(value: object) -> object:
    if isinstance(value, dict):
        return {
            k: _untimed(v)
            for k, v in value.items()
            if k not in ("seconds", "began", "ended", "date", "where", "machine")
        }
    return [_untimed(v) for v in value] if isinstance(value, list) else value


def kill_often(
    command: str, kills: int, seed: int, base: Path, say: Callable[[str], object] = print, frames: int = 40
) -> int:
    """Kill and resume a command `kills` times; the number of resumed runs that were not as the undisturbed one."""
    words, rng, wrong, hit = COMMANDS[command], random.Random(f"{seed}/{command}"), 0, 0

    def fresh(name: str) -> Path:
        folder = base / f"{command}-{name}"
        folder.mkdir(parents=True)
        inputs(folder, frames)
        if command == "diagnose":
            _finish(
                start(
                    folder, ["simulate", "plan.csv", "--camera", "camera.yaml", "-o", "frames", "--seed", "3"]
                ),
                folder,
            )
        return folder

    warm = multiprocessing.get_context("forkserver").Process(
        target=int
    )  # the first waits for what is preloaded
    warm.start()
    warm.join()
    for name in ("first", "whole"):  # the first compiles what later ones find compiled
        whole = fresh(name)
        began = time.monotonic()
        _finish(start(whole, words), whole)
    seconds, expected = time.monotonic() - began, outcome(whole)
    say(f"{command}: {len(expected)} files in {seconds:.1f} s undisturbed")
    for number in range(kills):
        folder = fresh(str(number))
        process = start(folder, words)
        time.sleep(rng.uniform(0.02, 1.0) * seconds)
        unfinished = process.is_alive()
        process.kill()
        process.join()
        hit += unfinished
        ended = command == "simulate" and (folder / "out").exists()  # whole: it appears at the end
        _finish(start(folder, [*words, "--force"] if ended else words), folder)
        found = outcome(folder)
        left = [str(path) for path in folder.rglob(".visaug-*") if not path.name.endswith(".jsonl")]
        if found != expected or left:
            wrong += 1
            differ = sorted(name for name in {*found, *expected} if found.get(name) != expected.get(name))
            say(f"{command}, kill {number}: differ: {differ}; left over: {left}; {folder}")
        say(
            f"{command}: {number + 1} kills, {hit} of them before the end, {wrong} resumed otherwise than undisturbed"
        )
    return wrong


def _finish(process: ForkServerProcess, folder: Path) -> None:
    process.join()
    if process.exitcode != 0:
        raise RuntimeError(f"ended with {process.exitcode}: {(folder / 'stderr').read_text()[-2000:]}")


def main() -> int:
    parser = argparse.ArgumentParser(
        description="Kill commands at random moments and compare what resuming them gives."
    )
    parser.add_argument("commands", nargs="*", help="which; all where left out: " + " ".join(COMMANDS))
    parser.add_argument("--kills", type=int, default=20, help="of each command")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--frames", type=int, default=40, help="pictures, and half the frames, that they work on"
    )
    given = parser.parse_args()
    multiprocessing.set_forkserver_preload(PRELOAD)
    with tempfile.TemporaryDirectory() as base:
        return int(
            sum(
                [
                    kill_often(c, given.kills, given.seed, Path(base), print, given.frames)
                    for c in given.commands or COMMANDS
                ]
            )
            > 0
        )


if __name__ == "__main__":
    sys.exit(main())
