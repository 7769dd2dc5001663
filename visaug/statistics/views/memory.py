"""What a frame keeps of the one before it."""

from collections.abc import Iterator

import numpy as np

from visaug.statistics.kernels import response
from visaug.statistics.view import Curve, View, ViewPlot

MOST = 6  # pairs of frames that are drawn


class Memory(View):
    """Response of a frame to the frame before it, where that was brighter or darker than itself."""

    name = "memory"
    title = "What a frame keeps of the one before"

    def measure(self, data):
        pairs = self._pairs(data)
        group = next((g for g in data.groups if g.kind == "dark"), data.bias)
        if pairs and group is not None:
            slopes = [self._slope(data, i) for i in pairs]
            yield (
                group.statistic(self.name, "slope on a bright scene before", ["time"], "fraction"),
                float(np.mean(slopes)),
            )
        yield from self._steps(data)

    def _steps(self, data):
        """How frames of a steady group differ from the others of it when another level came before."""
        sums = np.zeros(2)
        for jump, apart in self._jumps(data):
            sums += (jump * apart, jump**2)
        if data.of("flat", at_least=2):
            group = data.of("flat", at_least=2)[0]
            yield (
                group.statistic(self.name, "share of a step between flats", ["time"], "fraction"),
                sums[0] / max(sums[1], 1.0),
            )

    @staticmethod
    def _jumps(data) -> Iterator[tuple[float, float]]:
        """Of flats after another level: that level less the group's, and the frame less the others of its group, DN."""
        position = {record.sequence: i for i, record in enumerate(data.records)}
        # Of all frames, used or not: one of the same conditions is no step, and a simulated set may lack its pixels.
        conditions = {i: k for k, g in enumerate(data.frames.groups()) for i in g.indices}
        for g in data.of("flat", at_least=2):
            for i, mean in zip(g.group.indices, g.frame_means, strict=True):
                before = position.get(data.records[i].sequence - 1)
                if (
                    before is None
                    or conditions[before] == conditions[i]
                    or data.records[before].kind == "scene"
                ):
                    continue
                others = (g.frame_means.sum() - mean) / (g.count - 1)
                yield _level(data, before) - others, mean - others

    @staticmethod
    def _pairs(data) -> list[int]:
        position = {record.sequence: i for i, record in enumerate(data.records)}
        pairs = []
        for i in sorted(data.use):
            before = position.get(data.records[i].sequence - 1)
            if (
                data.records[i].kind in ("dark", "bias")
                and before is not None
                and data.records[before].kind == "scene"
            ):
                pairs.append(i)
        return pairs

    @staticmethod
    def _slope(data, i: int) -> float:
        position = {record.sequence: k for k, record in enumerate(data.records)}
        before = data.stacks.frame(position[data.records[i].sequence - 1])
        frame = data.stacks.frame(i)
        dark = np.zeros((0, 0), np.float32) if data.bias is None else data.bias.mean
        both, square = response(frame, before, dark if dark.shape == frame.shape else dark[:0, :0])
        return both / max(square, 1.0)

    def draw(self, data, name, group):
        pairs = self._pairs(data)
        if not pairs or name.startswith("share of a step"):
            return self._drawn_steps(data)
        position = {record.sequence: k for k, record in enumerate(data.records)}
        before = [data.frames.read(position[data.records[i].sequence - 1]) for i in pairs[:MOST]]
        after = [data.frames.read(i).astype(np.float64) for i in pairs[:MOST]]
        dark = 0.0 if data.bias is None else data.bias.mean
        values = np.concatenate([b.ravel() for b in before])
        left = np.concatenate([(a - (dark if np.shape(dark) == a.shape else 0)).ravel() for a in after])
        cuts = np.unique(np.quantile(values, np.linspace(0, 1, 16)))
        place = np.digitize(values, cuts[1:-1])
        steps = np.unique(place)  # equal levels may leave some of the steps empty
        x = np.array([values[place == k].mean() for k in steps])
        y = np.array([left[place == k].mean() for k in steps])
        curve = Curve(x, y, "dark frames after a scene")
        return ViewPlot(
            self.title, "level of the pixel in the frame before, DN", "mean above bias after it, DN", (curve,)
        )

    def _drawn_steps(self, data) -> ViewPlot | None:
        """Frames of a steady condition, by how much the frame before was brighter or darker."""
        points = sorted(self._jumps(data))
        if len({jump for jump, _ in points}) < 2:
            return None
        x, y = np.array(points).T
        return ViewPlot(
            self.title,
            "level of the frame before, less its own, DN",
            "frame mean less the others of its condition, DN",
            (Curve(x, y, "flat frames"),),
        )


def _level(data, i: int) -> float:
    for g in data.groups:
        if i in g.group.indices:
            return float(g.frame_means[g.group.indices.index(i)])
    return float(data.stacks.frame(i).mean(dtype=np.float64))
