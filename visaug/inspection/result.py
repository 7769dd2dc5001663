"""The answer of an inspection."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from visaug.core.files import DEFECTS, write_text
from visaug.core.reporting import Reported
from visaug.frames import FrameSet
from visaug.inspection.finding import Finding, rounded


@dataclass(frozen=True)
class Measurement:
    """What frames of one kind and level measure, whether or not it is a finding; standard deviations in DN.

    Attributes:
        kind, frames: of them.
        level_dn: mean.
        temporal_noise_dn, pixel_pattern_dn: value, low, high; None of one frame.
        law: `normal` or `heavy tails`; None of one frame.
        excess_kurtosis: of the temporal noise.
    """

    kind: str
    frames: int
    level_dn: float
    temporal_noise_dn: dict[str, float] | None
    pixel_pattern_dn: dict[str, float] | None
    law: str | None
    excess_kurtosis: float | None

    def to_json(self) -> dict[str, Any]:
        return {name: rounded(getattr(self, name)) for name in self.__dataclass_fields__}


@dataclass(frozen=True)
class Inspection(Reported):
    """What a handful of frames tells of a camera.

    Attributes:
        findings: patterns beyond temporal noise and pixel non-uniformity, in the order of their evidence.
        kinds: number of frames by kind.
        kinds_from: by what the kinds were told.
        bits: of the converter; `bits_stated` says whether the files state them, else they are the fewest usual ones that hold
            the largest code.
        shift: by how many bits the codes are moved up in the files.
        measured: level and noise of each group of frames.
        ambiguous: what these frames cannot tell, one sentence each.
        more: which frames would tell more, one sentence each.
        notes: what was left out or assumed.
        next_command: the command that follows.
    """

    frames: FrameSet
    findings: tuple[Finding, ...]
    kinds: dict[str, int]
    kinds_from: str
    bits: int
    bits_stated: bool
    shift: int
    measured: tuple[Measurement, ...]
    ambiguous: tuple[str, ...]
    more: tuple[str, ...]
    notes: tuple[str, ...]
    next_command: str

    @property
    def answer(self) -> str:
        """One sentence."""
        if self.findings:
            most = 4  # findings in the answer
            said, left = "; ".join(f.short for f in self.findings[:most]), len(self.findings) - most
            return said + (f"; and {left} more" if left > 0 else "") + self._doubt
        if not self.measured:
            return "nothing could be measured in these frames"
        first = self.measured[0]
        noise = first.temporal_noise_dn
        told = f"temporal noise of {noise['value']:.2g} DN ({first.law}), " if noise else ""
        return f"no pattern found: {told}level {first.level_dn:.4g} DN{self._doubt}"

    @property
    def _doubt(self) -> str:
        """Where all frames are of one exposure."""
        if len(self.frames) > 1 and all(m.temporal_noise_dn is None for m in self.measured):
            return " (all frames are copies of one exposure, or single: fixed and new cannot be told apart)"
        return ""

    @property
    def places(self) -> Iterator[tuple[int, int, str, float]]:
        """Row, column, type and height in DN of all defects; -1 stands for a whole line."""
        for finding in self.findings:
            yield from finding.places

    def to_json(self) -> dict[str, Any]:
        """The content of `visaug inspect --json`."""
        content: dict[str, Any] = {"schema": 1, "answer": self.answer, "frames": len(self.frames)}
        content |= {
            name: getattr(self, name) for name in ("kinds", "kinds_from", "bits", "bits_stated", "shift")
        }
        content["measured"] = [m.to_json() for m in self.measured]
        content["findings"] = [f.to_json() for f in self.findings]
        content |= {name: list(getattr(self, name)) for name in ("ambiguous", "more", "notes")}
        return content | {"next": self.next_command}

    def save_defects(self, path: str | Path) -> Path:
        """Write the places of defects as CSV, one a line; the missing number of a line defect is left blank."""
        text = DEFECTS
        for row, column, kind, height in self.places:
            text += f"{'' if row < 0 else row},{'' if column < 0 else column},{kind},{height:.4g}\n"
        write_text(path, text)
        return Path(path)
