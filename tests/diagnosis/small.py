"""Small frame sets of a camera that shares nothing with the package: the benchmark's NumPy camera."""

import numpy as np

from benchmark.camera import Hidden, Sensor, take
from benchmark.small import CHART, PLAN, SENSOR, chart
from visaug import Camera, FrameSet
from visaug.frames import FrameRecord

__all__ = ["CHART", "PLAN", "SENSOR", "chart", "frame_set", "row_noise", "rows_that_shift", "stated_camera"]


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


# the file of an effect of a user's own, with a line and a factor of its law
RIPPLE = '''
from visaug.effects import Effect, Parameter, Stage

class Ripple(Effect):
    """A test's own."""
    name = "ripple"
    stage = Stage.READOUT
    sigma_e = Parameter(1.0, unit="e-", strength=True)

    def apply(self, signal, p, stream, context):
        {line}
        return signal + {factor} * p.sigma_e * stream.normal("row")
'''
