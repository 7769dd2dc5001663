"""Temporal noise: its size, its rows and columns, its covariance, its tails."""

import numpy as np

from visaug.statistics.fixed import mean_square_about
from visaug.statistics.stack import RATIOS
from visaug.statistics.view import Curve, View, ViewPlot
from visaug.statistics.views.drawn import below_saturation, chosen, correlation, direction, quantiles


class PhotonTransfer(View):
    """Temporal variance against mean level."""

    name = "photon_transfer"
    title = "Photon transfer: temporal variance against mean"

    def measure(self, data):
        for g in data.groups:
            if g.count >= 2 and g.kind != "scene":
                yield (
                    g.statistic(self.name, "variance", ["time", "pixel"], "log DN^2"),
                    np.log(g.noise_variance),
                )

    def draw(self, data, name, group):
        if group is not None and group.kind == "dark":
            kept = [g for g in data.darks if g.count >= 2 and g.kind == "dark"]
            kept = [g for g in kept if g.group.temperature_c == group.group.temperature_c]
            x_label, x = "exposure, s", [g.group.exposure_s for g in kept]
        else:
            flats = below_saturation([g for g in data.of("flat", 2) if g.reference])
            kept = [g for g in data.groups if g.count >= 2 and g.kind == "bias"] + flats
            if group is not None and group not in kept:
                kept.append(group)
            x_label, x = "mean above bias, DN", [g.signal if g.reference else 0.0 for g in kept]
        if len(np.unique(x)) < 2:
            return NoiseTails().draw(data, "", group)
        y, order = np.array([g.noise_variance for g in kept]), np.argsort(x)
        if (
            group is not None and group.kind == "bias"
        ):  # of a slope over the whole range one sees no change at its start
            return NoiseTails().draw(data, "width", group)
        at = [x[kept.index(group)]] if group in kept else []
        curve = Curve(np.array(x)[order], y[order])
        return ViewPlot(
            self.title, x_label, "temporal variance, DN²", (curve,), marks=tuple((a, a) for a in at)
        )


class TemporalLines(View):
    """Rows and columns that shift from frame to frame: their variance against that of white noise."""

    name = "temporal_lines"
    title = "Row and column noise that changes from frame to frame"

    def measure(self, data):
        for g in data.groups:
            if g.count < 2 or g.kind == "scene":
                continue
            height, width = g.mean.shape
            for name, lines, across in (("row", g.noise_rows, width), ("column", g.noise_columns, height)):
                ratio = across * mean_square_about(lines) / g.noise_variance
                yield g.statistic(self.name, f"{name}s", ["time", name], "log ratio"), np.log(ratio + 0.01)

    def draw(self, data, name, group):
        g, lines = chosen(data, group, 2), direction(name)
        if g is None:
            return None
        means = g.noise_rows if lines == "row" else g.noise_columns
        means = means - means.mean(1, keepdims=True)
        most = means[int((means**2).mean(1).argmax())]
        curve = Curve(np.arange(len(most)), most, f"{lines}s of the noisiest frame, {g.label}")
        return ViewPlot(
            self.title,
            lines,
            f"{lines} mean less the mean frame's, DN",
            (curve,),
        )


LAGS = {
    "one column on": (0, 1),
    "one row on": (1, 0),
    "diagonal": (1, 1),
    "two columns on": (0, 2),
    "two rows on": (2, 0),
}
FAR = {"4 columns on": (0, 4), "12 columns on": (0, 12), "4 rows on": (4, 0)}


class NoiseCovariance(View):
    """Whether neighbours share noise, and whether that grows with the signal."""

    name = "noise_covariance"
    title = "Correlation of the noise of neighbouring pixels"

    def measure(self, data):
        for g in data.groups:
            if g.count < 2 or g.kind == "scene":
                continue
            lags = LAGS | (FAR if g is data.bias else {})
            for name, lag in lags.items():
                axes = ["time", "pixel"] + ["row" if lag[0] else "column"] * (0 in lag)
                value = g.noise.correlations[lag]
                yield g.statistic(self.name, name, axes, "correlation"), value

    def draw(self, data, name, group):
        g = chosen(data, group, 2)
        if g is None:
            return None
        lag = (LAGS | FAR).get(name, (0, 1))
        step = (int(lag[0] > 0), int(lag[1] > 0))
        images = g.residual
        curve = correlation(images, step, g.label)
        way = {(0, 1): "columns", (1, 0): "rows", (1, 1): "rows and columns"}[step]
        at = float(max(lag))
        mark = ((at - 0.4, at + 0.4),) if name else ()
        return ViewPlot(self.title, f"distance, {way}", "correlation of temporal noise", (curve,), marks=mark)


