"""What a diagnosis costs, on sets of `benchmark/` and with kornia's Gaussian noise on as many pixels beside.

    python scripts/bench.py diagnose [--only "47 of 64 x 80"] [--statistics]

Times are processor seconds (user and system) of all threads and processes, so that a busy machine counts for little; ns are of
one core. Memory is the largest sum over the processes, pages that they share counted once.
Every diagnosis runs in a process of its own with an empty cache, and once more with the cache of the first.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import torch

SETS = {  # frames and pixels of each: count, rows, columns
    "47 of 64 x 80": (47, 64, 80),
    "70 of 200 x 256": (70, 200, 256),
    "150 of 200 x 256": (150, 200, 256),
    "60 of 1000 x 1000": (60, 1000, 1000),
    "250 of 1024 x 1280": (250, 1024, 1280),
}
ADEQUATE = "adequate camera, {}"  # the same set, without the stripes
TWO = "two effects, 150 of 200 x 256"  # with a column noise beside the stripes
PICTURES = "24 pictures"  # of 192 x 256, 8 bit, whose rows shift
CASES = (*SETS, TWO, *(ADEQUATE.format(name) for name in list(SETS)[:2]), PICTURES)
ROUNDS = 5


def statistics_rows() -> list[str]:
    """ns a pixel of a simulated set, of the statistics of its three uses and of discovery alone, and of Gaussian noise."""
    from visaug.diagnosis.laboratory import Laboratory
    from visaug.diagnosis.part import MeasuredFrames
    from visaug.statistics import fingerprint_values
    from visaug.statistics.split import CONFIRM, FIND, WHOLE

    sys.path.insert(0, str(Path(__file__).parent))
    import size_cost

    torch.set_num_threads(1)
    rows = [
        "| set | simulation | three uses | discovery | kornia's Gaussian noise |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name in ("47 of 64 x 80", "70 of 200 x 256"):
        count, height, width = SETS[name]
        camera = size_cost.camera(height, width)
        (part,) = Laboratory(size_cost.frames(count, height, width), camera).parts_to_simulate
        assert isinstance(part, MeasuredFrames)
        taken, find = part.take(camera, 0), part.positions(FIND)
        uses = [find, part.positions(CONFIRM), part.positions(WHOLE)]
        pixels = count * height * width
        calls = (
            lambda part=part, camera=camera: part.take(camera, 0),
            lambda part=part, taken=taken, uses=uses: fingerprint_values(taken, uses, part.views),
            lambda part=part, taken=taken, find=find: fingerprint_values(taken, [find], part.views),
            gaussian(pixels),
        )
        rows.append(f"| {name} | " + " | ".join(f"{1e9 * least(call) / pixels:.1f}" for call in calls) + " |")
    return rows


def gaussian(pixels: int):
    """Adds kornia's Gaussian noise to as many pixels."""
    from kornia.augmentation import RandomGaussianNoise

    image, noise = torch.rand(1, 1, 1, pixels), RandomGaussianNoise(std=0.1, p=1.0)
    return lambda: noise(image)


def least(call) -> float:
    """Least processor seconds of some calls, after one that is not timed."""
    call()
    times = []
    for _ in range(ROUNDS):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)


def write_case(folder: Path, case: str) -> int:
    """Frames and camera of a case, on disk; how many pixels they are."""
    if case == PICTURES:
        return write_pictures(folder)
    of_set = next(name for name in SETS if case.endswith(name))
    hidden = {of_set: {"row_noise": 3.0}, TWO: {"row_noise": 3.0, "column_noise": 2.0}}
    write(folder, *SETS[of_set], hidden.get(case, {}))
    return int(np.prod(SETS[of_set]))


def write_pictures(folder: Path) -> int:
    """Pictures by a camera of `benchmark/` with row noise, which its file does not name."""
    from benchmark import pictures

    camera = next(c for c in pictures.CAMERAS if c.row_e)
    rng = np.random.default_rng(1)
    taken = pictures.take(camera, [pictures.spacecraft(rng) for _ in range(24)], 3)
    pictures.save(taken, folder)
    spec = {
        "resolution": list(pictures.SIDE),
        "bit_depth": 8,
        "gain_e_per_dn": camera.gain_e_per_dn,
        "black_level_dn": camera.black_dn,
        "read_noise": {"sigma_e": camera.read_e},
    }
    (folder / "camera.yaml").write_text(json.dumps(spec))
    return sum(picture.size for picture in taken)


