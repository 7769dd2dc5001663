#!/usr/bin/env python
"""What a comparison and a diagnosis cost for sets of several sizes: processor time of one simulated set, and what is read.

python scripts/size_cost.py > table.md
"""

from __future__ import annotations

import time

import numpy as np
import torch

from visaug import Camera, FrameSet
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.spread import Work
from visaug.frames import FrameRecord
from visaug.statistics.split import CONFIRM, FIND, WHOLE

SIZES = [(70, 200, 256), (150, 200, 256), (60, 1000, 1000), (250, 1024, 1280), (2000, 2048, 2448)]
REPEATS = 3


def camera(rows: int, columns: int) -> Camera:
    """A camera with the base chain."""
    return Camera.load(
        {
            "resolution": [rows, columns],
            "bit_depth": 14,
            "quantum_efficiency": 0.6,
            "gain_e_per_dn": 0.7,
            "black_level_dn": 120,
            "full_well_e": 9000,
            "read_noise": {"sigma_e": 3.0, "shape": -0.1},
            "dark_current": {"a_e_per_s": 0.2, "b_per_c": 0.1},
            "prnu": {"column": 0.002, "row": 0.001, "pixel": 0.006},
            "dsnu": {"column_e": 1.0, "row_e": 0.4, "pixel_e": 1.2},
        }
    )


def frames(count: int, rows: int, columns: int) -> FrameSet:
    """A fifth bias, two darks, five flats, in equal numbers; one exposure that stands for all of them."""
    settings = [("bias", 1e-5, None), ("dark", 0.2, None), ("dark", 2.0, None)]
    settings += [("flat", 0.01, p) for p in (300.0, 1000.0, 4000.0, 8000.0, 12000.0)]
    records = [
        FrameRecord(i, f"{i}.npy", kind, t, 20.0, 0.0, photons)
        for i, (kind, t, photons) in enumerate(settings[i * len(settings) // count] for i in range(count))
    ]
    exposure = np.random.default_rng(0).normal(120, 4, (rows, columns)).astype(np.uint16)
    return FrameSet.from_arrays(records, np.broadcast_to(exposure, (count, rows, columns)), bit_depth=14)


def seconds(lab: Laboratory, uses: tuple[str, ...], model: Camera) -> float:
    """Least processor time of one simulated set."""
    found = []
    for number in range(REPEATS):
        start = time.process_time()
        Work(lab.parts_to_simulate, 0, uses)((model, number))
        found.append(time.process_time() - start)
    return min(found)


def main() -> None:
    torch.set_num_threads(1)
    print(
        "| frames | pixels of each | used | compare, s a set | diagnose, s a set (finding / all) |\n| --- | --- | --- | --- | --- |"
    )
    for count, rows, columns in SIZES:
        model, taken = camera(rows, columns), frames(count, rows, columns)
        lab = Laboratory(taken, model)
        whole = Laboratory(taken, model, folds=False)
        costs = [
            seconds(whole, (FIND,), model),
            seconds(lab, (FIND,), model),
            seconds(lab, (FIND, CONFIRM, WHOLE), model),
        ]
        print(
            f"| {count} | {rows} x {columns} | {lab.selection} | {costs[0]:.2f} | {costs[1]:.2f} / {costs[2]:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
