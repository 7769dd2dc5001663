"""Which pixels of a stored image see light, where they lie on the detector, and the colours of their mosaic."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from visaug.frames.record import MOSAICS, Window
from visaug.frames.units import number_or_none

_LIGHT = ("TRIMSEC", "DATASEC", "CCDSEC")
_DARK = ("BIASSEC", "OVERSCAN", "OVERSC")
_PATTERN = ("BAYERPAT", "COLORTYP", "CFAPAT")


@dataclass(frozen=True)
class Layout:
    """How the pixels of one stored image become a frame."""

    kept: Window | None  # rows and columns that see light, None for all
    overscan: str  # what the header says of the others, "" for nothing
    flipped: tuple[bool, bool]  # whether rows, columns run against the detector's (a DETSEC that falls)
    window: Window | None  # where the frame lies on the detector, None where it is all of it
    bayer: str | None  # colours at the frame's own pixel (0, 0), None for a monochrome sensor

    def tell(self, facts: dict[str, Any]) -> None:
        """Adds window, colours and what is cut off to the facts of a header."""
        facts["window"], facts["bayer"] = self.window, self.bayer
        if self.overscan:
            facts["said"]["overscan"] = self.overscan

    def cut(self, pixels: np.ndarray) -> np.ndarray:
        """Of (..., rows, columns) the part that sees light."""
        if self.kept is None:
            return pixels
        r0, r1, c0, c1 = self.kept
        return pixels[..., r0:r1, c0:c1]


def layout_of(header: Mapping[str, Any], shape: tuple[int, ...]) -> Layout:
    """The layout that a header tells for an image of (..., rows, columns)."""
    rows, columns = shape[-2:]
    place = _section(header.get("DETSEC"))
    kept, overscan = _kept(header, rows, columns, place is None)
    height, width = (rows, columns) if kept is None else (kept[1] - kept[0], kept[3] - kept[2])
    window, flipped = None, (False, False)
    if place is not None and (place[0][1] - place[0][0], place[0][3] - place[0][2]) == (height, width):
        whole = _section(header.get("DETSIZE"))
        window, flipped = (None if whole is not None and whole[0] == place[0] else place[0]), place[1]
    elif place is None:
        window = _subframe(header, height, width)
    top, left = (kept[0], kept[2]) if kept else (0, 0)
    corner = top + (height - 1) * flipped[0], left + (width - 1) * flipped[1]
    return Layout(kept, overscan, flipped, window, _mosaic(header, rows, corner))


def _kept(header: Mapping[str, Any], rows: int, columns: int, alone: bool) -> tuple[Window | None, str]:
    """The part that sees light by TRIMSEC or DATASEC, else by CCDSEC or what BIASSEC or OVERSCAN leave at one side."""
    told = [f"{k} {str(header[k]).strip()}" for k in (*_LIGHT, *_DARK) if _section(header.get(k))]
    for key in _LIGHT if alone else _LIGHT[:2]:  # with DETSEC, CCDSEC counts from the detector's corner
        section = _section(header.get(key))
        if section is None:
            continue
        r0, r1, c0, c1 = section[0]
        if (r1 - r0, c1 - c0) == (rows, columns):
            if key != "CCDSEC":
                return None, ""
        elif r1 <= rows and c1 <= columns:
            return section[0], ", ".join(told)
    for key in _DARK:
        section = _section(header.get(key))
        if section is not None and (left := _rest(section[0], rows, columns)) is not None:
            return left, ", ".join(told)
    dark = [k for k in _DARK if _section(header.get(k))]
    return None, f"{', '.join(told)}: not cut off, it lies at no edge" if dark else ""


def _rest(dark: Window, rows: int, columns: int) -> Window | None:
    """The larger part beside dark columns (or rows) that lie at an edge; None where they do not."""
    r0, r1, c0, c1 = dark
    if r1 > rows or c1 > columns:
        return None
    parts = [(0, rows, 0, c0), (0, rows, c1, columns)] if c1 - c0 < columns and 2 * (r1 - r0) > rows else []
    if r1 - r0 < rows and 2 * (c1 - c0) > columns:
        parts += [(0, r0, 0, columns), (r1, rows, 0, columns)]
    parts.sort(key=lambda p: (p[1] - p[0]) * (p[3] - p[2]))
    small = parts[-2] if len(parts) > 1 else (0, 0, 0, 0)
    if not parts or len(parts) > 2 or (small[1] - small[0]) * (small[3] - small[2]) > 0.1 * rows * columns:
        return None  # in the middle, between two halves
    return parts[-1]


def _section(text: Any) -> tuple[Window, tuple[bool, bool]] | None:
    """``[x0:x1,y0:y1]`` or ``[x0 x1 y0 y1]``, counted from 1, as rows and columns; and whether rows, columns fall."""
    match = re.fullmatch(r"\s*\[\s*(\d+)[:\s]+(\d+)[,\s]+(\d+)[:\s]+(\d+)\s*\]\s*", str(text))
    if match is None:
        return None
    x0, x1, y0, y1 = (int(n) for n in match.groups())
    if min(x0, x1, y0, y1) < 1:
        return None
    window = (min(y0, y1) - 1, max(y0, y1), min(x0, x1) - 1, max(x0, x1))
    return window, (y0 > y1, x0 > x1)


def _mosaic(header: Mapping[str, Any], rows: int, corner: tuple[int, int]) -> str | None:
    """Colours at the stored pixel `corner` and its neighbours, from the pattern, XBAYROFF, YBAYROFF and ROWORDER.

    The pattern counts from the picture's top; in a file with ROWORDER = BOTTOM-UP the last row is the top one.
    """
    pattern = next((p for k in _PATTERN if (p := str(header.get(k, "")).strip().upper()) in MOSAICS), None)
    if pattern is None:
        return None
    row, column = corner
    if str(header.get("ROWORDER", "")).strip().upper().startswith("BOTTOM"):
        row = rows - 1 - row
    down, across = (int(number_or_none(header.get(key)) or 0) for key in ("YBAYROFF", "XBAYROFF"))
    places = [((row + r + down) % 2, (column + c + across) % 2) for r in (0, 1) for c in (0, 1)]
    return "".join(pattern[2 * r + c] for r, c in places)


def _subframe(header: Mapping[str, Any], height: int, width: int) -> Window | None:
    """The window of a camera program's subframe (XORGSUBF, YORGSUBF, in pixels as binned)."""
    try:
        column, row = int(header.get("XORGSUBF", 0)), int(header.get("YORGSUBF", 0))
    except (TypeError, ValueError):
        return None
    return (row, row + height, column, column + width) if (row > 0 or column > 0) else None
