"""A sensor of 64 x 80 pixels and plans of a few dozen frames, for tests and for many diagnoses."""

from __future__ import annotations

import numpy as np

from .camera import Sensor, Shot

SENSOR = Sensor(
    name="small", rows=64, columns=80, bits=14, efficiency=0.55, e_per_dn=0.7, pedestal_dn=120.0, well_e=9000.0,
    integration_s=0.01, celsius=20.0, read_e=3.0, tail=-0.1, dark_e_per_s=0.2, dark_per_c=0.1,
    prnu=(0.002, 0.0015, 0.006), dsnu_e=(1.0, 0.4, 1.2),
)  # fmt: skip

PLAN = (
    [Shot("bias", 1e-5, 20.0)] * 12
    + [Shot("dark", t, c) for c in (20.0, 30.0) for t in (0.2, 2.0) for _ in range(3)]
    + [Shot("flat", 0.01, 20.0, float(p)) for p in (100, 1000, 4000, 9000, 14000) for _ in range(3)]
)  # fmt: skip


CHART = [Shot("scene", 0.01, 20.0, target="chart.npy"), Shot("dark", 0.01, 20.0)] * 4


def chart(sensor: Sensor = SENSOR) -> np.ndarray:
    """Photons: squares at 0.1 to 0.8 of the full well on a dim ground, and a spot of 3x3 pixels at twelve times it."""
    target = np.full(sensor.shape, 300.0)
    full = sensor.well_e / sensor.efficiency
    for k in range(4):
        target[8:24, 8 + 18 * k : 20 + 18 * k] = full * (0.1 + 0.7 * k / 3)
    target[44:47, 30:33] = 12 * full
    return target
