"""Which frames would tell two effects apart."""

from collections.abc import Mapping

import numpy as np

from visaug.camera import Camera
from visaug.comparison import Laboratory
from visaug.diagnosis.fit import Report
from visaug.fingerprint import fingerprint
from visaug.frames import FrameSet
from visaug.frames.plan import default_plan
from visaug.simulation import simulate

SETS = 6
WORDS = {
    "bias": "a stack of bias frames",
    "dark": "a ladder of dark frames over exposure and temperature",
    "flat": "flats over the whole range up to saturation, several at each level",
    "scene": "a bright spot and an edge of known shape, each followed by a dark frame",
}


def measurement(lab: Laboratory, cameras: Mapping[str, Camera], report: Report) -> str:
    """The frames in which two cameras differ most, in words, from simulations of a full plan of frames."""
    a, b = list(cameras.values())[:2]
    records = [r for r in default_plan() if r.kind in ("bias", "dark", "flat") and r.gain_db == 0]
    shape = lab.frames.shape(0)
    plan = FrameSet.from_arrays(records, np.zeros((len(records), 1, 1), np.uint16).repeat(1, 0))
    del shape
    values = {}
    for word, camera in (("a", a), ("b", b)):
        prints = []
        for k in range(SETS):
            prints.append(fingerprint(simulate(camera, plan, seed=k)))
            report("frames that would tell them apart", k + 1, SETS)
        values[word] = np.array([p.values for p in prints])
        statistics = prints[0].statistics
    apart = np.abs(values["a"].mean(0) - values["b"].mean(0))
    spread = np.maximum(values["a"].std(0, ddof=1), values["b"].std(0, ddof=1)) + 1e-9
    best = statistics[int((apart / spread).argmax())]
    return f"{WORDS[best.kind]}: they differ most in {best.name} of {best.frames} ({best.view.replace('_', ' ')})"
