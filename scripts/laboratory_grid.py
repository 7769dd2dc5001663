"""Coverage of `characterize` over cameras of all kinds: bits, gain, read noise, black level, number of frames.

    python scripts/laboratory_grid.py [--repeats 2] [--minutes 15] [--store grid.jsonl] [--docs docs/characterization.md]

Cameras are plain NumPy and share nothing with the package. A parameter counts where it was determined and no
warning names it as spoiled; the table says how often it was left open or warned about.
"""

from __future__ import annotations

import argparse
import itertools
import json
import re
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy import stats

from visaug.characterization import characterize
from visaug.frames import FrameRecord, FrameSet

ROWS, COLUMNS, EFFICIENCY = 64, 80, 0.55
BITS = (8, 10, 12, 14, 16)
NOISE_DN = (0.1, 0.3, 0.6, 2.0, 8.0, 30.0)
BLACK_IN_SIGMA = (6.0, 2.0, 0.95, 0.0)  # 0, 2, 17 and 50 % of a bias frame at 0
GAIN = (0.05, 1.0, 10.0, 60.0)
FRAMES = (3, 8)
PARAMETERS = (
    "gain_e_per_dn", "quantum_efficiency", "read_noise.sigma_e", "read_noise.shape", "black_level_dn", "prnu.pixel",
    "dsnu.pixel_e",
)  # fmt: skip


def frame_set(
    seed: tuple[int, ...], bits: int, noise_dn: float, black: float, gain: float, n: int, top: bool
):
    """Frames and truth of one camera whose levels span the converter's range."""
    rng = np.random.default_rng(seed)
    black_dn = black * noise_dn + (1.0 + rng.random() if black > 3 else 0.0)
    span_e = (2**bits - 1 - black_dn) * gain
    read, shape = noise_dn * gain, (ROWS, COLUMNS)
    pattern = 0.7 * read if rng.random() < 0.7 else 0.0
    prnu, dsnu = 0.01 * rng.standard_normal(shape), pattern * rng.standard_normal(shape)
    shift = 16 - bits if top and bits > 8 else 0

    def take(mean_e: float) -> np.ndarray:
        e = rng.poisson(mean_e * (1 + prnu)) + dsnu + read * rng.standard_normal(shape)
        dn = np.clip(np.rint(e / gain + black_dn), 0, 2**bits - 1)
        return dn.astype(np.uint8 if bits == 8 else np.uint16) << shift

    rows = [("bias", None, take(0.0)) for _ in range(4 * n)]
    for share in (0.03, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.3):
        photons = share * span_e / EFFICIENCY
        rows += [("flat", photons, take(share * span_e)) for _ in range(n)]
    records = [FrameRecord(i, f"{i}", kind, 0.01, 20.0, 0.0, p) for i, (kind, p, _) in enumerate(rows)]
    truth = {
        "gain_e_per_dn": gain, "quantum_efficiency": EFFICIENCY, "read_noise.sigma_e": read,
        "read_noise.shape": 0.1349, "black_level_dn": black_dn, "prnu.pixel": 0.01, "dsnu.pixel_e": pattern,
    }  # fmt: skip
    return FrameSet.from_arrays(records, [r[2] for r in rows]), truth


def cells() -> list[tuple]:
    """The conditions that a converter of so many bits can have, in an order drawn by chance."""
    every = [c for c in itertools.product(BITS, NOISE_DN, BLACK_IN_SIGMA, GAIN, FRAMES)
             if c[1] * (c[2] + 12) < 2 ** c[0] / 4 and c[3] * 2 ** c[0] < 4e6]  # fmt: skip
    return [every[i] for i in np.random.default_rng(0).permutation(len(every))]


def measure(repeat: int, cell: tuple) -> dict:
    """What `characterize` says of one camera: a line of the store."""
    bits, noise, black, gain, n = cell
    seed = (repeat, bits, int(10 * noise), int(100 * black), int(100 * gain), n)
    frames, truth = frame_set(seed, bits, noise, black, gain, n, top=sum(seed) % 2 == 1)
    start = time.perf_counter()
    result = characterize(frames)
    spoiled = {name for w in result.warning_details for name in w.spoils}
    found = {}
    for name, true in truth.items():
        if name in result.parameters:
            p = result[name]
            found[name] = {
                "truth": true,
                "value": p.value,
                "low": p.low,
                "high": p.high,
                "warned": name in spoiled,
            }
    return {"repeat": repeat, "cell": cell, "seconds": round(time.perf_counter() - start, 1), "found": found,
            "warnings": [w.word for w in result.warning_details]}  # fmt: skip


def run(repeats: int, minutes: float, store: Path) -> list[dict]:
    """Measures what the store lacks until time is up. Returns all lines of the store."""
    lines = [json.loads(line) for line in store.read_text().splitlines()] if store.exists() else []
    done, end = {(line["repeat"], *line["cell"]) for line in lines}, time.time() + 60 * minutes
    for repeat, cell in itertools.product(range(repeats), cells()):
        if time.time() > end:
            break
        if (repeat, *cell) not in done:
            lines.append(measure(repeat, cell))
            with store.open("a") as file:
                file.write(json.dumps(lines[-1]) + "\n")
    return lines


def table(lines: list[dict]) -> str:
    """Coverage of each parameter over all sets, and in the worst of the conditions."""
    rows = [f"{len(lines)} sets of frames.", "",
            "| parameter | determined | covered | share, 95 % interval | least cell | left open | warned |",
            "| --- | --- | --- | --- | --- | --- | --- |"]  # fmt: skip
    for name in PARAMETERS:
        found = [(line["cell"], line["found"].get(name)) for line in lines]
        conditions, whole = defaultdict(list), []
        for cell, p in found:
            if p and not p["warned"]:
                whole.append(p["low"] <= p["truth"] <= p["high"])
                for value, unit in zip(cell, ("bits", "DN", "sigma", "e-/DN", "frames"), strict=True):
                    conditions[f"{value:g} {unit}"].append(whole[-1])
        if not whole:
            continue
        low, high = stats.binomtest(sum(whole), len(whole)).proportion_ci(method="exact")
        worst = min(conditions, key=lambda c: np.mean(conditions[c]))
        share = f"{np.mean(whole):.3f}, {low:.3f} to {high:.3f}"
        rows.append(f"| `{name}` | {len(whole)} | {sum(whole)} | {share} | {np.mean(conditions[worst]):.2f} at {worst} "
                    f"({len(conditions[worst])}) | {sum(p is None for _, p in found)} | "
                    f"{sum(bool(p and p['warned']) for _, p in found)} |")  # fmt: skip
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument(
        "--store",
        type=Path,
        default=Path("laboratory_grid.jsonl"),
        help="sets already measured are not repeated",
    )
    parser.add_argument("--docs", type=Path)
    options = parser.parse_args()
    text = table(run(options.repeats, options.minutes, options.store))
    print(text)
    if options.docs:
        start, end = "<!-- grid: made by scripts/laboratory_grid.py -->", "<!-- end of grid -->"
        page = options.docs.read_text()
        pattern = re.escape(start) + ".*?" + re.escape(end)
        options.docs.write_text(re.sub(pattern, lambda _: f"{start}\n{text}\n{end}", page, flags=re.S))


if __name__ == "__main__":
    main()
