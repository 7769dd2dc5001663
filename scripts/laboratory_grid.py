"""Coverage of `characterize` over cameras of all kinds: bits, gain, read noise, black level, number of frames.

    python scripts/laboratory_grid.py [--repeats 2] [--minutes 15] [--docs docs/characterization.md]

Cameras are plain NumPy and share nothing with the package. A parameter counts where it was determined and no
warning names it as spoiled; the table says how often it was left open or warned about.
"""

from __future__ import annotations

import argparse
import itertools
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


def frame_set(
    seed: tuple[int, ...], bits: int, noise_dn: float, black: float, gain: float, n: int, top: bool
):
    """Frames and truth of one camera whose levels span the converter's range."""
    rng = np.random.default_rng(seed)
    black_dn = black * noise_dn + (1.0 + rng.random() if black > 3 else 0.0)
    span_e = (2**bits - 1 - black_dn) * gain
    read, shape = noise_dn * gain, (ROWS, COLUMNS)
    prnu, dsnu = 0.01 * rng.standard_normal(shape), 0.7 * read * rng.standard_normal(shape)
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
        "read_noise.shape": 0.1349, "black_level_dn": black_dn, "prnu.pixel": 0.01, "dsnu.pixel_e": 0.7 * read,
    }  # fmt: skip
    return FrameSet.from_arrays(records, [r[2] for r in rows]), truth


def run(repeats: int, minutes: float) -> str:
    cells = [c for c in itertools.product(BITS, NOISE_DN, BLACK_IN_SIGMA, GAIN, FRAMES)
             if c[1] * (c[2] + 12) < 2 ** c[0] / 4 and c[3] * 2 ** c[0] < 4e6]  # fmt: skip
    np.random.default_rng(0).shuffle(cells)
    hits: dict[str, dict[str, list[bool]]] = defaultdict(lambda: defaultdict(list))
    open_, warned, sets, end = defaultdict(int), defaultdict(int), 0, time.time() + 60 * minutes
    for repeat, cell in itertools.product(range(repeats), cells):
        if time.time() > end:
            break
        bits, noise, black, gain, n = (c.item() if hasattr(c, "item") else c for c in cell)
        seed = (repeat, int(bits), int(10 * noise), int(100 * black), int(100 * gain), int(n))
        frames, truth = frame_set(seed, int(bits), noise, black, gain, int(n), top=sum(seed) % 2 == 1)
        result, sets = characterize(frames), sets + 1
        spoiled = {name for w in result.warning_details for name in w.spoils}
        for name, true in truth.items():
            if name not in result.parameters:
                open_[name] += 1
            elif name in spoiled:
                warned[name] += 1
            else:
                found = result[name]
                for key in (
                    f"{int(bits)} bits",
                    f"{noise:g} DN",
                    f"{black:g} sigma",
                    f"{gain:g} e-/DN",
                    f"{n:g} frames",
                ):
                    hits[name][key].append(found.low <= true <= found.high)
                hits[name]["all"].append(found.low <= true <= found.high)
    lines = [f"{sets} sets of frames.", "",
             "| parameter | determined | covered | share, 95 % interval | least cell | left open | warned |",
             "| --- | --- | --- | --- | --- | --- | --- |"]  # fmt: skip
    for name, cells_of in hits.items():
        whole = cells_of.pop("all")
        k, total = sum(whole), len(whole)
        low, high = stats.binomtest(k, total).proportion_ci(method="exact")
        worst = min(cells_of, key=lambda c: np.mean(cells_of[c]))
        share = f"{k / total:.3f}, {low:.3f} to {high:.3f}"
        lines.append(f"| `{name}` | {total} | {k} | {share} | {np.mean(cells_of[worst]):.2f} at {worst} "
                     f"({len(cells_of[worst])}) | {open_[name]} | {warned[name]} |")  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=15)
    parser.add_argument("--docs", type=Path)
    options = parser.parse_args()
    table = run(options.repeats, options.minutes)
    print(table)
    if options.docs:
        start, end = "<!-- grid: made by scripts/laboratory_grid.py -->", "<!-- end of grid -->"
        text = options.docs.read_text()
        pattern = re.escape(start) + ".*?" + re.escape(end)
        options.docs.write_text(re.sub(pattern, lambda _: f"{start}\n{table}\n{end}", text, flags=re.S))


if __name__ == "__main__":
    main()