class NoiseTails(View):
    """How often the noise is far out: the shape of read noise, pixels that jump, tracks in single frames."""

    name = "noise_tails"
    title = "Tails of the temporal noise"

    def measure(self, data):
        chosen = [g for g in data.groups if g.count >= 2 and g.kind in ("bias", "dark")] + data.of("flat", 2)[
            :2
        ]
        for g in chosen:
            tails, scale, spread = g.noise.tails, g.noise.scale, np.sqrt(g.noise_variance)
            axes = ["time", "pixel"]
            yield g.statistic(self.name, "mean size to deviation", axes), tails.mean_size / spread
            yield g.statistic(self.name, "median to deviation", axes), scale / spread
            # beyond 3 deviations tails add more noise than skewness, which Poisson charge has and read noise has not
            yield g.statistic(self.name, "skewness within 3 deviations", axes), tails.skewness
            for limit, far in zip((3, 5, 8, 20), tails.beyond, strict=True):
                yield g.statistic(self.name, f"beyond {limit} scales", axes, "sqrt count"), np.sqrt(far)
            uneven = np.sqrt(tails.up) - np.sqrt(tails.down)
            yield g.statistic(self.name, "up against down", axes, "sqrt count"), uneven
            touching = np.sqrt(tails.touching)
            yield g.statistic(self.name, "far pixels that touch", axes, "sqrt count"), touching

    def draw(self, data, name, group):
        g = chosen(data, group, 2)
        if g is None:
            return None
        residual = g.residual
        tail = 24  # robust standard deviations, at which the picture of the tails ends
        if name.startswith(("beyond", "up against", "far pixels")):
            edges = np.arange(-tail - 0.25, tail + 0.5, 0.5)
            share, _ = np.histogram(np.clip(residual / g.noise.scale, -tail, tail), bins=edges)
            curve = Curve((edges[1:] + edges[:-1]) / 2, share / residual.size, g.label)
            limit = float(next((w for w in name.split() if w.isdigit()), 5))
            return ViewPlot(
                self.title,
                f"temporal noise in robust standard deviations (the ends: {tail} and more)",
                "share of pixels",
                (curve,),
                log_y=True,
                marks=((-tail, -limit), (limit, tail)),
            )
        curve = quantiles(residual[:, ::2, ::2] if residual.size > 2e6 else residual, g.label)
        return ViewPlot(
            self.title,
            "quantile of a normal distribution, standard deviations",
            "temporal noise, DN",
            (curve,),
        )


class PixelNoise(View):
    """Pixels that are noisier than the others, in every frame."""

    name = "pixel_noise"
    title = "Variance of single pixels over frames"

    def measure(self, data):
        for g in data.groups:
            if g.count < 4 or g.kind not in ("bias", "dark"):
                continue
            axes, (counts, median) = ["time", "pixel"], g.noise.noisy_pixels
            for limit, count in zip(RATIOS, counts, strict=True):
                yield g.statistic(self.name, f"beyond {limit} times", axes, "sqrt count"), np.sqrt(count)
            yield g.statistic(self.name, "median", axes), median
            recurring = np.sqrt(g.noise.tails.recurring)
            yield g.statistic(self.name, "far in many frames", axes, "sqrt count"), recurring

    def draw(self, data, name, group):
        g = chosen(data, group, 4)
        if g is None:
            return None
        ratio = np.sort(g.noise.pixel_ratios.ravel())[::-1]
        rank = np.unique(np.geomspace(1, ratio.size, 200).astype(int))
        curve = Curve(rank, ratio[rank - 1], g.label)
        return ViewPlot(
            self.title,
            "rank of the pixel",
            "variance over the mean variance",
            (curve,),
            log_x=True,
            log_y=True,
        )
