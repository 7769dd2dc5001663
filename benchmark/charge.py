"""Hidden effects in the silicon: on the electrons expected (`yield`) and on those in the wells (`charge`)."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from .camera import Moment

# ---- expected electrons ------------------------------------------------------------------------------------


def dark_current_nonuniformity(mean_e: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Pixels differ in dark current by a log-normal factor of mean 1.

    Other form: gamma, relative width alike.
    """
    if at.form == "gamma":
        shape = 1 / max(strength, 1e-3) ** 2
        factor = at.once("map", lambda: at.die().gamma(shape, 1 / shape, mean_e.shape))
        factor = factor if strength > 0 else 1.0
    else:
        factor = np.exp(
            strength * at.once("map", lambda: at.die().standard_normal(mean_e.shape)) - strength**2 / 2
        )
    return mean_e + at.thermal_e * (factor - 1)


def hot_pixels(mean_e: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share `strength` of the pixels leaks far more, with a smaller activation.

    Other form: pairs, power law.
    """

    def leak() -> tuple[np.ndarray, float]:
        rng = at.die()
        hot = rng.random(mean_e.shape) < strength * (0.5 if at.form == "pairs" else 1.0)
        if at.form == "pairs":
            hot |= np.roll(hot, 1, axis=1)
            size = rng.pareto(1.5, mean_e.shape) + 1
            size = 30 * np.minimum(size, 60)
        else:
            size = np.exp(rng.normal(4.5, 0.8, mean_e.shape))
        return hot * size, float(rng.uniform(0.5, 0.75))

    excess, softer = at.once("leak", leak)
    sensor = at.sensor
    reference = sensor.dark_e_per_s * np.exp(sensor.dark_per_c * 20)
    return (
        mean_e
        + excess * reference * np.exp(softer * sensor.dark_per_c * (at.shot.celsius - 20)) * at.shot.seconds
    )


def amplifier_glow(mean_e: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """`strength` e-/s in one corner, falling exponentially with distance; other form: from an edge.

    No activation.
    """

    def glow() -> np.ndarray:
        rng = at.die()
        rows, columns = mean_e.shape
        y, x = np.mgrid[0:rows, 0:columns] + 0.5  # from the edge of the frame
        corner, reach = rng.integers(4), rng.uniform(0.12, 0.3) * np.hypot(rows, columns)
        y = y if corner & 1 else rows - y
        x = x if corner & 2 else columns - x
        if at.form == "edge":
            return np.exp(-(y if rng.random() < 0.5 else x) / reach)
        return np.exp(-np.hypot(y, x) / reach)

    return mean_e + strength * at.shot.seconds * at.once("glow", glow)


def clock_induced_charge(mean_e: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """`strength` e- per pixel and frame made by clocking.

    Other form: in proportion to the row's transfers.
    """
    if at.form == "by transfers":
        return mean_e + strength * 2 * (np.arange(mean_e.shape[0])[:, None] + 1) / mean_e.shape[0]
    return mean_e + strength


def smear(mean_e: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Each pixel crosses its whole column while it is read; `strength` is read time over nominal integration.

    Other form: only on its way out, so it gathers from the rows that it passes.
    """
    if at.shot.kind not in ("flat", "scene"):
        return mean_e
    photo = mean_e - at.thermal_e
    per_row = photo * strength * at.sensor.integration_s / at.shot.seconds / photo.shape[0]
    if at.form == "one way":
        return mean_e + np.cumsum(per_row, axis=0) - per_row
    return mean_e + per_row.sum(axis=0, keepdims=True)


# ---- electrons in the wells --------------------------------------------------------------------------------


def cosmic_rays(electrons: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """`strength` straight tracks a second over the frame.

    Other form: short worms with an exponential spectrum.
    """
    rng = at.now()
    rows, columns = electrons.shape
    electrons = electrons.copy()
    for _ in range(rng.poisson(strength * at.shot.seconds)):
        y, x, angle = rng.uniform(0, rows), rng.uniform(0, columns), rng.uniform(0, 2 * np.pi)
        if at.form == "worms":
            length, per_pixel = rng.integers(2, 6), rng.exponential(400) + 60
        else:
            length, per_pixel = 1 + int(rng.exponential(7)), 80 * rng.uniform(1, 4)
        for _ in range(length):
            if 0 <= int(y) < rows and 0 <= int(x) < columns:
                electrons[int(y), int(x)] += rng.poisson(per_pixel)
            if at.form == "worms":
                angle += rng.normal(0, 0.8)
            y, x = y + np.sin(angle), x + np.cos(angle)
    return electrons


def image_lag(electrons: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share of the charge stays behind and is read with the next frame.

    Other form: traps that empty slowly.
    """
    left = at.memory.get("left", np.zeros_like(electrons))
    share = min(strength, 1.0)
    held = np.minimum(electrons, at.sensor.well_e).astype(np.int64)
    if at.form == "slow traps":
        out = at.now("release").binomial(left.astype(np.int64), 0.6)
        caught = at.now("catch").binomial(held, share)
        at.memory["left"] = left - out + caught
        return electrons - caught + out
    total = held + left.astype(np.int64)
    stays = at.now().binomial(total, share)
    at.memory["left"] = stays.astype(float)
    return electrons + left - stays


def brighter_fatter(electrons: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A full well pushes its borders: (q_i^2 - q_j^2) * strength / well moves to each neighbour.

    Other form: twice as strong along the column, and a tail to the neighbour after next.
    """
    q = np.minimum(electrons, 1.5 * at.sensor.well_e)
    push = strength / at.sensor.well_e * q**2
    moved = electrons.copy()
    steps = [(0, 1, 1.0), (1, 1, 1.0)]
    if at.form == "column-wise with tail":
        steps = [(0, 1, 1.2), (1, 1, 0.6), (0, 2, 0.25), (1, 2, 0.12)]
    for axis, distance, weight in steps:
        near = [slice(None)] * 2
        far = [slice(None)] * 2
        near[axis], far[axis] = slice(None, -distance), slice(distance, None)
        flux = weight * (push[tuple(near)] - push[tuple(far)])
        moved[tuple(near)] -= flux
        moved[tuple(far)] += flux
    return moved


def blooming(electrons: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share of what a well cannot hold runs to the column neighbours; the rest is drained.

    Other form: four fifths of it run one way.
    """
    well = at.sensor.well_e
    excess = np.maximum(electrons - well, 0)
    if not excess.any() or strength == 0:
        return electrons
    down = 0.8 if at.form == "one way mostly" else 0.5
    filled = np.minimum(electrons, well)
    for share, order in ((down, 1), (1 - down, -1)):
        spill = min(strength, 1.0) * share * excess[::order]
        flow = np.zeros(electrons.shape[1])
        rows = filled[::order].copy()
        for r in range(rows.shape[0]):
            room = well - rows[r]
            kept = np.minimum(flow, room)
            rows[r] += kept
            flow = flow - kept + spill[r]
        filled = rows[::order]
    return np.maximum(filled, np.minimum(electrons, well))


def charge_transfer_inefficiency(electrons: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Each transfer loses `strength` of a packet to the ones behind it. Row 0 is read first.

    Other form: along the row register, with small packets losing a larger share (trap volume ~ q^0.7).
    """
    q = np.minimum(electrons, at.sensor.well_e)
    serial = at.form == "serial, traps"
    if serial:
        q = q.T
    transfers = np.arange(1, q.shape[0] + 1)[:, None]
    lost = q * (1 - (1 - strength) ** transfers)
    if serial:
        lost = np.minimum(lost * (np.maximum(q, 1) / at.sensor.well_e) ** -0.3, q)
    keep = np.exp(-1 / 2.5)
    behind = lfilter([0, 1 - keep], [1, -keep], lost, axis=0)
    out = q - lost + behind
    return out.T if serial else out
