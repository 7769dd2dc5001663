"""States of the search: a fitted camera, the effects added to it, and the tolerance of their forms."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.law import FORM
from visaug.diagnosis.fitting.parameters import Coordinate
from visaug.diagnosis.fitting.reference import CERTAIN, Null, SimulatedStatistics
from visaug.diagnosis.fitting.robust import p_value, standardised
from visaug.diagnosis.fitting.uses import Use
from visaug.diagnosis.scatter import ANSWERS, VarianceStrength
from visaug.statistics.tail import SIGNIFICANT


@dataclass(frozen=True)
class State:
    """State of the search.

    Attributes:
        fitted: the fitted camera.
        accepted: names of the effects added so far.
        explained: residual that accepted effects explain: per statistic of the discovery, the hold-out and all frames.
        views: number of the view of each of these statistics.
        scatters: accepted effects whose strength is estimated from the variance that they cause and not from a mean shift;
            that strength is not a fitted parameter.
    """

    fitted: Fitted
    accepted: tuple[str, ...]
    explained: tuple[np.ndarray, np.ndarray, np.ndarray]
    views: tuple[np.ndarray, np.ndarray, np.ndarray]
    scatters: tuple[VarianceStrength, ...] = ()

    @classmethod
    def plain(cls, fitted: Fitted, views: tuple[np.ndarray, np.ndarray, np.ndarray]) -> "State":
        """The state of a camera without added effects."""
        find, confirm, whole = (np.zeros(len(left)) for left in fitted.residuals)
        return cls(fitted, (), (find, confirm, whole), views)

    def with_effect(self, effect: str, fitted: Fitted) -> "State":
        """The state with one more effect, which explains what it removes of the residuals."""
        removed = (
            np.maximum(np.abs(before) - np.abs(after), 0.0)
            for before, after in zip(self.fitted.residuals, fitted.residuals, strict=True)
        )
        find, confirm, whole = (
            np.hypot(old, part) for old, part in zip(self.explained, removed, strict=True)
        )
        return State(fitted, (*self.accepted, effect), (find, confirm, whole), self.views, self.scatters)

    @cached_property
    def find(self) -> Use:
        """The discovery frames."""
        reference = self.fitted.reference
        return self._use(self.fitted.residual, reference.find, reference.null, 0)

    @cached_property
    def confirm(self) -> Use:
        """The hold-out frames."""
        reference = self.fitted.reference
        return self._use(self.fitted.confirm_residual, reference.confirm, reference.confirm_null, 1)

    @cached_property
    def whole(self) -> Use:
        """All frames together."""
        reference = self.fitted.reference
        return self._use(self.fitted.whole_residual, reference.whole, reference.whole_null, 2)

    def _use(self, residual: np.ndarray, sample: SimulatedStatistics, null: Null, number: int) -> Use:
        allowance = tolerance(self.explained[number], null.scale, self.views[number])
        return Use(residual, sample.sets, null, allowance)

    @property
    def camera(self) -> Camera:
        """The fitted camera, with the strengths that variance tells as estimated and not as they were simulated."""
        camera = self.fitted.camera
        for told in self.scatters:
            camera = told.estimated(camera)
        return camera

    @property
    def numbers(self) -> tuple[tuple[Coordinate, ...], np.ndarray, np.ndarray]:
        """All fitted parameters and their uncertainty.

        Returns the coordinates, their steps in refits of (R,) simulated sets (R, coordinates), and the standard deviation
        (coordinates,) of what the frames do not determine, of the fit's simulations, and of what is considered and not fitted.
        Steps are NaN in sets that do not determine one: an effect whose strength is estimated from variance can have more sets
        than the state.
        """
        reference = self.fitted.reference
        scattering = [c for s in self.scatters for c in s.strengths]
        response = np.broadcast_to(self.fitted.response, len(reference.coordinates))
        spread, by_priors = lengthened(reference.spread_steps, response, reference.priors)
        parts = [spread, *(s.steps for s in self.scatters)]
        most = max(map(len, parts))
        steps = np.hstack(
            [np.pad(part, ((0, most - len(part)), (0, 0)), constant_values=np.nan) for part in parts]
        )
        by_frames = np.hypot(
            reference.undetermined, self.fitted.simulation_error / np.maximum(response, ANSWERS)
        )
        own = np.hypot(np.where(response >= ANSWERS, by_frames, 0.0), by_priors)
        own = np.hypot(own, self.fitted.by_considered)
        undetermined = np.concatenate([own, *(s.undetermined for s in self.scatters)])
        return (*reference.coordinates, *scattering), steps, undetermined

    @property
    def p_value(self) -> float:
        """Probability, for a complete camera, of a largest residual in all frames at least as large as this one."""
        return p_value(float(np.abs(self.whole.z).max()), self.fitted.reference.largest)

    @property
    def is_adequate(self) -> bool:
        return self.p_value > SIGNIFICANT


def lengthened(steps: np.ndarray, response: np.ndarray, priors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps of refits, those of parameters that a fit follows only in part divided by its response, others moved along.

    What trades off with such a parameter is as uncertain as that: its steps are continued by their regression on the steps of
    the parameter, where that differs from 0 by `CERTAIN` standard errors. Below `ANSWERS` the frames do not determine a
    parameter, and its prior takes the place of its steps.

    Args:
        steps: (R, coordinates) of the refits of simulated sets.
        response: (coordinates,) see `visaug.diagnosis.response`.
        priors: (coordinates,) standard deviations.

    Returns:
        The steps (R, coordinates), and the standard deviation (coordinates,) that comes from priors.
    """
    follows, short = response >= ANSWERS, response < 1.0
    along = np.zeros((len(response), len(response)))
    if short.any() and len(steps) > 1 + short.sum():
        own = steps[:, short] - steps[:, short].mean(0)
        others = steps[:, ~short] - steps[:, ~short].mean(0)
        inverse = np.linalg.pinv(own.T @ own)
        slopes = inverse @ own.T @ others
        left = ((others - own @ slopes) ** 2).sum(0) / (len(steps) - 1 - short.sum())
        errors = np.sqrt(np.diag(inverse)[:, None] * left)
        along[np.ix_(short, ~short)] = np.where(np.abs(slopes) > CERTAIN * errors, slopes, 0.0)
    divided = np.where(follows, steps / np.maximum(response, ANSWERS), 0.0)
    more = np.where(follows, divided - steps, 0.0)
    taken = np.where(follows, 0.0, priors)[:, None] * (along + np.eye(len(response)))
    return divided + more @ along, np.minimum(np.sqrt((taken**2).sum(0)), priors)


def tolerance(explained: np.ndarray, scale: np.ndarray, views: np.ndarray) -> np.ndarray:
    """Residual (statistics,) that may stay because accepted effects do not have exactly the catalogue's forms.

    It is a share of what the effects explain of a statistic, or of its view, whichever is more: another form also changes
    statistics that the catalogue's form leaves as they are. Of a view this is the root mean square, in standard deviations.
    """
    squares, counts = (
        np.bincount(views, weights)
        for weights in (standardised(explained, scale) ** 2, (scale > 0).astype(float))
    )
    of_view = np.sqrt(squares / np.maximum(counts, 1.0))[views]
    return FORM * np.maximum(explained, of_view * scale)
