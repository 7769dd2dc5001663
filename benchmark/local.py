"""Effects that act in a small part of a sensor of real size: in a corner, at an edge, at quarter seams.

Most pixels of a frame show nothing of them. What fills the sensor, stays in memory or lies in few pixels is in `effects`.
"""

from __future__ import annotations

import numpy as np

from .camera import Moment
from .effects import Kind

REACH_PX = 25  # decay length of the glow of one amplifier
EDGE_COLUMNS = 12


def corner_glow(mean_e: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """`strength` e-/s in one corner, falling by 1/e in `REACH_PX` pixels whatever the size of the sensor.

    Other form: Gaussian fall-off.
    """

    def glow() -> np.ndarray:
        rows, columns = mean_e.shape
        corner = at.die().integers(4)
        y, x = (axis + 0.5 for axis in np.ogrid[:rows, :columns])  # from the edge of the frame
        y = y if corner & 1 else rows - y
        x = x if corner & 2 else columns - x
        distance = np.hypot(y, x) / REACH_PX
        return np.exp(-(distance**2 if at.form == "Gaussian" else distance))

    return mean_e + strength * at.shot.seconds * at.once("glow", glow)


def edge_columns(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """`EDGE_COLUMNS` columns at the left or the right edge lie `strength` e- lower, in the dark as in light."""
    side = at.die().integers(2)
    lower = np.zeros(x.shape[1])
    lower[:EDGE_COLUMNS] = strength
    return x - (lower[::-1] if side else lower)


def quarter_taps(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Four taps, a quarter of the columns each; offsets of `strength` e- rms, gains of 0.1 % per e-.

    Other form: quarters of the rows.
    """
    rng, axis = at.die(), 0 if at.form == "rows" else 1
    offset, gain = (rng.permutation([-1.34, -0.45, 0.45, 1.34]) for _ in range(2))  # evenly spaced, rms 1
    tap = np.arange(x.shape[axis]) * 4 // x.shape[axis]
    shape = (-1, 1) if axis == 0 else (1, -1)
    return x * (1 + 1e-3 * strength * gain[tap].reshape(shape)) + strength * offset[tap].reshape(shape)


# fmt: off
KINDS: tuple[Kind, ...] = (
    Kind("corner_glow", "yield", corner_glow, "e-/s at the corner", 200, 1e5, "Gaussian", ("smooth",),
         ("exposure",)),
    Kind("edge_columns", "voltage", edge_columns, "e-", 4, 1e3, None, ("column",)),
    Kind("quarter_taps", "voltage", quarter_taps, "e-", 1, 100, "rows", ("column", "row", "smooth"), (),
         ("signal",)),
)
# fmt: on

CATALOGUE = {
    "corner_glow": ("amplifier_glow",),
    "edge_columns": ("fixed_pattern_structure",),
    "quarter_taps": ("column_parity",),
}
"""Names of the catalogue that describe a kind; none where no catalogue has it."""
