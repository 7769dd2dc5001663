"""What the steps of a characterization write into, one after the other."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

FALSE_ALARM = 0.001  # probability that a check warns of, or mends, frames that meet the measurement model
# parameters that need the noise of the frames to be that of single pixels
FROM_NOISE = ("gain_e_per_dn", "quantum_efficiency", "read_noise.*", "full_well_e", "prnu.*", "dsnu.*", "dark_current.*",
              "temporal.*", "emva.*", "emva4.*", "emva4_corrected.*")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure with its 95 % interval for the camera's own parameter, its unit, how it was found, and what was assumed."""

    value: float
    low: float
    high: float
    unit: str
    source: str
    assumes: str = ""

    def to_json(self) -> dict[str, Any]:
        content = {
            "value": float(self.value),
            "low": float(self.low),
            "high": float(self.high),
            "unit": self.unit,
            "from": self.source,
        }
        return {**content, "assumes": self.assumes} if self.assumes else content


@dataclass
class MeasuredGain:
    """DN per electron at the base gain, its relative standard error, and whether it was measured."""

    dn_per_e: float
    relative_error: float
    measured: bool


@dataclass
class Findings:
    """Parameters found so far, what stays open, warnings, curves, maps and effects.

    `spoils` holds, by warning, patterns of the parameters whose value or interval it puts in doubt.
    """

    parameters: dict[str, Estimate] = field(default_factory=dict)
    open: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    curves: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    maps: dict[str, np.ndarray] = field(default_factory=dict)
    spoils: dict[str, tuple[str, ...]] = field(default_factory=dict)
    gain: MeasuredGain | None = None
    bit_depth: int | None = None
    dark_rate: tuple[float, float | None] | None = None  # e-/s and its temperature, where no law is known
    bend_per_e: float | None = None  # c of the response e (1 + c e), where it bends beyond doubt
    effects: list[dict[str, Any]] = field(default_factory=list)  # of a camera.yaml, beyond the base chain
    assumed: list[str] = field(default_factory=list)  # paths of a camera.yaml that nothing measured
    stuck: np.ndarray | None = None  # (H, W) pixels that do not answer to light
    response_place: Any = None  # size and window of the map `response`
    # whether pixels were mixed after they were read: rows and columns then share noise too
    filtered: bool = False
    dark_current_error: float = 0.0  # standard error of a usual pixel of the map `dark_current`
    dark_current_at_c: float | None = None  # temperature of that map
    smoothed: bool = False  # whether all noise correlates alike: one filter over everything
    lit: tuple[int, int, int, int] | None = None  # rows and columns that see light, where others see none
    banded: frozenset[int] = frozenset()  # sequence numbers of flats in which bands of a lamp roll
    apart: frozenset[int] = (
        frozenset()
    )  # sequence numbers of sound frames that no model of the camera describes
    apart_because: tuple[str, ...] = ()  # the warnings that say why
    # number of the light of each flat, by sequence number
    lights: dict[int, int] = field(default_factory=dict)
    has_one_light: bool = True  # False where all flats state the same photons and their levels differ
    step_dn: float = 1.0  # distance of neighbouring codes

    def add(
        self,
        name: str,
        interval: Iterable[float],
        unit: str,
        source: str,
        most: float = math.inf,
        assumes: str = "",
    ) -> None:
        """Keep an estimate; one that is not finite is kept as not determined."""
        value, low, high = (float(v) for v in interval)
        if not all(map(math.isfinite, (value, low, high))):
            self.miss(name, "more frames: its uncertainty is not determined")
            return
        self.open.pop(name, None)
        high = max(min(high, most), value)
        self.parameters[name] = Estimate(value, min(low, value), high, unit, source, assumes)

    def set_apart(self, sequences: Iterable[int], *because: str) -> None:
        """Frames that are not compared with a camera, by their sequence numbers, and the warnings that say why."""
        self.apart |= frozenset(sequences)
        self.apart_because += because

    def miss(self, name: str, needs: str) -> None:
        if name not in self.parameters:
            self.open.setdefault(name, needs)

    def drop(self, name: str, needs: str) -> None:
        """What was found is not determined after all."""
        self.parameters.pop(name, None)
        self.open[name] = needs

    def warn(self, text: str, spoils: Sequence[str] = ()) -> None:
        """A warning, ``word: sentence``.

        Args:
            spoils: parameters whose value or interval is not to be trusted; ``prnu.*`` stands for several.
        """
        if text not in self.warnings:
            self.warnings.append(text)
        self.spoils[text] = (*self.spoils.get(text, ()), *spoils)

    def warn_of(self, texts: Iterable[str]) -> None:
        for text in texts:
            self.warn(text)

    def warned(self, word: str) -> bool:
        return any(w.startswith(f"{word}:") for w in self.warnings)

    def withdraw(self, word: str) -> None:
        """Take a warning back, for one that says more of the same."""
        self.warnings = [w for w in self.warnings if not w.startswith(f"{word}:")]

    def spoiled_by(self, text: str) -> tuple[str, ...]:
        """Parameters found that a warning puts in doubt."""
        patterns = self.spoils.get(text, ())
        known = (*self.parameters, "bit_depth")
        return tuple(n for n in known if any(fnmatch.fnmatchcase(n, p) for p in patterns))
