"""How often the checks of the measurement model sound on frames that follow the model.

    python scripts/false_alarms.py [--sets 200] [--first 0] [--store alarms.jsonl]

Six plain NumPy cameras, which share nothing with the package, take small sets of bias, dark and flat frames with nothing
wrong in them; every set has a sensor of its own. Prints, for each check, in how many sets it warned, with its words.
`--store` keeps the words of each set, so that a longer run resumes. Exit status 1 where a check warned more often than
its stated rate allows at a probability of 1 %.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from visaug.characterization import characterize
from visaug.characterization.model_checks import CHECKS
from visaug.frames import FrameRecord, FrameSet

EFFICIENCY = 0.6  # e-/photon
DARK_C, COLD_C = 20.0, 5.0
COLDER = float(np.exp(0.6 / 8.617e-5 * (1 / (DARK_C + 273.15) - 1 / (COLD_C + 273.15))))  # silicon of 0.6 eV


@dataclass(frozen=True)
class Camera:
    """Gain in e-/DN, read noise in e- with Tukey-lambda `shape` (None: normal), black level in DN, light per
    place of a 2 x 2.
    """

    gain: float
    read: float
    black: float
    bits: int
    levels: tuple[float, ...]
    frames: int
    size: tuple[int, int] = (64, 80)
    shape: float | None = None
    mosaic: tuple[float, float, float, float] = (1, 1, 1, 1)
    row_noise: float = 0.0
    lamp: float = 0.0
    falloff: float = 0.0
    dark: float = 0.0


CAMERAS = {
    "machine vision, 12 bits": Camera(0.4, 4.0, 100, 12, (100, 300, 600, 1000, 1400), 4, dark=3.0),
    "cooled CCD, heavy tails": Camera(0.25, 6.0, 500, 16, (200, 900, 3000, 7000, 12000), 4, shape=-0.15, dark=0.3),
    "8 bits": Camera(40.0, 30.0, 6, 8, (800, 2000, 4000, 6500, 8500), 6),
    "few electrons": Camera(0.1, 1.2, 60, 12, (8, 25, 60, 120, 250), 4, dark=0.5),
    "colour, light that falls off": Camera(0.5, 3.0, 120, 12, (150, 400, 800, 1200), 4, (72, 96),
                                           mosaic=(0.6, 1.2, 1.2, 0.8), falloff=0.15),
    "pairs, row noise, a lamp that flickers": Camera(0.3, 3.0, 200, 14, (150, 400, 900, 1700, 2600), 2, (96, 96),
                                                     row_noise=1.0, lamp=0.02, dark=2.0),
}  # fmt: skip


def frame_set(camera: Camera, seed: int) -> FrameSet:
    """Ten bias frames, flats, and dark frames at two temperatures where there is dark current."""
    rng = np.random.default_rng([seed, camera.bits])
    shape = camera.size
    prnu, dsnu = rng.normal(0, 0.01, shape), rng.normal(0, 0.4 * camera.read, shape)
    tile = np.array(camera.mosaic).reshape(2, 2) / np.mean(camera.mosaic)
    y, x = np.linspace(-1, 1, shape[0])[:, None], np.linspace(-1, 1, shape[1])
    light = (1 + prnu) * np.tile(tile, (shape[0] // 2, shape[1] // 2)) * (1 - camera.falloff * (x**2 + y**2))

    def noise() -> np.ndarray:
        if camera.shape is None:
            return rng.normal(0, camera.read, shape)
        law = stats.tukeylambda(camera.shape)
        u = rng.random(shape)
        return (u**camera.shape - (1 - u) ** camera.shape) / camera.shape / law.std() * camera.read

    def take(mean_e: float, exposure_s: float, share: float = 1.0) -> np.ndarray:
        lamp = 1 + camera.lamp * rng.standard_normal()
        e = rng.poisson(np.maximum(mean_e * lamp * light, 0) + camera.dark * share * exposure_s)
        e = e + dsnu + noise() + rng.normal(0, camera.row_noise, (shape[0], 1))
        return np.clip(np.rint(camera.black + e / camera.gain), 0, 2**camera.bits - 1).astype(np.uint16)

    rows = [("bias", 0.0, None, take(0, 0), DARK_C) for _ in range(10)]
    for exposure_s in (2.0, 8.0) if camera.dark else ():
        rows += [("dark", exposure_s, None, take(0, exposure_s), DARK_C) for _ in range(camera.frames)]
    for level in camera.levels:
        rows += [("flat", 0.01, level / EFFICIENCY, take(level, 0.01), DARK_C) for _ in range(camera.frames)]
    for exposure_s in (2.0, 8.0, 32.0) if camera.dark else ():
        rows += [
            ("dark", exposure_s, None, take(0, exposure_s, COLDER), COLD_C) for _ in range(camera.frames)
        ]
    records = [FrameRecord(i, f"{i}", kind, t, c, 0.0, p) for i, (kind, t, p, _, c) in enumerate(rows)]
    return FrameSet.from_arrays(records, [row[3] for row in rows], bit_depth=camera.bits)


def heard(seed: int, store: Path | None) -> list[str]:
    """The warnings of one set, from the store if they stand there."""
    lines = store.read_text().splitlines() if store is not None and store.exists() else []
    known = {line["seed"]: line["words"] for line in map(json.loads, lines)}
    if seed in known:
        return known[seed]
    found = characterize(frame_set(CAMERAS[camera_of(seed)], seed))
    words = sorted({w.word for w in found.warning_details})
    if store is not None:
        with store.open("a") as file:
            file.write(json.dumps({"seed": seed, "words": words}) + "\n")
    return words


def camera_of(seed: int) -> str:
    return list(CAMERAS)[seed % len(CAMERAS)]


def count(sets: int, first: int = 0, store: Path | None = None) -> tuple[Counter[str], Counter[str]]:
    """In how many sets each check warned, and each word with the camera that it concerned."""
    alarms: Counter[str] = Counter()
    said: Counter[str] = Counter()
    for seed in range(first, first + sets):
        words = set(heard(seed, store))
        for check in CHECKS:
            alarms[check.assumption] += bool(words & set(check.words))
            said.update(f"{word} ({camera_of(seed)})" for word in words & set(check.words))
    return alarms, said


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first set")
    parser.add_argument(
        "--store", type=Path, help="a line of JSON for each set; sets that it holds are not measured again"
    )
    args = parser.parse_args()
    sets = args.sets
    alarms, said = count(sets, args.first, args.store)
    print(f"| check | stated rate | warned, of {sets} sets |\n| --- | --- | --- |")
    for check in CHECKS:
        print(f"| {check.assumption} | {check.false_alarms:.1%} | {alarms[check.assumption]} |")
    for word, n in said.most_common():
        print(f"{word}: {n}")
    excess = [c for c in CHECKS if stats.binom.sf(alarms[c.assumption] - 1, sets, c.false_alarms) < 0.01]
    raise SystemExit(1 if excess else 0)


if __name__ == "__main__":
    main()
