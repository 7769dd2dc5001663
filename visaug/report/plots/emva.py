"""The plots of the EMVA 1288 data sheet, release 4.0 Linear, from the arrays of a characterization."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from visaug.report.plots.style import blank

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from visaug.characterization import Characterization

_POINT, _LINE, _SOFT, _THIRD = "#c2410c", "#0b5cad", "#7a8594", "#157f5b"


def _new(result: Characterization, curve: str) -> tuple[Mapping[str, np.ndarray], Figure, Axes]:
    """The arrays of a curve, and an empty figure for them."""
    figure = blank(4.3, 2.25)  # inches: ten fill a page of A4
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e6eaef", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(which="both", labelsize=7.5)
    return result.curves[f"emva4_{curve}"], figure, axes


def _finish(figure: Figure, axes: Axes, x: str, y: str) -> Figure:
    axes.set_xlabel(x, fontsize=8)
    axes.set_ylabel(y, fontsize=8)
    if axes.get_legend_handles_labels()[1]:
        figure.legend(loc="outside upper center", ncols=4, frameon=False, fontsize=7)
    return figure


def sensitivity(result: Characterization) -> Figure:
    """Mean signal above dark against photons, with the standard's fit and its range."""
    c, figure, axes = _new(result, "sweep")
    photons, signal = c["photons"], c["mean_dn"] - c["dark_mean_dn"]
    last, top = int(c["last_fitted"][0]), int(c["saturation"][0])
    axes.plot(photons, signal, ".", color=_POINT, label="measured")
    slope, ends = result["emva4.responsivity_dn_per_photon"].value, photons[[0, last]]
    axes.plot(ends, slope * ends, color=_LINE, label=f"fit, {slope:.4g} DN/photon")
    if top >= 0:
        axes.axvline(photons[top], color=_SOFT, linestyle="--", linewidth=1, label="saturation")
    return _finish(figure, axes, "photons per pixel", "signal above dark (DN)")


def photon_transfer(result: Characterization) -> Figure:
    """Temporal variance against mean, both above dark, with the standard's fit."""
    c, figure, axes = _new(result, "sweep")
    signal, variance = c["mean_dn"] - c["dark_mean_dn"], c["variance_dn2"] - c["dark_variance_dn2"]
    last, top = int(c["last_fitted"][0]), int(c["saturation"][0])
    axes.plot(signal, variance, ".", color=_POINT, label="measured")
    gain = result["emva.system_gain_dn_per_e"].value
    axes.plot([0, signal[last]], [0, gain * signal[last]], color=_LINE, label=f"fit, K = {gain:.4g} DN/e-")
    if top >= 0:
        axes.plot(signal[top], variance[top], "o", mfc="none", color=_SOFT, label="saturation")
    return _finish(figure, axes, "mean signal above dark (DN)", "variance above dark (DN²)")


def snr(result: Characterization) -> Figure:
    """Signal-to-noise ratio against photons: measured, by the linear model, with non-uniformity, and ideal."""
    c, figure, axes = _new(result, "sweep")
    photons = c["photons"]
    ratio = (c["mean_dn"] - c["dark_mean_dn"]) / np.sqrt(np.maximum(c["variance_dn2"], 1e-12))
    seen = (photons > 0) & (ratio > 0)
    if (top := int(c["saturation"][0])) >= 0:  # beyond it the noise is clipped
        seen &= photons <= photons[top]
    efficiency = result["emva.quantum_efficiency"].value
    floor = (result["emva.dark_noise_dn"].value / result["emva.system_gain_dn_per_e"].value) ** 2
    highest = result.parameters.get("emva.saturation_photons")
    most = highest.value if highest else float(photons[seen].max())
    line = np.geomspace(max(photons[seen].min() / 10, 0.5), most, 200)
    electrons = efficiency * line
    axes.loglog(photons[seen], ratio[seen], ".", color=_POINT, label="measured")
    axes.loglog(line, electrons / np.sqrt(floor + electrons), color=_LINE, label="linear model")
    dsnu, prnu = (result.parameters.get(f"emva.{n}") for n in ("dsnu_e", "prnu_fraction"))
    if dsnu and prnu:
        total = floor + electrons + dsnu.value**2 + (prnu.value * electrons) ** 2
        axes.loglog(line, electrons / np.sqrt(total), color=_THIRD, label="with DSNU and PRNU")
    axes.loglog(line, np.sqrt(line), "--", color=_SOFT, linewidth=1, label="ideal sensor")
    threshold = result.parameters.get("emva4.absolute_sensitivity_threshold_photons")
    for estimate in (threshold, highest):
        if estimate:
            axes.axvline(estimate.value, color=_SOFT, linestyle=":", linewidth=1)
    axes.set_ylim(bottom=0.1)
    return _finish(figure, axes, "photons per pixel (dotted: threshold, saturation)", "SNR")


def linearity(result: Characterization) -> Figure:
    """Relative deviation of the signal from the standard's line, between 5 and 95 % of saturation."""
    c, figure, axes = _new(result, "linearity")
    axes.plot(c["photons"], 100 * c["deviation"], ".-", color=_POINT, linewidth=0.8)
    axes.axhline(0, color=_LINE, linewidth=1)
    for name in ("min", "max"):
        if estimate := result.parameters.get(f"emva.linearity_error_{name}"):
            axes.axhline(100 * estimate.value, color=_SOFT, linestyle="--", linewidth=0.9)
    return _finish(figure, axes, "photons per pixel (dashed: LE min, LE max)", "deviation (%)")


