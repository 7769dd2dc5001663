"""How far fitted parameters follow the true ones: what the intervals of an effect's parameters are divided by.

The fit solves J' W (S - m(x)) = 0 with derivatives J from finite steps. Where these are noisy, or where statistics are not linear
within a step, as along a period, the fit follows a true change of a parameter by less than J implies, and the spread of refits of
simulated sets by J alone is too small. The response R is the shift of the fit as a share of a true change of two standard
deviations, beyond what the prior takes of it. It is simulated with random numbers that are not used for J, for one parameter at a
time. The standard deviation of the refits is divided by R.
"""

from dataclasses import replace

import numpy as np

from visaug.diagnosis.fitting.parameters import is_of
from visaug.diagnosis.fitting.reference import MOST_PAIRS, Report, differences
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.scatter import least_response
from visaug.diagnosis.state import State

PAIRS = 8  # simulations of a response, on alternate sides
STEP = 2.0  # standard deviations of a refit by which a parameter is changed
DETERMINED = 0.5  # share that the frames must determine; of other parameters most is the prior


def with_responses(lab: Laboratory, state: State, report: Report) -> State:
    """The state with the response of the fit to the parameters of accepted effects, if it has enough simulated sets."""
    reference = state.fitted.reference
    if not state.accepted:
        return state
    spread, determined = reference.spread_steps.std(0, ddof=1), reference.determined
    own = [
        k
        for k, c in enumerate(reference.coordinates)
        if any(is_of(c.path, effect) for effect in state.accepted)
        and spread[k] > 0
        and determined[k] > DETERMINED
    ]
    numbers = range(MOST_PAIRS, MOST_PAIRS + PAIRS)
    if not own or len(reference.sets) < numbers.stop:
        return state
    steps, sets = {k: STEP * spread[k] for k in own}, [reference.sets]
    (quotients,) = differences(lab, reference.camera, reference.coordinates, steps, numbers, sets, report)
    response = np.ones(len(spread))
    for k, found in zip(own, quotients, strict=True):
        moved = reference.refitted(found * steps[k])[:, k] / steps[k]
        response[k] = least_response(moved.reshape(-1, 2).mean(1) / determined[k])
    return replace(state, fitted=replace(state.fitted, response=response))
