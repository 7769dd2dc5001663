"""Loss of a network by a hidden effect, and the gain by its diagnosis: the outcome of a study with `hidden`."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from visaug.report.html import Figure, Section, Table, Text, figure
from visaug.report.plots.error import plot_error_steps
from visaug.report.plots.images import plot_images
from visaug_train import tables
from visaug_train.plots import plot_scores
from visaug_train.reduction import read_pixels
from visaug_train.studies.hidden import PLAIN, HiddenEffect

if TYPE_CHECKING:
    from visaug_train.results import Ablation

MEASURE = "keypoint_ap_coco"
PAGE = ("hidden effect", "named", "cost", "change", "change by a wrong effect", "change by who knew")
COST = 0.15  # loss of keypoint AP that an effect should cause, so that a few seeds can show the gain


@dataclass(frozen=True)
class Change:
    """A difference of keypoint AP50-95 (COCO's) with its 95 % interval over images and seeds."""

    before: float
    after: float
    low: float
    high: float

    @property
    def clear(self) -> int:
        """1 or -1 where the interval leaves out 0, else 0."""
        return int(self.low > 0) - int(self.high < 0)

    def __str__(self) -> str:
        return tables.signed(self.after - self.before, self.low, self.high)


@dataclass(frozen=True)
class Outcome:
    """One hidden effect: the loss of the baseline, and the change by each other training on its test set.

    `named`, `wrong` and `known` are against the baseline, `over_wrong` is named against wrong; None where there
    is no such arm, or not yet.
    """

    hidden: HiddenEffect
    cost: Change
    named: Change | None
    wrong: Change | None
    known: Change | None
    over_wrong: Change | None

    def finding(self) -> str:
        """What came out, whichever way, in a few sentences."""
        name, domain = self.hidden.effect["name"], self.hidden.domain
        cost, lost = self.cost, self.cost.before - self.cost.after
        costs = f"costs the network {lost:.3f}" if cost.clear < 0 else "costs nothing clear:"
        accepted = ", ".join(self.hidden.answer["accepted"]) or "nothing"
        points = f"{cost.before:.3f} without it, {cost.after:.3f} with it; {cost}"
        said = [
            f"{domain} ({name}): the effect {costs} keypoint AP ({points}).",
            f"The diagnosis named {accepted}, which is {'right' if self.hidden.right else 'wrong'}.",
        ]
        if self.named is not None:
            verdict = {1: "raises", 0: "does not clearly change", -1: "lowers"}[self.named.clear]
            said.append(
                f"Training with it {verdict} the AP ({self.named.before:.3f} to {self.named.after:.3f}; {self.named})."
            )
        if self.wrong is not None and self.over_wrong is not None:
            better = {1: "better than", 0: "not clearly other than", -1: "worse than"}[self.over_wrong.clear]
            said.append(
                f"The control, {self.hidden.wrong}, changes it by {self.wrong}: the named effect is {better} that "
                f"({self.over_wrong})."
            )
        if self.hidden.known == self.hidden.named:
            said.append("Who knew the effect would have trained the same way.")
        elif self.known is not None:
            said.append(f"Who knew the effect gains {self.known}.")
        if lost < COST:
            said.append(f"It costs less than {COST}, so there is little to win back.")
        return " ".join(said)

    def to_json(self) -> dict[str, Any]:
        """Numbers of the outcome."""
        changes = {name: getattr(self, name) for name in ("cost", "named", "wrong", "known", "over_wrong")}
        return {
            "domain": self.hidden.domain,
            "effect": self.hidden.effect,
            "accepted": self.hidden.answer["accepted"],
            "found": self.hidden.found,
            "arms": {"named": self.hidden.named, "known": self.hidden.known, "wrong": self.hidden.wrong},
            **{name: None if change is None else asdict(change) for name, change in changes.items()},
        }


def outcomes(ablation: "Ablation") -> list[Outcome]:
    """The outcome of each hidden effect whose baseline was trained."""
    baseline = ablation.config.baseline

    def change(arm: str | None, domain: str, other: tuple[str | None, str]) -> Change | None:
        if arm is None or other[0] is None:
            return None
        found = ablation.compare((arm, domain), (other[0], other[1])).get(MEASURE)
        return found and Change(found[0], found[0] + found[1], found[2], found[3])

    made = []
    for each in ablation.study.hidden:
        before = (baseline, each.domain)
        cost = change(baseline, each.domain, (baseline, PLAIN))
        if cost is not None:
            arms = (each.named, each.wrong, each.known)
            named, wrong, known = (change(arm, each.domain, before) for arm in arms)
            over = change(each.named, each.domain, (each.wrong, each.domain))
            made.append(Outcome(each, cost, named, wrong, known, over))
    return made


def effect_table(ablation: "Ablation") -> tables.ResultTable:
    """A row for each hidden effect: the diagnosis, the loss, and the gain by each training."""
    columns: dict[str, Callable[[Outcome], object]] = {
        "hidden effect": lambda o: o.hidden.effect["name"],
        "named": lambda o: ", ".join(o.hidden.answer["accepted"]) or "nothing",
        "AP without it": lambda o: f"{o.cost.before:.3f}",
        "AP with it": lambda o: f"{o.cost.after:.3f}",
        "cost": lambda o: o.cost,
        "trained with what was named": lambda o: o.named and f"{o.named.after:.3f}",
        "change": lambda o: o.named,
        "change by a wrong effect": lambda o: o.wrong and f"{o.wrong} ({o.hidden.wrong})",
        "named over wrong": lambda o: o.over_wrong,
        "change by who knew": lambda o: "the same run" if o.hidden.known == o.hidden.named else o.known,
    }
    rows = [[str(of(o) or "") for of in columns.values()] for o in outcomes(ablation)]
    title = "Hidden effects: keypoint AP50-95 (COCO's) on the camera that has them"
    return tables.ResultTable(title, list(columns), rows)


def proof_sections(ablation: "Ablation") -> list[Section]:
    """The sections of a report: the outcome, what the cameras see, and each diagnosis."""
    if not ablation.study.hidden:
        return []
    return [
        Section(
            "What a hidden effect costs, and how much accuracy the diagnosis recovers",
            list(_outcome(ablation)),
        ),
        Section("What the cameras see", [_views(ablation)]),
        Section("How the effects were found", list(_diagnoses(ablation))),
    ]


def _outcome(ablation: "Ablation") -> Iterator[Text | Table | Figure]:
    made = outcomes(ablation)
    yield Text(
        "A camera has an effect that its file leaves out. The network was trained with the noise of the file; frames"
        " of the camera were diagnosed, starting from that file; and the same network was trained again with the"
        " noise of the diagnosed camera. The control was trained with an effect that this camera does not have."
    )
    for outcome in made:
        yield Text(outcome.finding(), "finding")
    if made:
        yield figure(
            plot_scores(_points(ablation, made)),
            "Keypoint AP50-95 (COCO's) on the same views, taken by the camera without and with the effect. Bars: mean"
            " over seeds; dots: seeds.",
        )
    table = effect_table(ablation)
    shown = [table.head.index(name) for name in PAGE]  # the rest is in the sentences above
    rows = [[row[i].split(" (")[0] for i in shown] for row in table.rows]
    head = [name.removeprefix("change ") for name in PAGE]
    yield Table(head, rows, "Keypoint AP50-95 (COCO's): cost and changes, with 95 % intervals.")
    yield Text(f"95 % intervals: {ablation.interval_covers}.", "note")
    yield Text(
        "The strengths were chosen beforehand on one baseline network alone, so that each effect costs it something;"
        " nothing was chosen by what the other networks score.",
        "note",
    )


def _points(ablation: "Ablation", made: list[Outcome]) -> dict[str, dict[str, list[float]]]:
    """effect -> training -> AP of each seed."""
    baseline = ablation.config.baseline

    def values(arm: str | None, domain: str) -> list[float]:
        return ablation.of_seeds(arm, domain, MEASURE) if arm else []

    found = {}
    for o in made:
        domain = o.hidden.domain
        bars = {
            "camera without the effect": values(baseline, PLAIN),
            "with it, trained without": values(baseline, domain),
            "trained with a wrong effect": values(o.hidden.wrong, domain),
            "trained with what was named": values(o.hidden.named, domain),
        }
        if o.hidden.known != o.hidden.named:
            bars["trained knowing it"] = values(o.hidden.known, domain)
        found[o.hidden.effect["name"]] = bars
    return found


def _views(ablation: "Ablation") -> Figure:
    shown = [PLAIN, *(each.domain for each in ablation.study.hidden)]
    count = len(ablation.study.tests[PLAIN])
    chosen = np.linspace(0, count - 1, 4).astype(int)
    files = [(domain, ablation.study.tests[domain].files[i]) for domain in shown for i in chosen]
    pictures = [read_pixels(file) / 255 for _, file in files]
    return figure(
        plot_images(pictures, [domain for domain, _ in files], limits=(0, 1)),
        "The same views by the camera without an effect (plain) and with each.",
        raster=True,
    )


def _diagnoses(ablation: "Ablation") -> Iterator[Text | Table | Figure]:
    rows = []
    for each in ablation.study.hidden:
        name = each.effect["name"]
        found = next((e for e in each.found if e["name"] == name), {})
        for key, value in each.effect.items():
            if key != "name":
                other = found.get(key, "not named" if not found else "default")
                rows.append([name, key, _shown(value), _shown(other)])
    head = ["effect", "parameter", "hidden", "found"]
    yield Table(head, rows, "What was hidden, and what the diagnosis found.")
    for each in ablation.study.hidden:
        steps = [step for step in each.answer["steps"] if step["error"] is not None]
        if steps:
            error = each.answer["error"]
            yield figure(
                plot_error_steps(steps, error["before"], error["floor"]),
                f"{each.domain}: the error of the camera's file falling, on frames that were not used for finding.",
            )


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, int | float) else str(value)
