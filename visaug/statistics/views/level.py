"""Mean levels: the signal and its dependence on light, exposure and temperature."""

import numpy as np

from visaug.statistics.view import Curve, View, ViewPlot
from visaug.statistics.views.drawn import below_saturation, chosen, condition, relative


class Level(View):
    """Mean level of each group of frames."""

    name = "level"
    title = "Mean level"

    def measure(self, data):
        for g in data.groups:
            if g.kind != "scene":
                yield g.statistic(self.name, "mean", ["level"], "DN"), g.signal

    def draw(self, data, name, group):
        g = chosen(data, group or next(iter(data.of("flat")), None))
        if g is None:
            return None
        groups = [o for o in data.of(g.kind) if o.group.gain_db == g.group.gain_db]
        if g.kind == "flat":
            groups = below_saturation([o for o in groups if o.group.photons or o.group.exposure_s])
            groups += [g] * (g not in groups)
        label, x = condition(groups) if groups else ("", np.zeros(0))
        if len(np.unique(x)) < 2:
            return _frame_levels(data, g)
        if label != "temperature, °C":
            same = [o.group.temperature_c == g.group.temperature_c for o in groups]
            groups, x = [o for o, s in zip(groups, same, strict=True) if s], x[same]
        if len(np.unique(x)) < 2:
            return _frame_levels(data, g)
        y = np.array([o.signal for o in groups])
        what = "mean above bias, DN"
        if g.kind == "flat":  # of a straight line one sees no change of its slope over decades
            what = f"mean above bias per {'photon' if 'photons' in label else 'second'}, DN"
            y = y / np.maximum(x, 1e-12)
        order, at = np.argsort(x), float(x[groups.index(g)]) if g in groups else float(x[-1])
        curve = Curve(x[order], y[order], f"{g.kind} frames")
        return ViewPlot(
            self.title, label, what, (curve,), log_x=g.kind == "flat", marks=((at, at),) if group else ()
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
            slope = float(order @ about / (order @ order))
            yield bias.statistic(self.name, "slope", ["time"], "DN"), slope

    def draw(self, data, name, group):
        kind = name.split()[0] if name.split()[:1] and name.split()[0] in ("bias", "dark", "flat") else "bias"
        groups = data.of(kind, at_least=2) or [g for g in (chosen(data, group, 2),) if g]
        if not groups:
            return None
        is_flat = groups[0].kind == "flat"
        if is_flat:
            groups = below_saturation(groups)
        x = np.concatenate([[data.records[i].sequence for i in g.group.indices] for g in groups])
        y = np.concatenate(
            [(g.frame_means - g.frame_means.mean()) * (relative(g)[0] if is_flat else 1.0) for g in groups]
        )
        unit, order = "%" if is_flat else "DN", np.argsort(x, kind="stable")
        curve = Curve(x[order], y[order], f"{groups[0].kind} frames")
        return ViewPlot(
            self.title, "number of the frame", f"frame mean, less its condition's, {unit}", (curve,)
        )


def _frame_levels(data, g) -> ViewPlot | None:
    """The means of the frames of one condition; None for a single frame."""
    if g.count < 2:
        return None
    x = np.array([data.records[i].sequence for i in g.group.indices])
    curve = Curve(x, np.asarray(g.frame_means, float), g.label)
    return ViewPlot(Level.title, "number of the frame", "mean of the frame, DN", (curve,))
