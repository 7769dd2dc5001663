"""Which frames would tell two effects apart."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.reference import Report
from visaug.fingerprint import fingerprint
from visaug.frames import FrameSet
from visaug.frames.plan import default_plan
from visaug.simulation import simulate

SETS = 6
WINDOW = (128, 160)
WORDS = {
    "bias": "a stack of bias frames",
    "dark": "a ladder of dark frames over exposure and temperature",
    "flat": "flats over the whole range up to saturation, several at each level",
}


def measurement(cameras: Mapping[str, Camera], report: Report) -> str:
    """The frames in which two cameras differ most, in words, from simulations of a full plan of frames."""
    first, second = list(cameras.values())[:2]
    plan = _plan(first)
    prints = []
    for n, (camera, k) in enumerate((camera, k) for camera in (first, second) for k in range(SETS)):
        prints.append(fingerprint(simulate(camera, plan, seed=k)))
        report("frames that would tell them apart", n + 1, 2 * SETS)
    values = np.array([p.values for p in prints]).reshape(2, SETS, -1)
    apart = np.abs(values[0].mean(0) - values[1].mean(0))
    least = np.array([s.least_spread for s in prints[0].statistics])
    spread = np.maximum(values.std(1, ddof=1).max(0), np.maximum(least, 1e-9))
    best = prints[0].statistics[int((apart / spread).argmax())]
    view = best.view.replace("_", " ")
    return f"{WORDS[best.kind]}: they differ most in {best.name} of {best.frames} ({view})"


def _plan(camera: Camera) -> FrameSet:
    """A full plan of frames in a window in the middle of the sensor; pixels are not needed."""
    rows, columns = camera.resolution
    height, width = min(rows, WINDOW[0]), min(columns, WINDOW[1])
    r0, c0 = (rows - height) // 2, (columns - width) // 2
    full_well = camera.spec.full_well_e or camera.spec.gain_e_per_dn * 2**camera.bit_depth
    records = [
        replace(
            record,
            window=(r0, r0 + height, c0, c0 + width),
            photons=record.photons and record.photons * share,
        )
        for share in [full_well / camera.spec.quantum_efficiency / 20000.0]
        for record in default_plan()
        if record.kind in WORDS and record.gain_db == 0
    ]
    return FrameSet.from_arrays(records, [np.zeros((height, width), np.uint16)] * len(records))
