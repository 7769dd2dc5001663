"""Which DN codes come, and how often."""

import numpy as np

from visaug.statistics.stack import added
from visaug.statistics.view import Curve, Picture, View

NEIGHBOURS = np.array([1, 2, 3, 0, 3, 2, 1]) / 12  # of a code: weights with which they predict its frequency
SIDE = 3


class Codes(View):
    """Lost bits, codes that never come, the comb of a digital gain."""

    name = "codes"
    title = "DN codes in use"

    def measure(self, data):
        for kind, groups in (("dark", data.darks), ("flat", data.of("flat"))):
            if not groups:
                continue
            counts = added([g.noise.codes for g in groups]).astype(np.float64)
            first, size = groups[-1], counts.sum()
            for bit in range(4):
                odd = counts.reshape(-1)[(np.arange(len(counts)) >> bit & 1).astype(bool)].sum() / size
                yield first.statistic(self.name, f"{kind}: bit {bit} set", ["level"], "share"), odd
            # mode="same" would be longer than the counts of fewer codes than these
            expected = np.convolve(counts, NEIGHBOURS)[SIDE:-SIDE]
            filled = expected > 25
            filled[0] = filled[-1] = False
            never = np.count_nonzero(filled & (counts < 0.2 * expected))  # one or two do so by chance
            yield (
                first.statistic(self.name, f"{kind}: codes that never come", ["level"], "sqrt count"),
                np.sqrt(never),
            )
            uneven = (
                ((counts - expected)[filled] ** 2 / (expected[filled] * 1.2)).mean() if filled.any() else 1.0
            )
            yield (
                first.statistic(self.name, f"{kind}: unevenness", ["level"], "log ratio"),
                np.log(uneven + 0.1),
            )
            if kind == "dark":
                yield (
                    first.statistic(self.name, "dark: at zero", ["level"], "sqrt count"),
                    np.sqrt(counts[0]),
                )
            else:
                highest = first.statistic(self.name, "flat: at the highest code", ["level"], "sqrt count")
                yield highest, np.sqrt(counts[-1])

    def picture(self, data):
        g = data.bias or next(iter(data.groups), None)
        if g is None:
            return None
        counts = g.noise.codes
        middle = int(np.searchsorted(counts.cumsum(), counts.sum() / 2))
        x = np.arange(max(0, middle - 60), min(len(counts), middle + 61))
        return Picture(
            self.title, "DN code", "pixels", (Curve(x, np.maximum(counts[x], 0.5), g.label),), log_y=True
        )
