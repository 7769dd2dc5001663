"""Tables of a study, in the form of the paper's 2 to 4, as Markdown, CSV and LaTeX; and the differences with intervals."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from visaug.report.html import Table
from visaug_train.statistics import sign

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
# arm -> domain -> measure -> one number over the seeds
Scores = Mapping[str, Mapping[str, Mapping[str, float | None]]]
# Figures of the paper's tables 2 to 4, to stand beside one's own. Source: "Towards Domain Gap Bridging via Synthetic VIS Sensor
# Model", tables 2, 3 and 4; one run each, no intervals.
PAPER = "the paper"
TABLES_2_3: dict[str, dict[str, dict[str, float]]] = {
    f"{PAPER}: baseline": {
        "speed": {"box_ap": 0.981, "iou": 0.9653, "keypoint_ap_paper": 0.987, "oks_paper": 0.9747},
        "lightbox": {"box_ap": 0.687, "iou": 0.8280, "keypoint_ap_paper": 0.472, "oks_paper": 0.6267},
        "sunlamp": {"box_ap": 0.627, "iou": 0.8349, "keypoint_ap_paper": 0.185, "oks_paper": 0.3928},
    },
    f"{PAPER}: + VIS sensor noise": {
        "speed": {"box_ap": 0.990, "iou": 0.9758, "keypoint_ap_paper": 0.994, "oks_paper": 0.9895},
        "lightbox": {"box_ap": 0.843, "iou": 0.8939, "keypoint_ap_paper": 0.634, "oks_paper": 0.7226},
        "sunlamp": {"box_ap": 0.723, "iou": 0.8682, "keypoint_ap_paper": 0.262, "oks_paper": 0.4587},
    },
}
# Whether its keypoint AP and OKS are by its own definition or by ultralytics', which has COCO's, it does not say.
for _domains in TABLES_2_3.values():
    for _scores in _domains.values():
        _scores |= {"keypoint_ap_coco": _scores["keypoint_ap_paper"], "oks_coco": _scores["oks_paper"]}
WHICH_OKS = (
    "The paper's keypoint figures stand in both columns: it defines an OKS of its own (sigma 1/11, area of the box), and trains "
    "with ultralytics, which prints COCO's; it does not say which of the two its tables hold."
)
# Target detection on SPEED's images: mean IoU and box AP50-95 where it is given.
TABLE_4 = {
    "SLAB baseline": (0.919, None),
    "UniAdelaide": (0.9534, None),
    "SLN (YOLOv5s)": (0.9538, 0.9851),
    "YOLOv5n": (0.9542, 0.957),
    "YOLOv5s": (0.9646, 0.976),
    f"{PAPER}: YOLOv8s-pose, baseline": (0.9653, 0.981),
    f"{PAPER}: YOLOv8s-pose, + VIS": (0.9758, 0.990),
}


@dataclass(frozen=True)
class ResultTable:
    """Cells as text under a head; `note` is a sentence on how to read them."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def with_note(self, note: str) -> "ResultTable":
        return replace(self, note=" ".join(filter(None, [self.note, note])))

    def block(self) -> Table:
        return Table(self.head, self.rows, f"{self.title}.")

    def to_markdown(self) -> str:
        """GitHub's table, the title above it, the note below."""
        lines = [f"**{self.title}**", "", _line(self.head), _line(["---"] * len(self.head))]
        note = ["", self.note] if self.note else []
        return "\n".join([*lines, *map(_line, self.rows), *note]) + "\n"

    def to_csv(self) -> str:
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="\n").writerows([self.head, *self.rows])
        return buffer.getvalue()

    def to_latex(self) -> str:
        """A `table` with a `tabular` and three rules (package booktabs), the title as its caption."""
        columns = "l" + "r" * (len(self.head) - 1)
        lines = [
            r"\begin{table}",
            rf"\caption{{{_latex('. '.join(filter(None, [self.title, self.note])))}}}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            " & ".join(map(_latex, self.head)) + r" \\",
            r"\midrule",
            *(" & ".join(map(_latex, row)) + r" \\" for row in self.rows),
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
        ]
        return "\n".join(lines) + "\n"


