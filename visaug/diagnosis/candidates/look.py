"""Estimates read directly from the measured frames: places, periods and tracks that no list of trials can contain."""

from collections.abc import Iterable, Iterator

import numpy as np
from scipy.ndimage import label

from visaug.camera import Camera
from visaug.core.constants import MAD
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.part import MeasuredFrames
from visaug.effects import FrameSummary
from visaug.pictures.part import PicturePart
from visaug.statistics import FrameData, GroupData

FULL = 0.9  # share of the full well above which a pixel counts as full
COLLAPSED = 0.5  # share of the largest temporal variance below which brighter flats are clipped
DEAD = 0.1  # share of the median answer to light below which a pixel does not answer,
CLEAR = 8.0  # where that answer is so many standard deviations over pixels
STRUCK = 8.0  # standard deviations by which a pixel of one frame exceeds the others of its kind


def look(lab: Laboratory, camera: Camera) -> FrameSummary | None:
    """Of the discovery frames; None if they contain no bias or dark frame."""
    data = _discovery(lab.parts[0], "bias", "dark")
    dark = data.bias
    # of a large set the full frames: a seam may lie outside the window
    everywhere = _discovery(lab.parts[-1], "bias", "dark").bias
    if dark is None or everywhere is None:
        return None
    height, width = camera.resolution
    window = lab.parts[-1].frames.records[everywhere.group.indices[0]].window or (0, height, 0, width)
    codes: set[int] = set()
    for i in lab.folds.find:
        codes.update(np.unique(lab.frames.read(i)).tolist())
    gain = camera.gain_at(dark.group.gain_db)
    darks = data.of("dark", 2)
    return FrameSummary(
        dark_e=everywhere.calm * camera.gain_at(everywhere.group.gain_db),
        rows=np.arange(window[0], window[1]) / height,
        columns=np.arange(window[2], window[3]) / width,
        codes=np.array(sorted(codes)),
        row_noise_e=dark.noise_rows * gain if dark.count > 1 else np.zeros((0, dark.calm.shape[0])),
        tracks=tracks(darks, camera),
        searched_mpx_s=1e-6 * sum(d.frames.size * d.group.exposure_s for d in darks),
        spilled_e=np.concatenate([np.zeros((0, 3)), *_spilled(lab.parts[-1], camera)]),
        stuck=stuck(everywhere.mean, _brightest(lab.parts[-1]), camera),
    )


def filled_well(lab: Laboratory, camera: Camera) -> float | None:
    """Electrons at which the pixels of flats fill: the level of those whose temporal variance is below that of dimmer ones.

    Of the brightest flats of the discovery frames; None if their variance does not collapse (EMVA 1288 release 4, saturation).
    """
    part = lab.parts[0]
    flats = [
        ((g.level - camera.spec.black_level_dn) * gain, g.noise_variance * gain**2)
        for g in _discovery(part, "flat").of("flat", 2)
        for gain in [camera.gain_at(g.group.gain_db)]
    ]
    if not flats:
        return None
    level_e, variance_e2 = max(flats)
    is_clipped = variance_e2 < COLLAPSED * max(variance for _, variance in flats)
    return level_e if is_clipped and level_e > 0 else None


def _discovery(part: MeasuredFrames | PicturePart, *kinds: str) -> FrameData:
    """Frames of some kinds of the discovery split, selected without reading the others."""
    return FrameData(part.frames, [i for i in part.folds.find if part.frames.records[i].kind in kinds])


def _brightest(part: MeasuredFrames | PicturePart) -> np.ndarray | None:
    """(H, W) mean of the flats of the highest level, DN; None without flats."""
    flats = _discovery(part, "flat").of("flat", 1)
    return max(flats, key=lambda g: g.level).mean if flats else None


def stuck(dark: np.ndarray, bright: np.ndarray | None, camera: Camera) -> np.ndarray:
    """Values of the pixels that do not answer light, see `FrameSummary.stuck`; none where most pixels hardly do.

    Args:
        dark, bright: (H, W) mean frames without light and of the brightest flats, DN.
    """
    if bright is None or bright.shape != dark.shape:
        return np.zeros(0)
    answer = bright - dark
    typical = float(np.median(answer))
    if typical < CLEAR * MAD * float(np.median(np.abs(answer - typical))):
        return np.zeros(0)
    black, top = float(np.median(dark)), 2**camera.bit_depth - 1
    above = dark[np.abs(answer) < DEAD * typical] - black
    return np.where(above < 0, above / max(black, 1.0), above / (top - black))


def _spilled(part: MeasuredFrames | PicturePart, camera: Camera) -> Iterator[np.ndarray]:
    """Charge that overflows full wells in each scene of the discovery frames."""
    frames = part.frames
    for i in part.folds.find:
        record = frames.records[i]
        if record.kind == "scene" and record.clean:
            gain = camera.gain_at(record.gain_db)
            light_e = frames.clean(i) * camera.spec.quantum_efficiency
            seen_e = (frames.read(i) - camera.spec.black_level_dn) * gain
            highest_e = (2**camera.bit_depth - 1 - camera.spec.black_level_dn) * gain
            yield spilled(light_e, seen_e, min(camera.spec.full_well_e or highest_e, highest_e))


def spilled(light_e: np.ndarray, seen_e: np.ndarray, well_e: float) -> np.ndarray:
    """(n, 3) electrons per column with an overflow: above the full well, in the filled pixels above it, and in those below it.

    Filled pixels are those next to it up to and including the first that is not full. Columns are omitted whose charge
    reaches an edge, or comes from two places.

    Args:
        light_e, seen_e: (H, W) electrons expected from the light, and as read.
    """
    found = []
    for light, seen in zip(light_e.T, seen_e.T, strict=True):
        over = np.flatnonzero(light > well_e)
        if len(over) == 0 or over[-1] - over[0] >= len(over):
            continue
        above, below = slice(over[0]), slice(over[-1] + 1, None)
        filled = [
            _filled(light[above][::-1], seen[above][::-1], well_e),
            _filled(light[below], seen[below], well_e),
        ]
        if None not in filled:
            found.append([(light[over] - well_e).sum(), *filled])
    return np.array(found, float).reshape(-1, 3)


def _filled(light: np.ndarray, seen: np.ndarray, well_e: float) -> float | None:
    """Excess electrons in the first pixels of a line while these are full; None if all are."""
    is_full = seen > FULL * well_e
    if is_full.all():
        return None
    return float((seen - light)[: int(is_full.argmin()) + 1].sum())


def tracks(darks: Iterable[GroupData], camera: Camera) -> np.ndarray:
    """(n, 2): pixels, and electrons in all of them, of each connected region that is bright in a single frame.

    The excess over the median of all frames (with two frames, over the other) must exceed the noise of the frame and the shot
    noise of the pixel by a large factor, so that hot pixels are excluded.
    """
    found = [np.zeros((0, 2))]
    for dark in darks:
        frames_e = dark.frames * camera.gain_at(dark.group.gain_db)
        middle = [np.median(frames_e, 0)] * dark.count if dark.count > 2 else frames_e[::-1]
        for frame, usual in zip(frames_e, middle, strict=True):
            excess = frame - usual
            noise = MAD * np.median(np.abs(excess - np.median(excess)))
            hot = np.maximum(usual - np.median(usual), 0)
            places = np.zeros(frame.shape, int)
            label(excess > STRUCK * np.sqrt(noise**2 + 2 * hot), np.ones((3, 3)), output=places)
            sums = [np.bincount(places.ravel(), weights) for weights in (None, excess.ravel())]
            found.append(np.stack(sums, 1, dtype=float)[1:])
    return np.concatenate(found)
