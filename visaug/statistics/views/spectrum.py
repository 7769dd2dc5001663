"""Spectra of rows and columns, temporal and fixed."""

from functools import lru_cache

import numpy as np

from visaug.statistics.fixed import band_numbers, mean_power, peak_frequency
from visaug.statistics.view import Curve, View, ViewPlot
from visaug.statistics.views.drawn import below_saturation, chosen, direction, relative, spectrum_marks


def power(lines: np.ndarray) -> np.ndarray:
    """Mean power spectrum of profiles (n, L) over frequencies 1 .. L/2, 1 for white noise of variance 1."""
    length = lines.shape[-1]
    waves = np.fft.rfft(lines - lines.mean(-1, keepdims=True)).reshape(-1, length // 2 + 1)
    found = np.zeros(length // 2)
    mean_power(waves, found)
    return found / length


@lru_cache(maxsize=16)
def _octaves(length: int) -> np.ndarray:
    bands = 6
    return np.unique(np.round(np.geomspace(1, length + 1, bands + 1)).astype(int)) - 1


def band_statistics(group, view, name, spectrum, axes):
    edges = _octaves(len(spectrum))
    numbers = np.empty(len(edges) + 2)
    least_power = 1e-3  # is added before a logarithm
    band_numbers(spectrum, edges, least_power, numbers)
    *bands, peak, place, last = numbers.tolist()
    for i, value in enumerate(bands, 1):
        yield group.statistic(view, f"{name}, band {i}", axes, "log power"), value
    yield group.statistic(view, f"{name}, peak", axes, "log ratio"), peak
    yield group.statistic(view, f"{name}, where the peak is", axes, "cycles per line"), place
    yield group.statistic(view, f"{name}, at half the sampling", axes, "log ratio"), last


class TemporalSpectrum(View):
    """Power spectra of the row and column means of the temporal noise."""

    name = "temporal_spectrum"
    title = "Spectrum of row and column means, temporal noise"

    def measure(self, data):
        for kind in ("bias", "dark", "flat"):
            groups = data.of(kind, at_least=2)
            if groups:
                first = groups[0] if kind == "bias" else groups[-1]
                rows = np.mean([power(g.noise_rows) * g.mean.shape[1] / g.noise_variance for g in groups], 0)
                columns = np.mean(
                    [power(g.noise_columns) * g.mean.shape[0] / g.noise_variance for g in groups], 0
                )
                yield from band_statistics(first, self.name, f"{kind} rows", rows, ["time", "row"])
                yield from band_statistics(first, self.name, f"{kind} columns", columns, ["time", "column"])

    def draw(self, data, name, group):
        kind, lines = name.split()[0] if name else "bias", direction(name)
        groups = data.of(kind, at_least=2) if kind in ("bias", "dark", "flat") else []
        if kind == "flat" and groups:
            groups = below_saturation(groups)
        groups = groups or [g for g in (chosen(data, group, 2),) if g]
        if not groups:
            return None
        spectrum = np.mean([_temporal_power(g, lines) for g in groups], 0)
        frequency = np.linspace(0, 0.5, len(spectrum) + 1)[1:]
        marks = spectrum_marks(name, _octaves(len(spectrum)), len(spectrum), peak_frequency(spectrum))
        return ViewPlot(
            f"Spectrum of {lines} means, temporal noise",
            f"frequency, cycles per {lines}",
            "power, 1 for white noise",
            (Curve(frequency, spectrum, f"{lines}s, {groups[0].kind} frames"),),
            log_x=True,
            log_y=True,
            marks=marks,
        )


def _temporal_power(g, lines: str) -> np.ndarray:
    means, across = (g.noise_rows, g.mean.shape[1]) if lines == "row" else (g.noise_columns, g.mean.shape[0])
    return power(means) * across / g.noise_variance


class FixedSpectrum(View):
    """Power spectra of the row and column means of the fixed pattern."""

    name = "fixed_spectrum"
    title = "Spectrum of the row and column means of the fixed pattern"

    def measure(self, data):
        for g in (*data.dark_ends, *_bright(data)):
            for name, profile, axis in (
                ("rows", g.pattern_rows, "row"),
                ("columns", g.pattern_columns, "column"),
            ):
                spectrum = (
                    power(profile[None])
                    / max(abs(g.signal) if g.kind == "flat" else 1.0, 1.0) ** 2
                    * (1e6 if g.kind == "flat" else 1.0)
                )
                yield from band_statistics(g, self.name, name, spectrum, [axis])

    def draw(self, data, name, group):
        g, lines = chosen(data, group), direction(name)
        if g is None:
            return None
        unit, word = relative(g)
        spectrum = power((g.pattern_rows if lines == "row" else g.pattern_columns)[None] * unit)
        frequency = np.linspace(0, 0.5, len(spectrum) + 1)[1:]
        return ViewPlot(
            f"Spectrum of the {lines} means of the fixed pattern",
            f"frequency, cycles per {lines}",
            f"power, {word}²",
            (Curve(frequency, spectrum, f"{lines}s, {g.label}"),),
            log_x=True,
            log_y=True,
            marks=spectrum_marks(name, _octaves(len(spectrum)), len(spectrum), peak_frequency(spectrum)),
        )


def _bright(data) -> list:
    """The flat of the middle of the range: bright enough for the response, below saturation."""
    flats = data.of("flat")
    return flats[len(flats) * 5 // 8 : len(flats) * 5 // 8 + 1]