def _dark(which: str, label: str, result: Characterization) -> Figure:
    c, figure, axes = _new(result, "dark")
    t, y = 1e3 * c["exposure_s"], c[which]
    axes.plot(t, y, ".", color=_POINT, label="measured")
    if len(np.unique(t)) > 2:
        slope, start = np.polyfit(t, y, 1)
        axes.plot(t[[0, -1]], slope * t[[0, -1]] + start, color=_LINE, label=f"line, {1e3 * slope:.3g} per s")
    return _finish(figure, axes, "exposure (ms)", label)


def _plain(value: float, _: float) -> str:
    """Ticks of a logarithmic axis as plain numbers, those at 1, 2, 3 and 5 alone."""
    shown = f"{value:e}"[0] in "1235" and f"{value:.0e}" == f"{value:.1e}".replace(".0", "")
    return f"{value:g}" if shown else ""


def _spectrogram(direction: str, what: str, unit: str, result: Characterization) -> Figure:
    c, figure, axes = _new(result, what)
    frequency, amplitude = c[f"{direction}_frequency"][1:], c[f"{direction}_amplitude"][1:]
    axes.semilogy(frequency, np.maximum(amplitude, 1e-9), color=_POINT, linewidth=0.8, label="measured")
    axes.axhline(c["noise"][0], color=_SOFT, linestyle="--", linewidth=1, label="temporal noise left")
    for formatter in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        formatter(_plain)
    return _finish(figure, axes, "cycles per pixel", f"{what.upper()} amplitude ({unit})")


def _profile(direction: str, what: str, unit: str, result: Characterization) -> Figure:
    c, figure, axes = _new(result, what)
    for key, colour, label in (
        ("most", _SOFT, "largest"),
        ("least", _THIRD, "smallest"),
        ("middle", _POINT, "middle line"),
        ("mean", _LINE, "mean"),
    ):
        axes.plot(c[f"{direction}_{key}"], color=colour, linewidth=0.7, label=label)
    return _finish(figure, axes, "column" if direction == "horizontal" else "row", f"signal ({unit})")


def _histogram(what: str, unit: str, result: Characterization) -> Figure:
    c, figure, axes = _new(result, what)
    x, count, normal = c["deviation"], c["count"], c["normal"]
    seen, likely = count > 0, normal > 0.3
    axes.semilogy(x[seen], count[seen], ".", color=_POINT, markersize=3, label="measured")
    axes.semilogy(x[likely], normal[likely], color=_LINE, label="normal, same deviation")
    return _finish(figure, axes, f"deviation from the mean ({unit})", "pixels per bin")


def _accumulated(what: str, unit: str, result: Characterization) -> Figure:
    c, figure, axes = _new(result, what)
    axes.semilogy(c["beyond"], c["percent_beyond"], color=_POINT)
    return _finish(figure, axes, f"deviation from the mean, at least ({unit})", "share of pixels (%)")


_Drawing = Callable[["Characterization"], "Figure"]
# Title, what the figure shows (None: as the function says), the curve and the parameters that it needs, the function.
FIGURES: list[tuple[str, str | None, str, tuple[str, ...], _Drawing]] = [
    ("Sensitivity", None, "emva4_sweep", ("emva4.responsivity_dn_per_photon",), sensitivity),
    ("Photon transfer", None, "emva4_sweep", ("emva.system_gain_dn_per_e",), photon_transfer),
    ("SNR", None, "emva4_sweep", ("emva.quantum_efficiency", "emva.dark_noise_dn"), snr),
    ("Deviation from linearity", None, "emva4_linearity", (), linearity),
]
for _title, _shown, _draw in (
    ("mean", "Dark signal", partial(_dark, "mean_dn", "mean dark signal (DN)")),
    ("variance", "Temporal variance of dark frames", partial(_dark, "variance_dn2", "dark variance (DN²)")),
):
    _shown = f"{_shown} against exposure."
    FIGURES.append((f"Dark current from the {_title}", _shown, "emva4_dark", (), _draw))
_profiles = "{} profiles of the map that the {{}} is measured on."
for _title, _shown, _draw in (
    ("spectrogram, horizontal", "Horizontal spectrogram of the {}.", partial(_spectrogram, "horizontal")),
    ("spectrogram, vertical", "Vertical spectrogram of the {}.", partial(_spectrogram, "vertical")),
    ("profile, horizontal", _profiles.format("Horizontal"), partial(_profile, "horizontal")),
    ("profile, vertical", _profiles.format("Vertical"), partial(_profile, "vertical")),
    ("histogram", "Logarithmic histogram of the {}.", _histogram),
    ("histogram, accumulated", "Accumulated logarithmic histogram of the {}.", _accumulated),
):
    for _what, _unit in (("DSNU", "e-"), ("PRNU", "%")):
        _key = _what.lower()
        _drawn = partial(_draw, _key, _unit)
        FIGURES.append((f"{_what} {_title}", _shown.format(_what), f"emva4_{_key}", (), _drawn))
