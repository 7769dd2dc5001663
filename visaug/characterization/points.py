"""Operating points: settings, filters and colours that a data sheet treats one by one."""

import math
from dataclasses import dataclass
from typing import Any

from visaug.camera import Camera
from visaug.characterization.alike import KINDS
from visaug.characterization.result import Characterization
from visaug.characterization.run import characterize
from visaug.characterization.views import colour_plane
from visaug.core.progress import Progress
from visaug.frames import FrameRecord, FrameSet


@dataclass(frozen=True)
class OperatingPoint:
    """One setting of the camera, one filter before it, one colour of its mosaic."""

    name: str
    result: Characterization

    def to_json(self) -> dict[str, Any]:
        """Every figure, and the arrays of every plot of release 4."""
        curves = {
            name: {k: [v if math.isfinite(v) else None for v in a.tolist()] for k, a in arrays.items()}
            for name, arrays in self.result.curves.items()
            if name.startswith("emva4_")
        }
        return {"name": self.name, **self.result.to_json(), "curves": curves}


def operating_points(
    frames: FrameSet, camera: Camera | None = None, seed: int = 0, progress: Progress | None = None
) -> list[OperatingPoint]:
    """Characterize every operating point of a set by itself.
    Flats part by gain in dB, setting and filter; dark frames belong to the points of their gain and setting. Where
    the records name a Bayer mosaic, each of its four colours is a point, as the standard has it.
    """
    parts = [
        (", ".join(filter(None, (name, colour))), subset)
        for name, taken in _settings(frames)
        for colour, subset in _colours(taken)
    ]
    points = []
    for n, (name, subset) in enumerate(parts):
        points.append(OperatingPoint(name or "one operating point", characterize(subset, camera, seed)))
        if progress is not None:
            progress("operating points", n + 1, len(parts))
    return points


def _settings(frames: FrameSet) -> list[tuple[str, FrameSet]]:
    usable = [i for i, r in enumerate(frames.records) if r.kind in KINDS and r.combined == 1]
    records = [frames.records[i] for i in usable]
    keys = list(dict.fromkeys(_key(r) for r in records if r.kind == "flat"))
    keys = keys or list(dict.fromkeys((r.gain_db, r.setting, None) for r in records))
    varied = [n for n in range(3) if len({key[n] for key in keys}) > 1]
    found = []
    for key in keys:
        chosen = [i for i, r in zip(usable, records) if _belongs(r, key)]
        found.append((", ".join(_said(n, key[n]) for n in varied), frames.subset(chosen)))
    return found


def _key(record: FrameRecord) -> tuple[float, str | None, str | None]:
    return record.gain_db, record.setting, record.filter


def _belongs(record: FrameRecord, key: tuple[float, str | None, str | None]) -> bool:
    if record.kind == "flat":
        return _key(record) == key
    return record.gain_db == key[0] and record.setting in (None, key[1])  # None: a header that is silent


def _said(which: int, value: float | str | None) -> str:
    return f"{value:g} dB" if which == 0 else str(value or ("setting not known", "no filter")[which - 1])


def _colours(frames: FrameSet) -> list[tuple[str, FrameSet]]:
    mosaics = {r.bayer for r in frames.records if r.kind == "flat"} - {None}
    if len(mosaics) != 1:
        return [("", frames)]
    pattern = str(mosaics.pop())
    greens = iter(("G1", "G2"))
    names = [c if c != "G" else next(greens) for c in pattern]
    return [(f"colour {name}", colour_plane(frames, n // 2, n % 2)) for n, name in enumerate(names)]
