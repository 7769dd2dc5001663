"""Patterns that were found in frames, how improbable it is that clean frames show them, and the answer of an inspection."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from scipy import stats

from visaug.core.files import DEFECTS, write_text
from visaug.core.intervals import Z
from visaug.core.reporting import Reported
from visaug.frames import FrameSet

# Probability that any finding at all is named in frames without patterns, over the decisions about one group of frames, all
# detectors together; each divides it further by the places that it looks at.
ALPHA = 0.01 / 40


class Size(TypedDict):
    """An amplitude with its 95 % interval, DN."""

    amplitude_dn: float
    low: float
    high: float


@dataclass(frozen=True)
class Finding:
    """A pattern in the frames.

    Attributes:
        what: its name, as `row_banding`.
        kind: `fixed` (the same in every frame), `per_frame` (new in each), None where the frames do not tell.
        amplitude_dn: standard deviation, of a sine its peak, of defects their typical height; None for shares and codes.
        low, high: its 95 % interval.
        period: of a periodic pattern, in lines.
        share: of the pixels, lines or codes concerned.
        text: one sentence.
        short: a few words for the answer.
        evidence: twice the logarithm of a likelihood ratio; findings are in its order.
        axis: `row` or `column`, None where it has no direction.
        nature: `offset` or `gain`, None where only one level of light was seen.
        details: further figures by name; the units are in the names.
        places: of defects: (row, column, type, height in DN); -1 stands for a whole line.
        shown: arrays of the picture by name.
    """

    what: str
    kind: str | None
    text: str
    short: str
    evidence: float
    amplitude_dn: float | None = None
    low: float | None = None
    high: float | None = None
    period: float | None = None
    share: float | None = None
    axis: str | None = None
    nature: str | None = None
    details: dict[str, Any] = field(default_factory=dict)
    places: tuple[tuple[int, int, str, float], ...] = ()
    shown: dict[str, Any] = field(default_factory=dict, compare=False)

    def to_json(self) -> dict[str, Any]:
        """The keys of the program's JSON; figures with six digits."""
        sizes = ("amplitude_dn", "low", "high", "period", "share")
        names = ("what", "kind", *sizes, "axis", "nature", "text", "details")
        return {name: rounded(getattr(self, name)) for name in names}


def some(items: Sequence[object], most: int) -> str:
    """The first of a list, and three dots where there are more."""
    return ", ".join(map(str, items[:most])) + (" ..." if len(items) > most else "")


def rounded(value: Any) -> Any:
    """Figures with six digits, in plain types; None for what is not finite."""
    if isinstance(value, dict):
        return {name: rounded(v) for name, v in value.items()}
    if isinstance(value, float | np.floating):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [rounded(v) for v in value]
    return int(value) if isinstance(value, np.integer) else value


def needed(trials: float = 1.0, freedom: float = 1.0) -> float:
    """Twice the log likelihood ratio that clean frames exceed with probability ALPHA in any of `trials` places."""
    return float(stats.chi2.isf(ALPHA / max(trials, 1.0), freedom))


def needed_t(trials: float, freedom: float) -> float:
    """Square of Student's t that clean frames exceed with probability ALPHA in any of `trials` places."""
    return float(stats.t.isf(ALPHA / max(trials, 1.0) / 2, max(freedom, 4.0)) ** 2)


def needed_f(trials: float, freedom: float, times: float) -> float:
    """The same as `needed` for a power over a level that `times` as many others tell (R. Fisher, 1929)."""
    return float(freedom * stats.f.isf(ALPHA / max(trials, 1.0), freedom, max(freedom * times, 4.0)))


def needed_z(trials: float = 1.0) -> float:
    """The same as a two-sided number of standard deviations."""
    return float(stats.norm.isf(ALPHA / max(trials, 1.0) / 2))


def about(value: float, error: float) -> Size:
    """Amplitude and interval from a value and its standard error; an amplitude is not negative."""
    return {"amplitude_dn": value, "low": max(value - Z * error, 0.0), "high": value + Z * error}


def deviation(mean_square: float, freedom: float, floor: float) -> Size:
    """The same for the root of a mean square of chi-square spread less a known floor."""
    low, high = (freedom / stats.chi2.ppf(q, freedom) for q in (0.975, 0.025))
    factors = min(low, 1.0), 1.0, max(high, 1.0)
    low, value, high = (math.sqrt(max(mean_square * k - floor, 0.0)) for k in factors)
    return {"amplitude_dn": value, "low": low, "high": high}


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
        kinds_from: source of the kinds: the table, headers, file names, or level and structure.
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
        facts = "kinds", "kinds_from", "bits", "bits_stated", "shift"
        content |= {name: getattr(self, name) for name in facts}
        content |= {name: [one.to_json() for one in getattr(self, name)] for name in ("measured", "findings")}
        content |= {name: list(getattr(self, name)) for name in ("ambiguous", "more", "notes")}
        return content | {"next": self.next_command}

    def save_defects(self, path: str | Path) -> Path:
        """Write the places of defects as CSV, one a line; the missing number of a line defect is left blank."""
        text = DEFECTS
        for row, column, kind, height in self.places:
            text += f"{'' if row < 0 else row},{'' if column < 0 else column},{kind},{height:.4g}\n"
        write_text(path, text)
        return Path(path)
