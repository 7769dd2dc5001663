"""One function, one figure: what a characterization rests on."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from visaug.core.errors import InputError
from visaug.core.extras import extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINT, _LINE, _SOFT = "#c2410c", "#0b5cad", "#7a8594"


def _photon_transfer(axes: Any, c: Mapping[str, np.ndarray]) -> None:
    """Temporal variance against mean signal, both above dark, with the gain's line; without saturated flats."""
    x, y, used = c["signal_dn"], c["variance_dn2"], c["used"].astype(bool)
    # EMVA 1288: saturation is the maximum of the variance
    out = ~used & ~((x >= x[y.argmax()]) & (y < y.max()))
    axes.plot(x[used], y[used], "o", color=_POINT, label="measured, used")
    if out.any():
        axes.plot(x[out], y[out], "o", color=_SOFT, mfc="none", label="measured, left out")
    line = np.array([0.0, x[used | out].max(initial=0.0)])
    axes.plot(line, c["gain_dn_per_e"][0] * line, color=_LINE, label=f"{1 / c['gain_dn_per_e'][0]:.4g} e-/DN")
    axes.set(xlabel="mean signal above dark (DN)", ylabel="temporal variance above dark (DN²)")


def _linearity(axes: Any, c: Mapping[str, np.ndarray]) -> None:
    """Relative deviation of the mean signal from a straight line in photons."""
    axes.plot(c["photons"], 100 * c["deviation"], "o-", color=_POINT)
    axes.axhline(0, color=_LINE, linewidth=1)
    axes.set(xlabel="photons per pixel", ylabel="deviation from a line (%)")


def _read_noise(axes: Any, c: Mapping[str, np.ndarray]) -> None:
    """Histogram of the residuals of bias frames with the fitted law, tails on a logarithmic axis."""
    x, counts, model = c["residual_dn"], c["counts"], c["model"]
    seen = counts > 0
    axes.semilogy(x[seen], counts[seen], ".", color=_POINT, label="measured")
    inside = model > 0.3
    axes.semilogy(x[inside], model[inside], color=_LINE, label="Tukey lambda, fitted")
    deviation = np.sqrt((counts * x**2).sum() / counts.sum())
    bell = np.exp(-0.5 * (x / deviation) ** 2) / (deviation * np.sqrt(2 * np.pi))
    normal = counts.sum() * (x[1] - x[0]) * bell
    likely = normal > 0.3
    axes.semilogy(x[likely], normal[likely], "--", color=_SOFT, label="normal of the same deviation")
    axes.set(xlabel="residual from the master bias (DN)", ylabel="pixels per bin")


def _dark_current(axes: Any, c: Mapping[str, np.ndarray]) -> None:
    """Dark current against temperature with its exponential law."""
    t, y, e = c["temperature_c"], c["slope"], c["error"]
    if np.isfinite(t).all():
        axes.errorbar(t, y, 1.96 * e, fmt="o", color=_POINT, capsize=3, label="slopes, 95 %")
        if len(c["law"]):
            line = np.linspace(t.min(), t.max(), 80)
            axes.plot(line, c["law"][0] * np.exp(c["law"][1] * line), color=_LINE, label="a exp(b T)")
        axes.set_xlabel("sensor temperature (°C)")
    else:
        axes.errorbar(np.arange(len(y)), y, 1.96 * e, fmt="o", color=_POINT, capsize=3)
        axes.set(xlabel="temperature not known", xticks=[], xlim=(-1, len(y)))
    axes.set_ylabel("dark current (e-/s)" if c["in_electrons"] else "dark current (DN/s)")


def _nonuniformity(axes: Any, c: Mapping[str, np.ndarray]) -> None:
    """Row and column profiles of the master bias and their power spectra."""
    for name, colour in (("column", _POINT), ("row", _LINE)):
        axes[0].plot(c[f"{name}_profile_dn"], color=colour, linewidth=0.9, label=f"{name} means")
        axes[1].semilogy(c[f"{name}_frequency"][1:], c[f"{name}_power"][1:], color=colour, linewidth=0.9)
    axes[0].set(xlabel="row or column", ylabel="offset from the mean (DN)")
    axes[1].set(xlabel="cycles per row or column", ylabel="power (DN²)")


def _gain_law(axes: Any, c: Mapping[str, np.ndarray]) -> None:
    """Measured gain against the setting."""
    axes.errorbar(c["gain_db"], c["measured_db"], 1.96 * c["error_db"], fmt="o", color=_POINT, capsize=3)
    line = np.array([c["gain_db"].min(), c["gain_db"].max()])
    axes.plot(line, line, color=_LINE, label="as set")
    axes.set(xlabel="gain setting (dB)", ylabel="gain measured (dB)")


def _noise_level(axes: Any, c: Mapping[str, np.ndarray]) -> None:
    """Noise of flat picture regions against their level."""
    axes.errorbar(c["level_dn"], c["noise_dn"], 1.96 * c["error_dn"], fmt="o-", color=_POINT, capsize=3)
    axes.set(xlabel="level (DN)", ylabel="noise (DN)")


# By the name of the curve: what draws it on axes, and the frames that are needed.
_FIGURES: dict[str, tuple[Callable[[Any, Mapping[str, np.ndarray]], None], str]] = {
    "photon_transfer": (_photon_transfer, "flats at several levels and dark frames"),
    "linearity": (_linearity, "calibrated flats at three or more levels"),
    "read_noise": (_read_noise, "two or more bias frames that do not clip"),
    "dark_current": (_dark_current, "dark frames at two or more exposures"),
    "nonuniformity": (_nonuniformity, "two or more bias frames"),
    "gain_law": (_gain_law, "flats at two or more gain settings"),
    "noise_level": (_noise_level, "pictures with flat regions"),
}


def figure(curves: Mapping[str, Mapping[str, np.ndarray]], name: str) -> "Figure":
    """The figure of a curve; InputError where the frames gave none."""
    draw, needed = _FIGURES[name]
    if name not in curves:
        raise InputError("the frames give no such curve", field=name, expected=needed)
    with extra():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    size, columns = ((9.0, 3.6), 2) if draw is _nonuniformity else ((6.4, 4.0), 1)
    made = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(made)  # belongs to no window
    axes = made.subplots(1, columns)
    for one in np.atleast_1d(axes):
        one.spines[["top", "right"]].set_visible(False)
        one.grid(color="#e6eaef", linewidth=0.7)
        one.set_axisbelow(True)
    draw(axes, curves[name])
    # above, so that it covers no data
    if any(one.get_legend_handles_labels()[1] for one in np.atleast_1d(axes)):
        made.legend(loc="outside upper left", ncols=3, frameon=False, fontsize=9)
    return made


def figures(curves: Mapping[str, Mapping[str, np.ndarray]]) -> "dict[str, Figure]":
    """Every figure whose curve has more than one place along its axis, which its first array holds, by name."""
    along = {name: next(iter(curves[name].values())) for name in _FIGURES if name in curves}
    return {name: figure(curves, name) for name, values in along.items() if len(np.unique(values)) > 1}