def signed(change: float, low: float, high: float) -> str:
    return f"{change:+.3f} [{low:+.3f}, {high:+.3f}]"


def value(summary: Mapping[str, Any], measure: str) -> float:
    """A measure out of a domain's summary; NaN where it is not determined."""
    found: Any = summary
    for key in MEASURES[measure][0]:
        found = found[key]
    return float("nan") if found is None else float(found)


def domains_of(means: Scores) -> list[str]:
    return list(dict.fromkeys(domain for scores in means.values() for domain in scores))


def score_table(
    title: str, means: Scores, measures: Sequence[str], spreads: Scores | None = None
) -> ResultTable:
    """Arms as rows; for each domain the measures as columns: `means` over seeds, with `spreads`, their standard deviations."""
    columns = [(domain, measure) for domain in domains_of(means) for measure in measures]

    def cell(arm: str, domain: str, measure: str) -> str:
        number = _number(means[arm].get(domain, {}).get(measure))
        spread = (spreads or {}).get(arm, {}).get(domain, {}).get(measure)
        return number if spread is None else f"{number} ± {spread:.4f}"

    head = ["arm", *(f"{domain}: {MEASURES[measure][1]}" for domain, measure in columns)]
    return ResultTable(title, head, [[arm, *(cell(arm, *column) for column in columns)] for arm in means])


def difference_table(differences: Sequence[Any], baseline: str) -> ResultTable:
    """Differences to the baseline with 95 % intervals; a row whose interval leaves out 0 is marked, and one that still does
    where all rows are taken together.
    """
    head = ["arm", "domain", "measure", baseline, "arm's", "difference", "95 % interval"]
    head += ["clear of 0", "clear among all rows"]
    rows = []
    for d in differences:
        scores = [_number(d.reference), _number(d.reference + d.difference), f"{d.difference:+.4f}"]
        scores.append(f"[{d.low:+.4f}, {d.high:+.4f}]")
        clear = ["yes" if is_so else "no" for is_so in (d.clear, d.clear_in_family)]
        rows.append([d.arm, d.domain, MEASURES[d.measure][1], *scores, *clear])
    return ResultTable(f"Differences to {baseline}", head, rows, by_chance(differences))


def by_chance(differences: Sequence[Any]) -> str:
    """How many clear differences to expect where there are none."""
    count, clear = len(differences), sum(d.clear for d in differences)
    if not count:
        return ""
    return (
        f"{clear} of {count} intervals of 95 % leave out 0; {0.05 * count:.1f} would by chance if no arm did anything. "
        f'"Clear among all rows" is by the correction of Holm over all rows of the study: by chance there would be any in 5 % '
        "of the studies."
    )


def marked(table: ResultTable, notes: Mapping[str, str]) -> ResultTable:
    """A table whose arms that `notes` names (arm -> sentence) carry a dagger, with the sentences below."""
    cells = {cell for row in table.rows for cell in row} | set(table.head)
    if not (here := {arm: note for arm, note in notes.items() if arm in cells}):
        return table

    def mark(cells: Sequence[str]) -> list[str]:
        return [f"{cell} †" if cell in here else cell for cell in cells]

    made = replace(table, head=mark(table.head), rows=[mark(row) for row in table.rows])
    return made.with_note(" ".join(f"† {arm}: {note}." for arm, note in here.items()))


def weights_table(headline: str, means: Scores, other: str, others: Scores) -> ResultTable:
    """The same runs' other weights beside those of all other tables: means over seeds."""
    measures = ("box_ap", "keypoint_ap_paper", "keypoint_ap_coco")
    head = ["arm", "domain", *(f"{MEASURES[m][1]}, {w}" for m in measures for w in (headline, other))]
    both, places = (means, others), [(arm, domain) for arm in others for domain in others[arm]]
    rows = [[a, d, *(_number(each[a][d][m]) for m in measures for each in both)] for a, d in places]
    note = (
        f"All other tables hold {headline}. `best` is the epoch that the clean validation images chose, which may be the one "
        "that has seen the least noise."
    )
    return ResultTable(f"Weights of the same runs: {headline} and {other}", head, rows, note)


