"""Values of a search: what stays the same during it, and the camera after each of its steps."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from visaug.camera import Camera
from visaug.diagnosis.adding import Adding
from visaug.diagnosis.candidates.refinement import Refined
from visaug.diagnosis.candidates.signatures import Signatures, resolved, signatures
from visaug.diagnosis.candidates.trials import Trial
from visaug.diagnosis.chance import chance
from visaug.diagnosis.choice import Judged
from visaug.diagnosis.fitting.errors import Errors
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.reference import Reference, Report
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.response import with_responses
from visaug.diagnosis.result import Ranked
from visaug.diagnosis.state import State
from visaug.statistics.distance import Error
from visaug.statistics.tail import SIGNIFICANT

Looks = Callable[[Laboratory, Camera, frozenset[str]], list[Trial]]


@dataclass(frozen=True)
class Setting:
    """What the steps of a search have in common.

    Attributes:
        lab: of the measured frames.
        first: simulated sets of the camera file as given.
        signs: signatures of trials, all that were simulated so far.
        without: effects that are not tried.
        adding: simulates cameras with an effect added.
        errors: of cameras, relative to the file as given.
        report: progress.
        has_looked: whether `signs` has the trials whose values come from the frames themselves.
    """

    lab: Laboratory
    first: Reference
    signs: Signatures
    without: frozenset[str]
    adding: Adding
    errors: Errors
    report: Report
    has_looked: bool = False

    @cached_property
    def unfitted(self) -> Fitted:
        """The camera file with its parameters as they are."""
        return Fitted.unfitted(self.lab, self.first)

    def telling(self, report: Report) -> "Setting":
        """The same with another progress."""
        return replace(self, report=report, adding=replace(self.adding, report=report))

    def with_looks(self, looks: Looks) -> "Setting":
        """With signatures of trials whose values come from the frames themselves; these are no part of the test of adequacy."""
        if self.has_looked:
            return self
        signs = resolved(self.lab, self.first, self.signs, self.report)
        tried = looks(self.lab, self.first.camera, self.without)
        return replace(
            self, signs=signs + signatures(self.lab, self.first, tried, self.report), has_looked=True
        )

    def tested(self, state: State) -> tuple[State, float]:
        """A state, by as many simulated sets as its test of adequacy takes, with responses of its fit, and the p-value."""
        test = chance(self.lab, self.signs, state)
        if not test.is_decided:
            state = self.adding.grown(state, self.adding.sets)
            test = chance(self.lab, self.signs, state)
        return with_responses(self.lab, state, self.report), test.p_value


@dataclass(frozen=True)
class SearchStage:
    """A camera after a step of the search.

    Attributes:
        state: the refitted camera with the effects accepted so far.
        p_value: of its largest residual or match in all frames.
        error: of the camera, as reported.
        standing: of the last effect, the candidate that was added, and its rivals.
        refined: candidates by name, as refined in the last step that tried them.
        ranked: candidates of all steps so far by name; an accepted one as in its own step.
        ambiguous: effects that the frames do not distinguish, and what would.
    """

    state: State
    p_value: float
    error: Error | None
    standing: tuple[Judged, ...] = ()
    refined: Mapping[str, Refined] = field(default_factory=dict)
    ranked: Mapping[str, Ranked] = field(default_factory=dict)
    ambiguous: tuple[dict[str, Any], ...] = ()

    @property
    def is_missing(self) -> bool:
        return self.p_value <= SIGNIFICANT

    @property
    def action(self) -> str:
        return f"add {self.state.accepted[-1]}" if self.state.accepted else "refit"


History = tuple[SearchStage, ...]
