"""Which frames to take of a camera, and why."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

from visaug.core.errors import InputError
from visaug.core.wording import counted
from visaug.frames.record import FrameRecord


@dataclass(frozen=True, slots=True)
class PlannedGroup:
    """Frames of one purpose: how they are taken, what they determine, what is lost without them."""

    name: str
    how: str
    tells: str
    lost: str
    records: tuple[FrameRecord, ...]


LEVELS = (0.005, 0.02, 0.08, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.1)  # of saturation: two flats lie beyond it


def plan_groups(
    saturation_photons: float = 20000.0,
    exposure_s: float = 0.01,
    dark_exposures_s: Sequence[float] = (0.1, 0.5, 2.0),
    temperatures_c: Sequence[float | None] = (15, 20, 25, 30),
    gains_db: Sequence[float] = (0, 6, 12),
    repeats: int = 4,
    bias_frames: int = 32,
    levels: Sequence[float] = LEVELS,
    suffix: str = ".tif",
) -> tuple[PlannedGroup, ...]:
    """The groups of the default plan, numbered in the order of acquisition.

    Args:
        saturation_photons: photons per pixel that fill the pixel at `exposure_s` and the lowest gain.
        exposure_s: exposure of flats and scenes in seconds.
        dark_exposures_s: exposures of the dark ladder; the longest should give a few electrons or more.
        temperatures_c: temperatures of the dark ladder; the first is that of all other frames; ``(None,)`` where
            the camera does not tell it.
        gains_db: gain settings; the first is that of all other frames.
        repeats: frames at every setting; 2 at least, for temporal noise is a difference of frames.
        bias_frames: frames of the master bias.
        levels: light of the flats in shares of saturation; the standard asks for nine or more, one beyond it.
        suffix: format of the files.
    """
    dimmest = 10.0  # photons at saturation
    if not dimmest <= saturation_photons <= 1e12:
        expected = f"photons per pixel from {dimmest:g} to 1e12"
        problem = f"{saturation_photons:g} is out of range"
        raise InputError(problem, field="saturation_photons", expected=expected)
    if exposure_s <= 0:  # a table takes 0, of bias frames
        expected = "seconds above 0: flats and scenes need light"
        raise InputError(f"{exposure_s:g} is out of range", field="exposure_s", expected=expected)
    most_frames = 100_000  # of one setting
    for name, frames in (("repeats", repeats), ("bias_frames", bias_frames)):
        if not 2 <= frames <= most_frames:
            expected = f"2 to {most_frames} frames per setting"
            raise InputError(f"{frames} is out of range", field=name, expected=expected)
    if not temperatures_c or not gains_db or not dark_exposures_s:
        expected = "one or more temperatures, gains and dark exposures"
        raise InputError("a group of the plan has no frames", field="plan", expected=expected)
    brightest = 10.0  # of saturation: beyond, percentages or photons were meant
    light = [level * saturation_photons for level in levels]
    if not levels or not all(0.5 < p <= brightest * saturation_photons for p in light):
        expected = f"shares of saturation, of one photon or more, up to {brightest:g}"
        raise InputError(f"{list(levels)}", field="levels", expected=expected)
    groups: list[PlannedGroup] = []
    degrees = [None if c is None else float(c) for c in temperatures_c]
    gains = [float(g) for g in gains_db]
    numbers = count()

    def frame(kind: str, exposure: float, at: float | None = degrees[0], **more: Any) -> FrameRecord:
        n = next(numbers)
        more.setdefault("gain_db", gains[0])
        return FrameRecord(n, f"{kind}_{n:04d}{suffix}", kind, float(exposure), at, **more)

    def add(name: str, how: str, tells: str, lost: str, records: list[FrameRecord]) -> None:
        groups.append(PlannedGroup(name, how, tells, lost, tuple(records)))

    short = 1e-5
    add(
        "bias",
        f"{bias_frames} frames (16 at the very least), lens capped, the shortest exposure",
        "black level, read-noise sigma and shape, DSNU by row, column and pixel, row noise, 1/f noise, drift",
        "read noise and DSNU; dark frames of short exposure can stand in for them, with the dark current in",
        [frame("bias", short) for _ in range(bias_frames)],
    )
    add(
        "dark ladder",
        f"lens capped, {len(dark_exposures_s)} exposures at {counted(len(temperatures_c), 'temperature')}",
        "dark current and its temperature law, its non-uniformity, hot pixels, glow, random telegraph noise",
        "dark current; with a single temperature its temperature coefficient",
        [frame("dark", t, c) for c in degrees for t in dark_exposures_s for _ in range(repeats)],
    )
    add(
        "flats",
        f"uniform light at {len(levels)} levels from {min(levels):g} to {max(levels):g} of saturation, photons per pixel measured",
        "gain by photon transfer, quantum efficiency, PRNU by row, column and pixel, linearity, full well, vignetting",
        "gain, and with it all figures in electrons; without `photons` only the quantum efficiency",
        [frame("flat", exposure_s, photons=round(p)) for p in light for _ in range(repeats)],
    )
    add(
        "flats at half light, twice the exposure",
        "one level reached by another exposure",
        "distinguishes a nonlinear response from lamp drift and shutter delay",
        "nonlinearity and lamp drift cannot be distinguished",
        [frame("flat", 2 * exposure_s, photons=round(0.5 * saturation_photons)) for _ in range(repeats)],
    )
    add(
        "edges and spots, each followed by a dark frame",
        "a chart of edges, then one small bright spot beyond saturation; the lens capped for the very next "
        "frame; give the noiseless target in `clean` where it is known",
        "point spread, crosstalk, glare, flare, blooming, smear, charge transfer, and image lag in the dark frame after",
        "all effects between neighbouring pixels and consecutive frames",
        [frame(kind, exposure_s) for _ in range(2 * repeats) for kind in ("scene", "dark")],
    )
    if gains[1:]:
        add(
            "gain ladder",
            "bias frames and one flat level at every gain setting",
            "gain, read noise and black level at each setting",
            "the dependence on the gain setting; other settings are extrapolated",
            [
                frame(kind, t, gain_db=g, photons=photons)
                for g in gains[1:]
                for kind, t, photons in (
                    ("bias", short, None),
                    ("flat", exposure_s, round(0.4 * saturation_photons / 10 ** (g / 20))),
                )
                for _ in range(2 * repeats)
            ],
        )
    add(
        "bias again",
        "at the very end",
        "drift of the black level over the session",
        "slow drift",
        [frame("bias", short) for _ in range(repeats)],
    )
    return tuple(groups)


def default_plan(resolution: Sequence[int] | None = None, **options) -> list[FrameRecord]:
    """The records of the default plan, in order of acquisition; `options` as for `plan_groups`.

    `resolution` (rows, columns) gives every record the window of the whole sensor.
    """
    window = None if resolution is None else (0, int(resolution[0]), 0, int(resolution[1]))
    return [replace(r, window=window) for group in plan_groups(**options) for r in group.records]


def describe_plan(groups: Sequence[PlannedGroup] | None = None) -> str:
    """The plan as text: what each group determines, what is lost without it."""
    said = [
        f"{group.name} ({len(group.records)} frames): {group.how}\n"
        f"  determines: {group.tells}\n"
        f"  lost without it: {group.lost}"
        for group in groups or plan_groups()
    ]
    order = "Keep the focus, the light and the order: `sequence` is the order in which the frames were taken."
    return "\n".join([*said, order])