def write(folder: Path, count: int, rows: int, columns: int, strengths: dict[str, float]) -> None:
    """A set on disk by the cameras of `benchmark/`, with effects of these strengths hidden in it."""
    from dataclasses import replace

    from benchmark import cameras, effects
    from benchmark.camera import Shot, take
    from benchmark.sets import write_frames

    sensor = replace(cameras.sensor(0), rows=rows, columns=columns)
    settings = [("bias", 1e-5, None), ("dark", 0.2, None), ("dark", 2.0, None)]
    settings += [("flat", 0.01, light) for light in (300.0, 1000.0, 3000.0, 5000.0, 8000.0)]
    shots = [settings[i * len(settings) // count] for i in range(count)]
    plan = [Shot(kind, seconds, sensor.celsius, photons=photons) for kind, seconds, photons in shots]
    hidden = [effects.BY_NAME[name].at(strength, "") for name, strength in strengths.items()]
    write_frames(folder, take(sensor, plan, {}, 1, effects.in_order(hidden)), plan, {}, sensor)


def diagnosed(folder: str, camera: str) -> None:
    """One diagnosis in this process; prints seconds, memory, the sets simulated by phase, and the names found."""
    import visaug
    from visaug.diagnosis.laboratory import Laboratory

    phases: Counter[str] = Counter()
    running = ["start"]
    ordinary = Laboratory._run

    def counted(self, jobs, *rest):
        phases[running[0]] += len(jobs)
        return ordinary(self, jobs, *rest)

    Laboratory._run = counted  # type: ignore[method-assign]

    def progress(phase: str, done: int, total: int) -> None:
        running[0] = " ".join(word for word in phase.split() if not word.isdigit())

    begun, start = time.process_time(), time.perf_counter()
    result = visaug.diagnose(camera, folder, progress=progress)
    wall = time.perf_counter() - start
    print(json.dumps({"begun_s": begun, "wall_s": wall, "phases": phases, "found": str(result)}))


def measured(call: list[str], environment: dict[str, str]) -> dict:
    """What a diagnosis in a process of its own prints, its processor seconds and its memory."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    peak = 0
    with subprocess.Popen(call, env=environment, stdout=subprocess.PIPE, text=True) as running:
        while running.poll() is None:
            peak = max(peak, shared_memory(running.pid))
            time.sleep(0.3)
        assert running.stdout is not None
        printed = json.loads(running.stdout.read().splitlines()[-1])
    if running.returncode:
        raise subprocess.CalledProcessError(running.returncode, call)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime - printed["begun_s"]
    return {**printed, "processor_s": seconds, "peak_mib": peak / 2**20}


def shared_memory(process: int) -> int:
    """Bytes of a process and those that it has begun; a page that several share counts as their share of it."""
    import psutil

    try:
        root = psutil.Process(process)
        return sum(one.memory_full_info().pss for one in (root, *root.children(recursive=True)))
    except psutil.Error:
        return 0  # one has just ended


def diagnosis_rows(only: list[str] | None) -> list[str]:
    """Processor and wall seconds and memory of a first and a second diagnosis of each set."""
    rows = [
        "| set | first, s | wall, s | second, s | wall, s | peak MiB | Gaussian noise, s | sets by phase | result |"
    ]
    rows.append("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for name in CASES:
        if only and name not in only:
            continue
        with tempfile.TemporaryDirectory() as base:
            folder = Path(base) / "set"
            pixels = write_case(folder, name)
            environment = {**os.environ, "VISAUG_CACHE": str(Path(base) / "cache")}
            call = [sys.executable, __file__, "--child", str(folder), str(folder / "camera.yaml")]
            first, second = (measured(call, environment) for _ in range(2))
        noise = least(gaussian(pixels))
        phases = ", ".join(f"{phase} {count}" for phase, count in first["phases"].items())
        rows.append(
            f"| {name} | {first['processor_s']:.0f} | {first['wall_s']:.0f} | {second['processor_s']:.1f} | "
            f"{second['wall_s']:.1f} | {first['peak_mib']:.0f} | "
            f"{noise:.3f} | {phases} | {first['found']} |"
        )
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=CASES, help="these sets alone")
    parser.add_argument("--statistics", action="store_true", help="no diagnosis, only the ns a pixel")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.child:
        return diagnosed(*options.child)
    print("\n".join(["ns a pixel and core:", "", *statistics_rows()]), flush=True)
    if not options.statistics:
        print("\n".join(["", "Processor seconds of a diagnosis:", "", *diagnosis_rows(options.only)]))
    return None


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    main()
