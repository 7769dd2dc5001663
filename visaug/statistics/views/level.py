"""Mean levels: the signal and its dependence on light, exposure and temperature."""

import numpy as np

from visaug.statistics.view import Curve, Picture, View


class Level(View):
    """Mean level of each group of frames."""

    name = "level"
    title = "Mean level"

    def measure(self, data):
        for g in data.groups:
            if g.kind != "scene":
                yield g.statistic(self.name, "mean", ["level"], "DN"), g.signal

    def picture(self, data):
        curves = []
        for kind in ("dark", "flat"):
            groups = data.of(kind)
            if groups:
                x = np.array(
                    [
                        g.group.photons if kind == "flat" and g.group.photons else g.group.exposure_s
                        for g in groups
                    ]
                )
                order = np.argsort(x)
                curves.append(Curve(x[order], np.array([g.signal for g in groups])[order], kind))
        if not curves:
            return None
        return Picture(
            self.title,
            "photons per pixel, or exposure in s",
            "mean above bias, DN",
            tuple(curves),
            log_x=True,
            log_y=True,
        )


class Drift(View):
    """How the level of whole frames changes from frame to frame."""

    name = "drift"
    title = "Level of whole frames in order of acquisition"

    def measure(self, data):
        for kind in ("bias", "dark", "flat"):
            groups = data.of(kind, at_least=2)
            if not groups:
                continue
            spread = [
                (g.frame_means - g.frame_means.mean()) * np.sqrt(g.count / (g.count - 1)) for g in groups
            ]
            expected = [np.sqrt(g.noise_variance / g.mean.size) for g in groups]
            ratio = np.concatenate([s / e for s, e in zip(spread, expected, strict=True)])
            first = groups[0]
            yield first.statistic(self.name, f"{kind} frames", ["time"]), np.log(np.mean(ratio**2) + 0.1)
            if kind == "flat":
                relative = np.concatenate(
                    [s / max(g.signal, 1.0) for s, g in zip(spread, groups, strict=True)]
                )
                yield (
                    first.statistic(self.name, "flat frames, relative", ["time"]),
                    np.log(np.sqrt(np.mean(relative**2)) + 1e-6),
                )
        bias = data.bias
        if bias is not None and bias.count >= 4:
            steps = np.diff(bias.frame_means)
            about = bias.frame_means - bias.frame_means.mean()
            slow = np.mean(steps**2) / max(2 * np.mean(about**2), 1e-12)
            yield bias.statistic(self.name, "step to spread", ["time"]), np.log(slow + 0.02)
            order = np.linspace(-1, 1, bias.count)
            yield (
                bias.statistic(self.name, "slope", ["time"], "DN"),
                float(np.polyfit(order, bias.frame_means, 1)[0]),
            )

    def picture(self, data):
        curves = []
        for g in data.groups:
            if g.kind in ("bias", "flat") and g.count >= 2:
                x = np.array([data.records[i].sequence for i in g.group.indices])
                curves.append(Curve(x, g.frame_means - g.frame_means.mean(), g.label))
        return (
            Picture(self.title, "sequence", "frame mean, less the group's, DN", tuple(curves))
            if curves
            else None
        )
