"""Photon transfer, dark histogram, row spectrum, dark columns: measured and modelled in the same axes."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from visaug.report.plots.style import MEASURED, MODELLED, blank, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from visaug.report.real_camera import SensorCurves


def plot_photon_transfer(measured: "SensorCurves", modelled: "SensorCurves") -> "Figure":
    """Temporal variance against the mean above dark, both in DN."""
    with _both() as (figure, axes):
        axes.plot(modelled.mean_dn, modelled.variance_dn2, "-", color=MODELLED, label="modelled")
        points = {"color": MEASURED, "markersize": 4.5, "label": "measured"}
        axes.plot(measured.mean_dn, measured.variance_dn2, "o", **points)
        axes.set(xlabel="mean above dark / DN", ylabel="temporal variance / DN²")
    return figure


def plot_dark_histogram(measured: "SensorCurves", modelled: "SensorCurves") -> "Figure":
    """Number of dark pixels at each distance from the mean, logarithmic."""
    with _both() as (figure, axes):
        axes.step(modelled.levels_dn, modelled.counts, where="mid", color=MODELLED, label="modelled")
        axes.plot(measured.levels_dn, measured.counts, "o", color=MEASURED, markersize=3.5, label="measured")
        axes.set(xlabel="dark signal less its mean / DN", ylabel="pixels", yscale="log", ylim=(0.6, None))
    return figure


def plot_row_spectrum(measured: "SensorCurves", modelled: "SensorCurves") -> "Figure":
    """Power of the dark noise along the row against the frequency."""
    with _both() as (figure, axes):
        for curves, colour, label in ((modelled, MODELLED, "modelled"), (measured, MEASURED, "measured")):
            axes.plot(curves.frequency, curves.row_power, color=colour, label=label)
            ends = [0, -1]  # single bins, easily overlooked
            axes.plot(curves.frequency[ends], curves.row_power[ends], "o", color=colour, markersize=4.5)
        axes.set(xlabel="frequency along the row / cycles per pixel", ylabel="power (1: independent pixels)")
        axes.set(yscale="log", yticks=[1, 2, 5, 10], yticklabels=["1", "2", "5", "10"])
        axes.minorticks_off()
    return figure


def plot_dark_columns(measured: "SensorCurves", modelled: "SensorCurves") -> "Figure":
    """Column means of a dark stack."""
    with _both() as (figure, axes):
        axes.plot(measured.column_dn, color=MEASURED, linewidth=1, label="measured")
        axes.plot(modelled.column_dn, color=MODELLED, linewidth=1, label="modelled")
        axes.set(xlabel="column of the window", ylabel="column mean, less the frame's / DN")
        axes.margins(y=0.18)
    return figure


@contextmanager
def _both() -> "Iterator[tuple[Figure, Any]]":
    """A figure, of which two stand side by side, and its axes; the legend follows what is drawn."""
    with styled():
        figure = blank(4.6, 3.3)
        yield figure, figure.subplots()
        figure.legend(loc="outside upper left", ncols=2)
