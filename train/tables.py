"""Tables of an ablation, in the form of the paper's 2 and 3, as Markdown and CSV; and the differences with
intervals.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

# What is compared: key -> (path in a domain's summary, label, whether more is better).
MEASURES: dict[str, tuple[tuple[str, ...], str, bool]] = {
    "box_ap": (("box_ap50_95",), "box AP50-95", True),
    "iou": (("iou",), "IoU mean", True),
    "keypoint_ap_paper": (("keypoint_ap50_95", "paper"), "keypoint AP50-95 (paper)", True),
    "keypoint_ap_coco": (("keypoint_ap50_95", "coco"), "keypoint AP50-95 (COCO)", True),
    "oks_paper": (("oks", "paper"), "OKS mean (paper)", True),
    "oks_coco": (("oks", "coco"), "OKS mean (COCO)", True),
    "spec_score": (("spec_score",), "SPEC score", False),
}


@dataclass(frozen=True)
class Table:
    """Cells as text under a head."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def to_markdown(self) -> str:
        """GitHub's table, the title above it."""
        lines = [f"**{self.title}**", "", _line(self.head), _line(["---"] * len(self.head))]
        return "\n".join([*lines, *map(_line, self.rows)]) + "\n"

    def to_csv(self) -> str:
        """Comma-separated, with the head."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerows([self.head, *self.rows])
        return buffer.getvalue()


def value(summary: Mapping[str, Any], measure: str) -> float:
    """A measure out of a domain's summary."""
    found: Any = summary
    for key in MEASURES[measure][0]:
        found = found[key]
    return float(found)


def score_table(
    title: str, means: Mapping[str, Mapping[str, Mapping[str, float]]], measures: Sequence[str]
) -> Table:
    """Arms as rows; for each domain the measures as columns.

    `means` is arm -> domain -> measure -> mean over seeds.
    """
    domains = list(dict.fromkeys(domain for scores in means.values() for domain in scores))
    head = ["arm", *(f"{domain}: {MEASURES[measure][1]}" for domain in domains for measure in measures)]
    rows = [
        [arm, *(_number(scores.get(domain, {}).get(measure)) for domain in domains for measure in measures)]
        for arm, scores in means.items()
    ]
    return Table(title, head, rows)


def difference_table(differences: Sequence[Any], baseline: str) -> Table:
    """Differences to the baseline with 95 % intervals; a row whose interval leaves out 0 is marked."""
    head = ["arm", "domain", "measure", f"{baseline}", "arm's", "difference", "95 % interval", "clear of 0"]
    rows = [
        [
            d.arm,
            d.domain,
            MEASURES[d.measure][1],
            _number(d.reference),
            _number(d.reference + d.difference),
            f"{d.difference:+.4f}",
            f"[{d.low:+.4f}, {d.high:+.4f}]",
            "yes" if d.low > 0 or d.high < 0 else "no",
        ]
        for d in differences
    ]
    return Table(f"Differences to {baseline}", head, rows)


def _number(number: float | None) -> str:
    return "" if number is None else f"{number:.4f}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
