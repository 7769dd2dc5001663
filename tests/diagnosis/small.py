"""Small frame sets of a camera that shares nothing with the package: the benchmark's NumPy camera."""

import numpy as np

from benchmark.camera import Hidden, Sensor, Shot, take
from visaug import Camera, FrameSet
from visaug.frames import FrameRecord

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


def chart() -> np.ndarray:
    """Photons: squares at 0.1 to 0.8 of the full well on a dim ground, and a spot of 3x3 pixels at twelve times it."""
    target = np.full(SENSOR.shape, 300.0)
    full = SENSOR.well_e / SENSOR.efficiency
    for k in range(4):
        target[8:24, 8 + 18 * k : 20 + 18 * k] = full * (0.1 + 0.7 * k / 3)
    target[44:47, 30:33] = 12 * full
    return target


def frame_set(seed: int, hidden=(), sensor: Sensor = SENSOR, plan=tuple(PLAN)) -> FrameSet:
    targets = {shot.target: chart() for shot in plan if shot.target}
    frames = take(sensor, plan, targets, seed, hidden)
    records = [
        FrameRecord(i, f"{i}.npy", s.kind, s.seconds, s.celsius, 0.0, s.photons, clean=s.target)
        for i, s in enumerate(plan)
    ]
    return FrameSet.from_arrays(records, list(frames), targets, bit_depth=sensor.bits)


def stated_camera() -> Camera:
    """The camera as its maker tells it, without what is hidden."""
    s = SENSOR
    return Camera.load(
        {
            "name": s.name,
            "resolution": [s.rows, s.columns],
            "bit_depth": s.bits,
            "quantum_efficiency": s.efficiency,
            "gain_e_per_dn": s.e_per_dn,
            "black_level_dn": s.pedestal_dn,
            "full_well_e": s.well_e,
            "read_noise": {"sigma_e": s.read_e, "shape": s.tail},
            "dark_current": {"a_e_per_s": s.dark_e_per_s, "b_per_c": s.dark_per_c},
            "prnu": dict(zip(("column", "row", "pixel"), s.prnu, strict=True)),
            "dsnu": dict(zip(("column_e", "row_e", "pixel_e"), s.dsnu_e, strict=True)),
        }
    )


def rows_that_shift(x: np.ndarray, strength: float, moment) -> np.ndarray:
    return x + moment.now().normal(0, strength, (x.shape[0], 1))


def row_noise(strength: float) -> Hidden:
    return Hidden("shifting rows", "voltage", rows_that_shift, strength)
