"""Cut the small real frame set that the package ships out of the whole EMVA 1288 reference set.

    python scripts/crop_ccd.py EMVA1288_ReferenceSet_001_CCD_12Bit visaug/data/ccd12

The reference set (Basler AG, CC BY-SA 3.0) lies in the public repository EMVA1288/datasets. What is kept: a
window in the middle of the sensor, every third level of the exposure sweep, and the first frames of the two
stacks. Pixels are untouched.
"""

import csv
import sys
from pathlib import Path

import numpy as np
from PIL import Image

ROWS, COLUMNS = slice(144, 336), slice(192, 448)  # of 480 x 640
LEVELS = range(0, 41, 2)  # of 50; the converter clips from level 38 on
STACK_BRIGHT, STACK_DARK = 16, 24  # of 50 each
HEADER = ["sequence", "file", "kind", "exposure_s", "temperature_c", "gain_db", "photons", "clean", "region"]


def read_descriptor(path: Path) -> list[tuple[str, float, float, list[str]]]:
    """(kind `b` or `d`, exposure in ns, photons, file names) for each entry, in the file's order."""
    entries: list[tuple[str, float, float, list[str]]] = []
    for line in path.read_text().splitlines():
        match line.split():
            case ["b", exposure, photons]:
                entries.append(("b", float(exposure), float(photons), []))
            case ["d", exposure]:
                entries.append(("d", float(exposure), 0.0, []))
            case ["i", name]:
                entries[-1][3].append(name.replace("\\", "/"))
    return entries


def main(source: Path, target: Path) -> None:
    entries = read_descriptor(source / "EMVA1288_Data.txt")
    sweep_bright = [e for e in entries if e[0] == "b" and len(e[3]) == 2]
    sweep_dark = [e for e in entries if e[0] == "d" and len(e[3]) == 2]
    (stack_bright,) = [e for e in entries if e[0] == "b" and len(e[3]) > 2]
    (stack_dark,) = [e for e in entries if e[0] == "d" and len(e[3]) > 2]
    kept = [(*e[:3], e[3]) for level in LEVELS for e in (sweep_bright[level], sweep_dark[level])]
    kept += [
        (*stack_bright[:3], stack_bright[3][:STACK_BRIGHT]),
        (*stack_dark[:3], stack_dark[3][:STACK_DARK]),
    ]

    frames, rows = [], []
    for kind, exposure_ns, photons, names in kept:
        for name in names:
            frames.append(np.asarray(Image.open(source / name), dtype=np.uint16)[ROWS, COLUMNS])
            rows.append(
                [
                    len(rows),
                    f"frames.npz#frames[{len(rows)}]",
                    "flat" if kind == "b" else "dark",
                    f"{exposure_ns * 1e-9:.6g}",
                    "",
                    0,
                    f"{photons:g}" if kind == "b" else "",
                    "",
                    f"{ROWS.start}:{ROWS.stop},{COLUMNS.start}:{COLUMNS.stop}",
                ]
            )
    target.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(target / "frames.npz", frames=np.stack(frames))
    with open(target / "frames.csv", "w", newline="") as handle:
        csv.writer(handle, lineterminator="\n").writerows([HEADER, *rows])


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
