"""What a frame keeps of the one before it."""

import numpy as np

from visaug.statistics.kernels import response
from visaug.statistics.view import Curve, Picture, View


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
        position = {record.sequence: i for i, record in enumerate(data.records)}
        condition = {i: k for k, g in enumerate(data.frames.groups()) for i in g.indices}
        sums = np.zeros(2)
        for g in data.of("flat", at_least=2):
            for i, mean in zip(g.group.indices, g.frame_means, strict=True):
                before = position.get(data.records[i].sequence - 1)
                if (
                    before is None
                    or condition[before] == condition[i]
                    or data.records[before].kind == "scene"
                ):
                    continue
                others = (g.frame_means.sum() - mean) / (g.count - 1)
                jump = _level(data, before) - others
                sums += (jump * (mean - others), jump**2)
        if data.of("flat", at_least=2):
            group = data.of("flat", at_least=2)[0]
            yield (
                group.statistic(self.name, "share of a step between flats", ["time"], "fraction"),
                sums[0] / max(sums[1], 1.0),
            )

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

    def picture(self, data):
        pairs = self._pairs(data)
        if not pairs:
            return None
        position = {record.sequence: k for k, record in enumerate(data.records)}
        curves = []
        for i in pairs[:3]:
            before = data.frames.read(position[data.records[i].sequence - 1])
            frame = data.frames.read(i)
            edges = np.unique(np.quantile(before, np.linspace(0, 1, 16)))
            place = np.digitize(before, edges[1:-1])
            steps = np.unique(place)  # equal levels may leave some of the steps empty
            x = np.array([before[place == k].mean() for k in steps])
            y = np.array([frame[place == k].mean() for k in steps])
            curves.append(Curve(x, y, f"dark after {data.records[i - 1].clean}"))
        return Picture(
            self.title,
            "DN in the frame before",
            "mean DN in the dark frame after it",
            tuple(curves),
            log_x=True,
        )


def _level(data, i: int) -> float:
    for g in data.groups:
        if i in g.group.indices:
            return float(g.frame_means[g.group.indices.index(i)])
    return float(data.stacks.frame(i).mean(dtype=np.float64))
