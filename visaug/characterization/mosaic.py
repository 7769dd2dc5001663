"""Colour mosaics: whether pixels of a 2 x 2 answer to different light, from the header or from the flats."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.characterization.facts import PLACES, Facts
from visaug.frames import FrameSet

PLAIN = 0.02  # of the signal: neighbours on a diagonal of a monochrome sensor differ by less


@dataclass(frozen=True)
class Mosaic:
    """Response of the four places of a 2 x 2 over their mean, and their names.
    The greens are the diagonal whose two places are more alike, unless the header tells the pattern.
    """

    response: tuple[float, float, float, float]
    pattern: str | None
    contradicted: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        if self.pattern is None:
            return tuple(f"{r}{c}" for r, c in PLACES)
        rows = (self.pattern[:2], self.pattern[2:])
        return tuple(f"G{'r' if 'R' in row else 'b'}" if c == "G" else c for row in rows for c in row)

    @property
    def green(self) -> tuple[int, int]:
        """Positions in `PLACES` of the two greens."""
        if self.pattern is not None:
            return self.pattern.index("G"), self.pattern.rindex("G")
        r = self.response
        return (0, 3) if abs(r[0] - r[3]) < abs(r[1] - r[2]) else (1, 2)

    def map(self, shape: tuple[int, int]) -> np.ndarray:
        """(H, W) response of every pixel's colour over the mean."""
        tile = np.array(self.response).reshape(2, 2)
        return np.tile(tile, ((shape[0] + 1) // 2, (shape[1] + 1) // 2))[: shape[0], : shape[1]]


def find_mosaic(frames: FrameSet, facts: Sequence[Facts]) -> Mosaic | None:
    """The mosaic that a header tells or bright flats show; None for a monochrome sensor.
    Where the two places that a header calls green differ, and those of the other diagonal are alike, the flats are believed, and
    `contradicted` says so.
    Rows or columns that differ, odd from even, make no mosaic: there the sums of both diagonals are alike.
    """
    told = {r.bayer for r in frames.records if r.bayer is not None}
    dark = [f for r, f in zip(frames.records, facts) if r.kind in ("bias", "dark")]
    flats = [f for r, f in zip(frames.records, facts) if r.kind == "flat"]
    if not dark or not flats:
        return None
    floor = np.median([f.phases for f in dark], axis=0)
    signals = np.array([f.phases for f in flats]) - floor
    level = signals.mean(1)
    bright = (level > 0.2 * level.max()) & (np.array([f.at_largest for f in flats]) < 1e-3)
    if not bright.any():
        return None
    response = np.median(signals[bright] / level[bright, None], axis=0)
    crossed = abs(response[0] + response[3] - response[1] - response[2]) / 4
    pattern = told.pop() if len(told) == 1 else None
    contradicted = None
    if pattern is not None and _contradicted(pattern, response):
        contradicted = (
            f"mosaic_contradicted: the header's pattern {pattern} calls two pixels green that respond differently, while the "
            "other two are alike; the greens are those that the flats show, red and blue are not told apart"
        )
        pattern = None
    if pattern is None and contradicted is None and crossed < PLAIN:
        return None
    a, b, c, d = map(float, response)
    return Mosaic((a, b, c, d), pattern, contradicted)


def _contradicted(pattern: str, response: np.ndarray) -> bool:
    """Whether the flats show the greens on the other diagonal than the pattern: a colour is no plain difference of two greens."""
    places = [[i for i, c in enumerate(pattern) if (c == "G") == green] for green in (True, False)]
    greens, others = (abs(float(np.subtract(*response[pair]))) for pair in places)
    # of the signal: crosstalk from red and blue parts the greens of one sensor by a few per cent
    return greens > max(0.08, others)
