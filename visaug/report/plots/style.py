"""One look for all pictures, and figures that need no window."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from visaug.core.extras import extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Vermilion, blue and bluish green of Okabe and Ito: distinct for colour-blind readers and in grey.
MEASURED, MODELLED, THIRD, SOFT = "#d55e00", "#0072b2", "#009e73", "#7a8594"

_STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#5b6675",
    "axes.labelcolor": "#1c2430",
    "axes.grid": True,
    "grid.color": "#e6eaef",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "xtick.color": "#5b6675",
    "ytick.color": "#5b6675",
    "legend.frameon": True,
    "legend.framealpha": 0.8,
    "legend.edgecolor": "none",
    "lines.linewidth": 1.6,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "image.cmap": "gray",
    "image.interpolation": "nearest",
}


@contextmanager
def styled() -> Iterator[None]:
    """The look, for what is drawn inside; matplotlib's own settings are left as they were."""
    with extra():
        import matplotlib as mpl

    with mpl.rc_context(_STYLE):
        yield


def plain(text: str) -> str:
    """A user's text for a figure, escaped where matplotlib would parse a formula between two $."""
    return text.replace("$", r"\$")


def blank(width: float, height: float, layout: Any = "constrained", **options: Any) -> "Figure":
    """An empty figure (inches) that belongs to no window; axes find their place by themselves."""
    with extra():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout=layout, **options)
    FigureCanvasAgg(figure)
    return figure
