"""What a camera without and with an effect leaves over, made by hand."""

from types import SimpleNamespace

import numpy as np

from visaug.diagnosis.acceptance import State
from visaug.diagnosis.reference import Null


def state(z, moves=None) -> State:
    """Residuals in units of their standard deviation, one view each."""
    z = np.array(z, float)
    unit = np.tile([[1.0], [-1.0]], (1, len(z))) / np.sqrt(2)  # of which the standard deviation is 1
    null = Null(unit, np.ones(len(z)), np.zeros((len(z), 0)), np.ones(0))
    reference = SimpleNamespace(null=null, confirm_null=null, null_scale=null.scale)
    fitted = SimpleNamespace(reference=reference, residual=z, confirm_residual=z, whole_residual=z, z=z)
    return State(fitted, (), np.zeros(len(z)), np.zeros(len(z)), moves, moves)  # type: ignore[arg-type]


def spread(after: State, scale: float | np.ndarray, together: float = 0.0) -> State:
    """The state with 60 sets that scatter by so much; `together`: the share of the variance that all statistics have in common."""
    rng = np.random.default_rng(5)
    count = len(after.fitted.residual)
    sets = np.sqrt(1 - together) * rng.standard_normal((60, count)) + np.sqrt(together) * rng.standard_normal(
        (60, 1)
    )
    reference = after.fitted.reference
    reference.null = Null(scale * sets, np.ones(count), np.zeros((count, 0)), np.ones(0))
    reference.null_scale = reference.null.scale
    return after
