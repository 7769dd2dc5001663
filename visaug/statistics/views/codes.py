"""Which DN codes come, and how often."""

import numpy as np

from visaug.statistics.stack import added
from visaug.statistics.view import Curve, View, ViewPlot
from visaug.statistics.views.drawn import chosen

NEIGHBOURS = np.array([1, 2, 3, 0, 3, 2, 1]) / 12  # of a code: weights with which they predict its frequency
SIDE = len(NEIGHBOURS) // 2
FOLD = 16  # codes, after which the lowest four bits repeat


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
            low = np.array([counts[k::FOLD].sum() for k in range(FOLD)])  # exact: whole numbers
            for bit in range(4):
                odd = low[np.arange(FOLD) >> bit & 1 > 0].sum() / size
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

    def draw(self, data, name, group):
        kind = name.split(":")[0]
        groups = {"dark": data.darks, "flat": data.of("flat")}.get(kind) or [
            g for g in (chosen(data, group),) if g
        ]
        if not groups:
            return None
        counts, said = added([g.noise.codes for g in groups]).astype(np.float64), f"{groups[0].kind} frames"
        if ": bit" in name:
            share = np.bincount(np.arange(len(counts)) % FOLD, counts, FOLD) / counts.sum()
            x, bit = np.arange(FOLD), int(name.split()[2])
            odd = tuple((k - 0.4, k + 0.4) for k in x if k >> bit & 1)
            curve = Curve(x, share, said)
            return ViewPlot(self.title, f"DN code modulo {FOLD}", "share of pixels", (curve,), marks=odd)
        present = np.flatnonzero(counts)
        middle = int(np.searchsorted(counts.cumsum(), counts.sum() / 2))
        at = {"dark: at zero": 0, "flat: at the highest code": len(counts) - 1}.get(name, middle)
        near = 60  # codes on either side, in the picture
        if kind == "flat" and at == middle and len(present) > 4 * near:  # where codes are fullest
            at = int(np.convolve(counts, np.ones(near), "same").argmax())
        x = np.arange(max(0, at - near), min(len(counts), at + near + 1))
        marks = ((at - 0.5, at + 0.5),) if at in (0, len(counts) - 1) else ()
        curve = Curve(x, np.maximum(counts[x], 0.5), said)
        return ViewPlot(self.title, "DN code", "pixels", (curve,), log_y=True, marks=marks)
