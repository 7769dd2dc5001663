"""Uncertainty of fitted parameters by one that is not fitted, such as the light beyond the frame.

It is considered (S. F. Schmidt, Adv. Control Syst. 3 (1966) 293): it keeps its value, and its standard deviation is propagated to
the parameters that are fitted. A fit would take the best of its values for the truth where none of them is, since the light beyond
the frame is no multiple of the mirror image, and flats have another than scenes; the intervals would be too narrow.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.state import State
from visaug.effects import Parameter, catalogue

SETS = 8  # simulated sets of a camera with another value, with common random numbers


def considered(effect: str) -> dict[str, Parameter]:
    """The parameters of an effect that are kept at their values in a fit and taken as unknown, by path."""
    return {f"{effect}.{key}": p for key, p in catalogue()[effect].parameters.items() if p.unknown > 0}


def considering(lab: Laboratory, state: State) -> State:
    """The state with the uncertainty that its fitted parameters have by considered ones of the accepted effects."""
    fitted = state.fitted
    numbers = range(min(SETS, len(fitted.reference.sets)))
    elsewhere = list(_elsewhere(fitted.camera, state.accepted))
    if not elsewhere:
        return state
    here = lab.finding([(fitted.camera, k) for k in numbers])
    shifts = [(lab.finding([(there, k) for k in numbers]) - here).mean(0) for there in elsewhere]
    steps = fitted.reference.refitted(np.array(shifts))
    return replace(state, fitted=replace(fitted, by_considered=np.sqrt((steps**2).sum(0))))


def _elsewhere(camera: Camera, effects: tuple[str, ...]) -> Iterator[Camera]:
    """The camera with each considered parameter of these effects one standard deviation away, within its bounds."""
    for path, p in (pair for effect in effects for pair in considered(effect).items()):
        value = camera.values()[path]
        lower = value - p.unknown
        yield camera.replace({path: lower if lower >= p.low else value + p.unknown})
