"""The page of `compare --target`: pictures beside pictures."""

from pathlib import Path
from typing import TYPE_CHECKING

from visaug.core.wording import deviation_text, number
from visaug.report.headline import comparison_headline, view_title
from visaug.report.html import Figure, Page, Section, Table, Text, figure, write_page
from visaug.report.next_step import after_pictures, picture_inputs
from visaug.report.pages import next_text
from visaug.report.provenance import footer

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

    from visaug.pictures.comparison import PictureComparison


def write_picture_comparison(path: str | Path, result: "PictureComparison") -> Path:
    """Whether the cameras of two sets of pictures differ, and in what."""
    content = result.to_json()
    rows = [
        [
            view_title(d["view"]),
            d["statistic"],
            number(d["measured"]),
            number(d["modelled"]),
            d["unit"],
            deviation_text(d["z"]),
        ]
        for d in content["differences"]
    ]
    table = Table(
        ["view", "statistic", "target", "other set", "unit", "standard deviations"],
        rows,
        caption="Largest differences first. How bright the scenes are and how much sky they show do not enter.",
    )
    step = after_pictures(content, picture_inputs(result))
    blocks: list[Text | Table | Figure] = [
        Text(comparison_headline(content), "finding"),
        next_text(step),
    ]
    blocks.append(
        figure(_noise(result), "Noise of flat regions against their level, both sets. Bars are 95 %.")
    )
    blocks += [table, *(Text(w, "note") for w in content["warnings"])]
    lead = f"{result.pictures[0]} pictures beside {result.pictures[1]} of the target."
    page = Page("Pictures and target", lead, [Section("Answer", blocks)], footer=footer(None, result.target))
    return write_page(path, page)


def _noise(result: "PictureComparison") -> "MatplotlibFigure":
    from matplotlib.figure import Figure as MatplotlibFigure

    drawn = MatplotlibFigure(figsize=(6.5, 3.6), layout="constrained")
    axes = drawn.subplots()
    for (name, c), marker in zip(result.curves.items(), "os", strict=True):
        label = "target" if name == "target" else "other set"
        axes.errorbar(
            c["level_dn"], c["noise_dn"], 1.96 * c["error_dn"], fmt=marker, ms=4, capsize=2, label=label
        )
    axes.set(xlabel="level (1/255 of full scale)", ylabel="noise (1/255 of full scale)")
    axes.legend(frameon=False)
    return drawn
