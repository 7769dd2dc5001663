"""Errors of fitted cameras on the discovery and hold-out frames, and which of the two is reported."""

from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.reference import Reference
from visaug.diagnosis.laboratory import Laboratory
from visaug.statistics.distance import Distance, Error, is_clear

# Width of an interval above which an error is not reported: the file as given has no significant excess
VAGUE = 5.0


class Errors:
    """Errors of the cameras of one measured set.

    Args:
        first: the reference of the camera file as given, whose error is 1.
        fitted: the refitted camera file, which decides on which frames errors are reported.
    """

    def __init__(self, lab: Laboratory, first: Reference, fitted: Fitted):
        self.lab = lab
        find, confirm, _ = lab.measured
        self.distance = Distance(find.statistics, find.values, first.find.sets, first.find.least)
        self._confirming = Distance(
            confirm.statistics, confirm.values, first.confirm.sets, first.confirm.least
        )
        self._confirms = self._is_confirming_clearer(fitted)

    def told(self, fitted: Fitted) -> Error | None:
        """The reported error: of the hold-out frames or, if these are too few for a significant excess, of the discovery frames."""
        errors = [self.confirmed(fitted) if self._confirms else None, self.found(fitted)]
        known = [error for error in errors if error is not None and error.high - error.low <= VAGUE]
        return next((error for error in known if is_clear(error)), known[0] if known else None)

    def found(self, fitted: Fitted) -> Error | None:
        """Error of the discovery frames."""
        return self.distance.error(fitted.reference.sets, fitted.residual)

    def confirmed(self, fitted: Fitted) -> Error | None:
        """The same on the hold-out frames."""
        if not len(self._confirming.measured):
            return None
        return self._confirming.error(fitted.reference.confirm.sets, fitted.confirm_residual)

    def _is_confirming_clearer(self, fitted: Fitted) -> bool:
        """Whether errors are reported on the hold-out frames: always, unless the excess is less significant there."""
        found, confirmed = self.found(fitted), self.confirmed(fitted)
        if confirmed is None or found is None or is_clear(confirmed):
            return confirmed is not None
        return confirmed.high - confirmed.low < found.high - found.low
