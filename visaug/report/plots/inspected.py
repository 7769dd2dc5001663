"""One picture for each finding of an inspection."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from visaug.report.plots.style import MEASURED, MODELLED, blank, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from visaug.inspection import Finding


def plot_finding(finding: Finding) -> Figure | None:
    """The picture of a finding; None where there is nothing to draw."""
    shown = finding.shown
    with styled():
        if "lines" in shown:
            return _lines(finding, shown["lines"])
        if "where" in shown:
            return _defects(finding)
        if "blocks" in shown:
            return _map(shown["blocks"], "level less the median / DN", "blocks")
        if "image" in shown:
            return _map(shown["image"], "mean frame / DN", "pixels")
        if "drift" in shown:
            return _drift(shown["drift"])
        if "counts" in shown:
            return _codes(shown["counts"])
        if "noise" in shown:
            return _sharing(finding)
    return None


def _two() -> tuple[Figure, Axes, Axes]:
    figure = blank(8.0, 2.7)
    return figure, *figure.subplots(1, 2)


def _lines(finding: Finding, lines: Any) -> Figure:
    """Left the means of the lines, right their spectrum."""
    figure, left, right = _two()
    means = lines.look.data.frames.mean(2, dtype=np.float64)
    profiles = means - means.mean(1, keepdims=True)
    if finding.kind == "per_frame":
        for k, profile in enumerate(profiles[:3]):
            left.plot(profile, linewidth=0.9, color=MEASURED, alpha=1 - 0.3 * k, label=f"frame {k}")
    else:
        left.plot(profiles.mean(0), linewidth=0.9, color=MEASURED, label="mean frame")
    if finding.what == "parity" and len(profiles[0]) > 60:
        left.set_xlim(0, 60)
    left.set(xlabel=lines.axis, ylabel=f"mean of the {lines.axis} / DN")
    from visaug.statistics.views.spectrum import power

    fixed = power(profiles.mean(0)[None])
    frequency = np.arange(1, len(fixed) + 1) / profiles.shape[1]
    right.plot(frequency, fixed, color=MODELLED, linewidth=1.6, label="same in all frames")
    if lines.count > 1:
        new = power((profiles - profiles.mean(0)) * np.sqrt(lines.count / (lines.count - 1)))
        right.plot(frequency, new, color=MEASURED, linewidth=1.0, label="new in each frame")
    floor = lines.look.noise_variance / lines.breadth
    right.axhline(floor, color="0.5", linewidth=0.8, linestyle="--", label="pixel noise alone")
    if finding.period and finding.what.endswith("banding"):
        right.axvline(1 / finding.period, color="0.5", linewidth=0.8, linestyle=":")
    right.set(xlabel=f"cycles per {lines.axis}", ylabel="power / DN²", yscale="log")
    if finding.what == "flicker_noise":
        right.set_xscale("log")
    handles, labels = (a + b for a, b in zip(*(axes.get_legend_handles_labels() for axes in (left, right))))
    figure.legend(handles, labels, loc="outside upper center", ncols=6, fontsize=8)
    return figure


def _defects(finding: Finding) -> Figure:
    """Places on the sensor, and the strongest one: its neighbourhood, or its values from frame to frame."""
    figure, left, right = _two()
    rows, columns = np.nonzero(finding.shown["where"])
    left.scatter(columns, rows, s=14, facecolors="none", edgecolors=MEASURED)
    height, width = finding.shown["where"].shape
    left.set(xlim=(0, width), ylim=(height, 0), xlabel="column", ylabel="row", aspect="equal")
    r, c = max(finding.places, key=lambda place: abs(place[3]))[:2]
    if "frames" in finding.shown:
        right.plot(finding.shown["frames"][:, r, c], "o-", color=MEASURED, markersize=3, linewidth=0.8)
        right.set(xlabel="frame", ylabel=f"pixel ({r}, {c}) / DN")
    else:
        image = finding.shown["image"]
        r0, c0 = max(r - 8, 0), max(c - 8, 0)
        part = image[r0 : r + 9, c0 : c + 9]
        extent = (c0 - 0.5, c0 + part.shape[1] - 0.5, r0 + part.shape[0] - 0.5, r0 - 0.5)
        drawn = right.imshow(part, extent=extent)
        right.grid(False)
        figure.colorbar(drawn, ax=right, label="mean frame / DN")
        right.set(xlabel="column", ylabel="row")
    return figure


def _map(image: np.ndarray, label: str, unit: str) -> Figure:
    figure = blank(4.6, 3.2)
    axes = figure.subplots()
    low, high = np.percentile(image, [1, 99])
    drawn = axes.imshow(image, cmap="cividis", vmin=low, vmax=high if high > low else low + 1)
    axes.grid(False)
    axes.set(xlabel=unit, ylabel=unit)
    figure.colorbar(drawn, ax=axes, label=label)
    return figure


def _drift(means: np.ndarray) -> Figure:
    figure = blank(4.6, 2.7)
    axes = figure.subplots()
    axes.plot(means, "o-", color=MEASURED, markersize=3.5, linewidth=0.9)
    axes.set(xlabel="frame", ylabel="mean less that of all / DN")
    return figure


def _codes(counts: np.ndarray) -> Figure:
    figure = blank(4.6, 2.7)
    axes = figure.subplots()
    top, reach = int(np.argmax(counts)), 60  # codes on either side of the most frequent one
    codes = np.arange(max(top - reach, 0), min(top + reach, len(counts)))
    axes.vlines(codes, 0.5, np.maximum(counts[codes], 0.5), color=MEASURED, linewidth=1.5)
    axes.set(xlabel="code / DN", ylabel="pixels", yscale="log", ylim=(0.5, None))
    return figure


def _sharing(finding: Finding) -> Figure:
    """Autocorrelation of the noise of one frame, and a part of it."""
    figure, left, right = _two()
    noise = finding.shown["noise"].astype(np.float64)
    part = noise[:48, :64]
    left.imshow(part, vmin=np.percentile(part, 1), vmax=np.percentile(part, 99))
    left.set(title="noise of a part of one frame", xlabel="column", ylabel="row")
    about = noise - noise.mean()
    spectrum = np.abs(np.fft.fft2(about)) ** 2
    shared = np.fft.fftshift(np.fft.ifft2(spectrum).real) / max(float((about**2).sum()), 1e-12)
    r, c = shared.shape[0] // 2, shared.shape[1] // 2
    lags = 6  # px, of an autocorrelation
    reach = lags + 0.5
    near = shared[r - lags : r + lags + 1, c - lags : c + lags + 1]
    drawn = right.imshow(near, cmap="RdBu_r", vmin=-0.6, vmax=0.6, extent=(-reach, reach, reach, -reach))
    right.set(title="autocorrelation", xlabel="columns apart", ylabel="rows apart")
    for axes in (left, right):
        axes.grid(False)
    figure.colorbar(drawn, ax=right)
    return figure
