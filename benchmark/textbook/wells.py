"""Effects that move charge: between frames, to neighbours, along columns."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import convolve

from .effect import Effect, Moment
from .randomness import poisson


class ImageLag(Effect):
    """Traps catch a share of the charge and let it go over the next frames, from a fast and a slow pool (Smith 2008).

    The frame that was caught from loses it. share: caught; slow: the slow pool's part of it; release_fast, release_slow:
    share of a pool that comes free with each frame.
    """

    def prepare(self) -> None:
        self.pools = np.zeros((2, *self.camera.shape))

    def collected(self, x: np.ndarray, at: Moment) -> np.ndarray:
        shares = np.array([self.numbers["release_fast"], self.numbers["release_slow"]])[:, None, None]
        free = self.pools * shares
        self.pools = self.pools - free
        return x + poisson(self.rng, free.sum(0))

    def well(self, x: np.ndarray, at: Moment) -> np.ndarray:
        caught = np.minimum(poisson(self.rng, self.numbers["share"] * x), x)
        slow = self.numbers["slow"]
        self.pools = self.pools + caught * np.array([1 - slow, slow])[:, None, None]
        return x - caught


class BrighterFatter(Effect):
    """The field of a full pixel pushes its boundaries outwards, and charge with them (Antilogus 2014). None is lost.

    A boundary shifts with the difference of the charges beside it, a little smoothed for the reach of the field; what moves
    is that times the charge at the boundary. variance_loss_at_80pct: share of a flat's variance lost at 80 % of the full
    well; v_over_h: shift along columns over that along rows.
    """

    FIELD = np.array([[0.02, 0.08, 0.02], [0.08, 1, 0.08], [0.02, 0.08, 0.02]])

    def prepare(self) -> None:
        four_sides = 4 * (1 + self.numbers["v_over_h"])
        self.shift_per_e = self.numbers["variance_loss_at_80pct"] / (
            four_sides * 0.8 * self.camera.well_e * 0.93
        )

    def collected(self, x: np.ndarray, at: Moment) -> np.ndarray:
        q = np.minimum(x, self.camera.well_e)
        push = convolve(q, self.FIELD, mode="nearest")
        a, b = self.shift_per_e, self.shift_per_e * self.numbers["v_over_h"]
        to_right = a * (push[:, :-1] - push[:, 1:]) * (q[:, :-1] + q[:, 1:]) / 2
        to_below = b * (push[:-1] - push[1:]) * (q[:-1] + q[1:]) / 2
        x = x.copy()
        x[:, :-1] -= to_right
        x[:, 1:] += to_right
        x[:-1] -= to_below
        x[1:] += to_below
        return x


class Blooming(Effect):
    """What a well cannot hold runs up and down its column and fills other wells; a part is drained (Janesick).

    drained: share of the excess that the anti-blooming gate takes; up: share of the rest that runs to lower row numbers.
    """

    def collected(self, x: np.ndarray, at: Moment) -> np.ndarray:
        well, up = self.camera.well_e, self.numbers["up"]
        excess = np.maximum(x - well, 0) * (1 - self.numbers["drained"])
        x = np.minimum(x, well)
        rows, columns = x.shape
        for order, share in ((range(rows - 1, -1, -1), up), (range(rows), 1 - up)):
            carried = np.zeros(columns)
            for r in order:
                total = x[r] + carried
                x[r] = np.minimum(total, well)
                carried = total - x[r] + share * excess[r]
        return x


class ChargeTransferInefficiency(Effect):
    """Each transfer leaves a little behind, which comes out with the rows that follow (the CDM of Short 2013, simplified).

    cti: share caught in a transfer, at 30 % of the full well; beta: exponent of the charge that is caught; toward: first row or
    last row, which is read first; fast_share, tau_fast, tau_slow: share and release times, in rows, of two traps.
    """

    def well(self, x: np.ndarray, at: Moment) -> np.ndarray:
        p, (rows, columns) = self.numbers, x.shape
        order = range(rows) if p["toward"] == "first row" else range(rows - 1, -1, -1)
        shares = np.array([p["fast_share"], 1 - p["fast_share"]])[:, None]
        keeps = np.exp(-1 / np.array([p["tau_fast"], p["tau_slow"]]))[:, None]
        pools = np.zeros((2, columns))
        x = x.copy()
        for transfers, r in enumerate(order, 1):
            fill = (np.maximum(x[r], 1) / (0.3 * self.camera.well_e)) ** (p["beta"] - 1)
            caught = np.minimum(poisson(self.rng, p["cti"] * transfers * x[r] * fill), x[r])
            free = pools * (1 - keeps)
            pools = pools * keeps + caught * shares
            x[r] += free.sum(0) - caught
        return x


class InterpixelCrosstalk(Effect):
    """Neighbouring nodes couple by their capacitance (Moore 2006). Not charge moves but signal, so noise is shared too.

    h, v, d: share that shows in each neighbour along the row, along the column and across the corner.
    """

    def well(self, x: np.ndarray, at: Moment) -> np.ndarray:
        h, v, d = self.numbers["h"], self.numbers["v"], self.numbers["d"]
        kernel = np.array([[d, v, d], [h, 1 - 2 * h - 2 * v - 4 * d, h], [d, v, d]])
        return convolve(x, kernel, mode="nearest")
