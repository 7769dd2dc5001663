"""The verdict on one effect: named, absent, not separable or not testable."""

from dataclasses import dataclass
from typing import Any, Literal

Word = Literal["named", "absent", "not separable", "not testable"]


@dataclass(frozen=True)
class Verdict:
    """What frames show of one effect.

    Attributes:
        effect: its name.
        verdict: `named`; `absent`, below `limit`; `not separable` from others in these frames; `not testable` in these frames.
        parameter: path of its first strength.
        unit: of the strength.
        value, low, high: strength of a named effect with its 95 % interval.
        limit: upper limit of 95 % on the strength of an absent effect; the smallest strength that these frames would show of
            one that is not testable.
        others: effects and parameters of the camera from which it is not separable.
        frames: frames that would separate it, or show it.
    """

    effect: str
    verdict: Word
    parameter: str | None = None
    unit: str | None = None
    value: float | None = None
    low: float | None = None
    high: float | None = None
    limit: float | None = None
    others: tuple[str, ...] = ()
    frames: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        return {
            "effect": self.effect,
            "verdict": self.verdict,
            "parameter": self.parameter,
            "unit": self.unit,
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "limit": self.limit,
            "from": list(self.others) or None,
            "frames": list(self.frames) or None,
        }
