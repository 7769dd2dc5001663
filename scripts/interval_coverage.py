"""Do the 95 % intervals of `characterize` cover the truth? The paper's experiment, simulated again and again.

    python scripts/interval_coverage.py results.jsonl -n 100              # goes on where it was stopped
    python scripts/interval_coverage.py results.jsonl --table docs/characterization.md

200 bias frames and 250 dark frames of 256 x 256 pixels (the paper's section 4.1) of a camera with the paper's
figures, once with a black level and once without, where half of a bias frame is cut off at 0. The frames are
made here, by NumPy alone; nothing of the package's model has a part in them. A repeat is another sensor (its
columns, rows and pixels are drawn anew), so an interval has to cover the law that sensors come from.
"""

import argparse
import json
import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy import stats

from visaug.camera import Camera
from visaug.characterization import characterize
from visaug.core.files import write_text
from visaug.frames import FrameRecord, FrameSet

SIDE = 256
BIAS, DARK = 200, 10
EXPOSURES_S = (0.001, 0.01, 0.02, 0.5, 0.999)
TEMPERATURES_C = (15.0, 19.0, 23.0, 27.0, 30.0)
E_PER_DN = 0.095  # assumed, see docs/paper.md
TRUTH = {
    "read_noise.sigma_e": 2.37,
    "read_noise.shape": -0.23,
    "dsnu.column_e": 2.82,
    "dsnu.row_e": 0.21,
    "dsnu.pixel_e": 1.1,
    "dark_current.a_e_per_s": 0.136,
    "dark_current.b_per_c": 0.14,
}
ARMS = {"with": 2000.0, "without": 0.0}  # black level, DN
START, END = "<!-- coverage: made by scripts/interval_coverage.py -->", "<!-- end of coverage -->"


def frames(black_level_dn: float, seed: int) -> FrameSet:
    """One sensor's frames: DN = round((charge + offset + read noise) / gain + black level), cut to 16 bit."""
    rng = np.random.Generator(np.random.SFC64([seed, int(black_level_dn)]))
    shape = (SIDE, SIDE)
    offset_e = (
        TRUTH["dsnu.column_e"] * rng.standard_normal((1, SIDE))
        + TRUTH["dsnu.row_e"] * rng.standard_normal((SIDE, 1))
        + TRUTH["dsnu.pixel_e"] * rng.standard_normal(shape)
    ).astype(np.float32)
    records, pixels = [], []
    for n, (kind, exposure_s, temperature_c) in enumerate(plan()):
        rate = TRUTH["dark_current.a_e_per_s"] * math.exp(TRUTH["dark_current.b_per_c"] * temperature_c)
        electrons = offset_e + read_noise(rng, shape) + thermal(rng, rate * exposure_s, shape)
        dn = np.rint(electrons * np.float32(1 / E_PER_DN) + np.float32(black_level_dn))
        pixels.append(np.clip(dn, 0, 65535).astype(np.uint16))
        records.append(FrameRecord(n, f"{n}", kind, exposure_s, temperature_c))
    return FrameSet.from_arrays(records, pixels)


def plan() -> Iterator[tuple[str, float, float]]:
    """Kind, exposure and temperature of each frame."""
    for _ in range(BIAS):
        yield "bias", 1e-5, 20.0
    for temperature_c in TEMPERATURES_C:
        for exposure_s in EXPOSURES_S:
            for _ in range(DARK):
                yield "dark", exposure_s, temperature_c


def read_noise(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Tukey-lambda noise with the standard deviation (not the scale) that the paper gives."""
    power, sigma = np.float32(TRUTH["read_noise.shape"]), TRUTH["read_noise.sigma_e"]
    u = np.clip(rng.random(shape, np.float32), np.float32(1e-7), np.float32(1 - 1e-7))
    quantile = np.exp(power * np.log(u)) - np.exp(power * np.log1p(-u))
    return quantile * np.float32(sigma / (power * stats.tukeylambda(float(power)).std()))


def thermal(rng: np.random.Generator, mean_e: float, shape: tuple[int, int]) -> np.ndarray:
    """Poisson electrons: the few pixels of a short exposure that have any, or all of a long one."""
    if mean_e > 0.05:
        return rng.poisson(mean_e, shape)
    electrons = np.zeros(shape[0] * shape[1], np.int64)  # the total, thrown at pixels: the same law
    np.add.at(electrons, rng.integers(electrons.size, size=rng.poisson(mean_e * electrons.size)), 1)
    return electrons.reshape(shape)


def repeat(arm: str, seed: int) -> dict:
    """Every parameter's value, low and high, as measured from one sensor's frames."""
    began = time.process_time()
    camera = Camera.load(
        {"resolution": [SIDE, SIDE], "gain_e_per_dn": E_PER_DN}
    )  # no flats: the gain is given
    found = characterize(frames(ARMS[arm], seed), camera).parameters
    line = {name: [found[name].value, found[name].low, found[name].high] for name in TRUTH if name in found}
    return {"arm": arm, "seed": seed, "cpu_s": round(time.process_time() - began, 2), "found": line}


def table(lines: list[dict]) -> str:
    """Counts of intervals that cover the truth, with the 95 % interval of the share (Clopper and Pearson)."""
    rows = ["| parameter | black level | covered | share, 95 % interval | mean of the estimates | truth |"]
    rows.append("| --- | --- | --- | --- | --- | --- |")
    for name, true in TRUTH.items():
        for arm in ARMS:
            found = np.array(
                [line["found"][name] for line in lines if line["arm"] == arm and name in line["found"]]
            )
            if not len(found):
                continue
            hits = int(((found[:, 1] <= true) & (true <= found[:, 2])).sum())
            share = stats.binomtest(hits, len(found)).proportion_ci()
            mean, error = (
                found[:, 0].mean(),
                found[:, 0].std(ddof=1) / math.sqrt(len(found)) if len(found) > 1 else 0,
            )
            rows.append(
                f"| `{name}` | {arm} | {hits} of {len(found)} | {hits / len(found):.2f}, {share.low:.2f} to "
                f"{share.high:.2f} | {mean:.4g} ± {error:.1g} | {true:g} |"
            )
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("results", type=Path, help="a line of JSON for each repeat")
    parser.add_argument("-n", type=int, default=0, help="repeats of either arm, those in the file included")
    parser.add_argument("--table", type=Path, help="page whose marked part the table replaces")
    args = parser.parse_args()
    lines = (
        [json.loads(line) for line in args.results.read_text().splitlines()] if args.results.exists() else []
    )
    done = {(line["arm"], line["seed"]) for line in lines}
    for seed in range(args.n):
        for arm in ARMS:
            if (arm, seed) in done:
                continue
            lines.append(repeat(arm, seed))
            with args.results.open("a") as file:
                file.write(json.dumps(lines[-1]) + "\n")
    if args.table:
        page = args.table.read_text()
        before, rest = page.split(START)
        write_text(args.table, f"{before}{START}\n{table(lines)}\n{END}{rest.split(END)[1]}")
    else:
        print(table(lines))


if __name__ == "__main__":
    main()