def overview_table(means: Scores, differences: Sequence[Any], baseline: str, most: int = 100) -> ResultTable:
    """One measure at a glance: test sets as rows, arms as columns, each with its change and whether that is clear.

    With more than `most` arms beside the baseline each has a row.
    """
    measure = "keypoint_ap_coco"
    changes = {(d.arm, d.domain): change(d) for d in differences if d.measure == measure}
    by_chance = f"{0.05 * len(changes):.1f} of these {len(changes)} would be called clear by chance."
    note = f"Each change has its own interval; {by_chance}" if len(changes) > 1 else ""
    label = MEASURES[measure][1]
    label = label[0].upper() + label[1:]

    def value_of(arm: str, domain: str) -> str:
        return f"{means[arm][domain][measure]:.3f}"

    def both(arm: str, domain: str) -> str:
        said = changes.get((arm, domain))
        return value_of(arm, domain) + (f" ({said})" if said else "")

    domains, others = domains_of(means), [arm for arm in means if arm != baseline]
    if len(others) > most:
        title = f"{label}: mean over seeds, and the change against {baseline} with its 95 % interval"
        rows = [[d, arm, value_of(arm, d), changes.get((arm, d), "")] for d in domains for arm in means]
        return ResultTable(title, ["test set", "arm", "AP", "change"], rows, note)
    title = f"{label}: mean over seeds; in brackets the change and its 95 % interval"
    columns = [*([baseline] if baseline in means else []), *others]
    rows = [[domain, *(both(arm, domain) for arm in columns)] for domain in domains]
    return ResultTable(title, ["test set", *columns], rows, note)


def change(difference: Any) -> str:
    """A difference with its interval and a one-word conclusion."""
    improves = sign(difference.low, difference.high) * (1 if MEASURES[difference.measure][2] else -1)
    return f"{('not clear', 'better', 'worse')[improves]}: {difference}"


POSE_COLUMNS = {
    "E_t mean, m": "position_error_m",
    "E_t median, m": "position_error_m_median",
    "E_q mean, deg": "attitude_error_deg",
    "E_q median, deg": "attitude_error_deg_median",
    "SPEC with floors": "spec_score_floored",
    "SPEC without": "spec_score_unfloored",
    "poses found": "poses_found",
}


def pose_table(summaries: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]) -> ResultTable:
    """Pose errors of arm -> domain -> the seeds' summaries: means over seeds."""
    rows = [
        [arm, domain, *(_number(_mean([s.get(key) for s in seeds])) for key in POSE_COLUMNS.values())]
        for arm, domains in summaries.items()
        for domain, seeds in domains.items()
    ]
    title = "Pose by PnP; a target without a pose counts as 180 deg and its whole distance"
    return ResultTable(title, ["arm", "domain", *POSE_COLUMNS], rows)


def comparison_table(means: Scores) -> ResultTable:
    """The paper's table 4 with these arms: target detection on SPEED."""
    own = {arm: (s["speed"]["iou"], s["speed"]["box_ap"]) for arm, s in means.items() if "speed" in s}
    rows = [[name, _number(iou), _number(ap)] for name, (iou, ap) in (*TABLE_4.items(), *own.items())]
    return ResultTable("Target detection on SPEED's images", ["method", "IoU mean", "box AP50-95"], rows)


def _latex(text: str) -> str:
    for character in "&%#_":
        text = text.replace(character, rf"\{character}")
    return text.replace("±", r"$\pm$").replace("†", r"$\dagger$").replace("^2", "$^2$")


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if len(known) == len(values) else None


def _number(number: float | None) -> str:
    return "" if number is None else f"{number:.4f}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
