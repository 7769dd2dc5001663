"""Temporal noise: its size, its rows and columns, its covariance, its tails."""

import numpy as np

from visaug.statistics.stack import RATIOS
from visaug.statistics.view import Curve, Picture, View


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

    def picture(self, data):
        groups = sorted(
            (g for g in data.groups if g.count >= 2 and g.kind in ("bias", "flat")), key=lambda g: g.level
        )
        if not groups:
            return None
        curve = Curve(
            np.array([max(g.signal, 1.0) if g.reference else 1.0 for g in groups]),
            np.array([g.noise_variance for g in groups]),
        )
        return Picture(
            self.title, "mean above bias, DN", "temporal variance, DN^2", (curve,), log_x=True, log_y=True
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
                about = lines - lines.mean(1, keepdims=True)
                ratio = across * np.mean(about.astype(np.float64) ** 2) / g.noise_variance
                yield g.statistic(self.name, f"{name}s", ["time", name], "log ratio"), np.log(ratio + 0.01)

    def picture(self, data):
        groups = [g for g in (data.bias, *data.of("flat", 2)[-1:]) if g is not None and g.count >= 2]
        curves = [
            Curve(np.arange(g.noise_rows.shape[1]), g.noise_rows[0], f"rows of one frame, {g.label}")
            for g in groups
        ]
        return (
            Picture(self.title, "row", "row mean less the mean frame's, DN", tuple(curves))
            if curves
            else None
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

    def picture(self, data):
        groups = [g for g in data.groups if g.count >= 2 and g.kind in ("bias", "flat")]
        if not groups:
            return None
        x = np.array([max(g.signal, 1.0) if g.reference else 1.0 for g in groups])
        curves = [
            Curve(x, np.array([g.noise.correlations[lag] for g in groups]), name)
            for name, lag in LAGS.items()
        ]
        return Picture(self.title, "mean above bias, DN", "correlation", tuple(curves), log_x=True)


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

    def picture(self, data):
        g = data.bias if data.bias is not None else next(iter(data.of("dark", 2)), None)
        if g is None or g.count < 2:
            return None
        limit = np.quantile(np.abs(g.residual[:, ::3, ::3]), 0.9999) * 1.5
        counts, edges = np.histogram(g.residual, bins=121, range=(-limit, limit))
        curve = Curve((edges[1:] + edges[:-1]) / 2, np.maximum(counts, 0.5), g.label)
        return Picture(self.title, "temporal noise, DN", "pixels", (curve,), log_y=True)


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

    def picture(self, data):
        g = next((g for g in data.groups if g.count >= 4 and g.kind in ("bias", "dark")), None)
        if g is None:
            return None
        ratio = np.sort(g.noise.pixel_ratios.ravel())[::-1]
        rank = np.unique(np.geomspace(1, ratio.size, 200).astype(int))
        return Picture(
            self.title,
            "rank of the pixel",
            "variance over the mean variance",
            (Curve(rank, ratio[rank - 1], g.label),),
            log_x=True,
            log_y=True,
        )
