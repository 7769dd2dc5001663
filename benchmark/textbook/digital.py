"""Effects in whole DN."""

from __future__ import annotations

import numpy as np

from .effect import Effect, Moment


class MissingCodes(Effect):
    """Some codes of the converter never come: a differential nonlinearity of -1 (Janesick).

    law: scatter, where they lie anywhere and go to the next code below or above, or sar, where a converter by successive
    approximation swallows one at each carry into a high bit; fraction: share of the codes (a power of two for sar); key: which.
    """

    def prepare(self) -> None:
        codes = 2**self.camera.bits
        code, rng = np.arange(codes), np.random.default_rng(self.numbers["key"])
        carries = self.numbers["law"] == "sar"
        if carries:
            every = 2 ** round(np.log2(1 / self.numbers["fraction"]))
            gone = (code % every) == every - 1
        else:
            gone = rng.random(codes) < self.numbers["fraction"]
        gone[[0, -1]] = False
        there = code[~gone]
        above = there[np.minimum(np.searchsorted(there, code), len(there) - 1)]
        below = there[np.maximum(np.searchsorted(there, code, "right") - 1, 0)]
        instead = below if carries else np.where(rng.random(codes) < 0.5, below, above)
        self.table = np.where(gone, instead, code)

    def code(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return self.table[x]


class BitTruncation(Effect):
    """The lowest bits of the rounded code are zero, so the mean falls by half of what they hold.

    bits: how many.
    """

    def code(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return (x >> self.numbers["bits"]) << self.numbers["bits"]
