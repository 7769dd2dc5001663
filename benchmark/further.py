"""Further effects that real cameras have: the same as in `effects`, in a list of their own so that older sets stay as they are.

`converter` effects act on real DN just before the rounding.
"""

from __future__ import annotations

import numpy as np

from .camera import Moment
from .effects import Kind
from .randomness import coloured

# ---- light and expected electrons --------------------------------------------------------------------------


def lamp_flicker(light: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A sine over the rows of relative amplitude `strength`, phase new in every frame; other form: rectified."""
    period = at.die().uniform(14, 50)
    turns = np.arange(light.shape[0])[:, None] / period + at.now().random()
    if (
        at.form == "rectified"
    ):  # |sin| has twice the frequency, the mean 2 / pi and a first amplitude of 4 / (3 pi)
        wave = (np.abs(np.sin(np.pi * turns)) - 2 / np.pi) * 3 * np.pi / 4
    else:
        wave = np.sin(2 * np.pi * turns)
    return light * (1 + strength * wave)


def fringing(light: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Rings of interference in a thin layer of uneven thickness, relative amplitude `strength`."""
    rng = at.die()
    rows, columns = light.shape
    y, x = np.mgrid[0:rows, 0:columns] / max(rows, columns)
    path = rng.uniform(4, 7) * np.hypot(y - rng.uniform(-0.3, 0.3), x - rng.uniform(-0.3, 0.3)) ** 2
    return light * (1 + strength * np.cos(2 * np.pi * (path + rng.random())))


def dust(light: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Six specks on the window: dark discs of some pixels, `strength` deep, with a brighter middle."""
    rng = at.die()
    rows, columns = light.shape
    y, x = np.mgrid[0:rows, 0:columns]
    shade = np.ones_like(light)
    for _ in range(6):
        r = np.hypot(y - rng.uniform(0, rows), x - rng.uniform(0, columns)) / rng.uniform(4, 9)
        shade *= 1 - strength * (np.exp(-(r**4)) - 0.6 * np.exp(-((2.5 * r) ** 2)))
    return light * shade


def uneven_light(light: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A lamp beside the axis lights flats by cos^4 of the angle, `strength` from the darkest to the brightest pixel.

    Scenes are lit otherwise. Other form: a Gaussian spot.
    """
    if at.shot.kind != "flat":
        return light
    rng = at.die()
    rows, columns = light.shape
    y, x = (2 * np.mgrid[0:rows, 0:columns] + 1) / max(rows, columns) - 1
    turn, away = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.9)
    r2 = (y - away * np.sin(turn)) ** 2 + (x - away * np.cos(turn)) ** 2
    lit = np.exp(-r2 / 3) if at.form == "spot" else (1 + r2 / 6) ** -2
    return light * (1 + strength * (lit - lit.mean()) / np.ptp(lit))


def parasitic_light(mean_e: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """The last row collects `strength` of its light at the nominal exposure once more while it waits; other form: the first."""
    wait = np.linspace(0, 1, mean_e.shape[0])[:, None]
    wait = wait[::-1] if at.form == "first" else wait
    lit = mean_e - at.thermal_e
    return mean_e + strength * wait * lit * at.sensor.integration_s / at.shot.seconds


def dark_current_rts(mean_e: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """In a share `strength` of the pixels the leakage jumps between two levels; other form: drawn afresh in each frame."""
    has = at.once("where", lambda: at.die().random(mean_e.shape) < strength)
    step = at.once("step", lambda: at.die("step").lognormal(3.5, 0.7, mean_e.shape))  # e-/s at 20 C
    state = at.memory.get("state", at.die("start").random(mean_e.shape) < 0.4)
    wakes = at.now("wake").random(mean_e.shape) < (1.0 if at.form == "afresh" else 0.3)
    state = np.where(wakes, at.now("state").random(mean_e.shape) < 0.4, state)
    at.memory["state"] = state
    return mean_e + has * step * state * np.exp(0.075 * (at.shot.celsius - 20)) * at.shot.seconds


# ---- charge and voltage ------------------------------------------------------------------------------------


def saturation_nonuniformity(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Wells that are smaller by an exponential share of mean `strength`; other form: a soft knee so wide."""
    if at.form == "knee":
        knee = max(strength, 1e-9) * at.sensor.well_e
        over = np.clip(x - (at.sensor.well_e - knee), 0, 2 * knee)
        return x - over**2 / (4 * knee) if strength > 0 else x
    lacks = at.once("wells", lambda: at.die().exponential(1.0, x.shape))
    return np.minimum(x, at.sensor.well_e * (1 - np.minimum(strength * lacks, 0.9))) if strength > 0 else x


def column_parity(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Two or four amplifiers take turns, offsets of `strength` e- rms, gains of 0.1 % per e-; other form: odd columns' gain."""
    if at.form == "gain":
        return x * (1 + 1.5e-3 * strength * (np.arange(x.shape[1]) % 2))
    rng = at.die()
    count = int(rng.choice([2, 4]))
    levels = {2: [-1.0, 1.0], 4: [-1.34, -0.45, 0.45, 1.34]}[count]  # evenly spaced, rms 1
    offset, gain = (np.resize(rng.permutation(levels), x.shape[1]) for _ in range(2))
    return x * (1 + 1e-3 * strength * gain) + strength * offset


def read_noise_nonuniformity(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Each pixel has noise of its own, `strength` e- rms over the pixels, of gamma variance; other form: one in twenty pixels."""
    if at.form == "few":
        own = at.once("own", lambda: np.sqrt(20.0) * (at.die().random(x.shape) < 0.05))
    else:
        own = at.once("own", lambda: np.sqrt(at.die().gamma(0.7, 1 / 0.7, x.shape)))
    return x + strength * own * at.now().standard_normal(x.shape)


def line_defects(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A share `strength` of the columns is brighter by 2 to 6 read noises; other form: rows that jump from frame to frame."""
    axis = 0 if at.form == "unstable rows" else 1
    shape = (-1, 1) if axis == 0 else (1, -1)
    has = at.once("where", lambda: at.die().random(x.shape[axis]) < strength).reshape(shape)
    height = at.sensor.read_e * at.die("height").uniform(2, 6, x.shape[axis]).reshape(shape)
    if at.form == "unstable rows":
        height = height * at.now().standard_normal(x.shape[axis]).reshape(shape)
    return x + has * height


def correlated_row_noise(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """1/f noise over the rows, `strength` e- rms; other form: a first-order autoregression of 0.9."""
    rows = x.shape[0]
    if at.form == "autoregression":
        fresh, course = at.now().standard_normal(rows), np.empty(rows)
        course[0] = fresh[0]
        for i in range(1, rows):
            course[i] = 0.9 * course[i - 1] + np.sqrt(1 - 0.9**2) * fresh[i]
    else:
        course = coloured(at.now(), 2 * rows, 1.0)[:rows]
    return x + strength * course[:, None]


def slanted_interference(x: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """A plane wave across rows and columns, `strength` e-, phase new in every frame; other form: a square wave."""
    rng = at.die()
    slant, period = rng.uniform(0.5, 1.0), rng.uniform(7, 15)
    y, x_index = np.ogrid[: x.shape[0], : x.shape[1]]
    wave = np.sin(2 * np.pi * ((y * np.cos(slant) + x_index * np.sin(slant)) / period + at.now().random()))
    return x + strength * (np.sign(wave) * np.pi / 4 if at.form == "square" else wave)


# ---- real DN before the rounding ---------------------------------------------------------------------------


def dual_gain(dn: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Above a tenth of the full well a channel with `strength` e- more noise; other form: its gain is 0.1 % higher per e-."""
    s = at.sensor
    electrons = (dn - s.pedestal_dn) * s.e_per_dn
    if at.form == "gain":
        second = electrons + 1e-3 * strength * (electrons - 0.1 * s.well_e)
    else:
        second = electrons + strength * at.now().standard_normal(dn.shape)
    return np.where(electrons > 0.1 * s.well_e, second / s.e_per_dn + s.pedestal_dn, dn)


def code_widths(dn: np.ndarray, strength: float, at: Moment) -> np.ndarray:
    """Thresholds are off by independent errors, widths by `strength` DN rms; other form: even codes wide, odd codes narrow."""
    codes = 2**at.sensor.bits
    ideal = np.arange(1, codes) - 0.5
    if at.form == "even and odd":
        off = 0.5 * min(strength, 0.98) * np.where(np.arange(1, codes) % 2, 1.0, -1.0)
    else:
        drawn = at.once("thresholds", lambda: at.die().standard_normal(codes - 1))
        off = np.clip(strength / np.sqrt(2) * drawn, -0.49, 0.49)
    return np.searchsorted(ideal + off, dn, side="right").astype(float) if strength > 0 else dn


_S, _E, _T = "signal", "exposure", "temperature"

# fmt: off
KINDS: tuple[Kind, ...] = (
    Kind("lamp_flicker", "light", lamp_flicker, "relative amplitude", 2e-3, 0.5, "rectified", ("row", "time"), (_S,)),
    Kind("fringing", "light", fringing, "fraction", 1e-3, 0.5, None, ("smooth", "row", "column", "pixel"), (_S,)),
    Kind("dust", "light", dust, "fraction", 1e-2, 0.9, None, ("smooth", "pixel"), (_S,)),
    Kind("uneven_light", "light", uneven_light, "fraction", 2e-3, 0.5, "spot", ("smooth", "row", "column"), (_S,)),
    Kind("parasitic_light", "yield", parasitic_light, "share of light in the last row", 3e-3, 0.5, "first",
         ("smooth", "row"), (_S,), (_E,)),
    Kind("dark_current_rts", "yield", dark_current_rts, "share of pixels", 2e-3, 0.3, "afresh", ("time", "pixel"), (_E,),
         (_T,)),
    Kind("saturation_nonuniformity", "charge", saturation_nonuniformity, "share of the full well", 0.06, 0.3, "knee",
         ("pixel", "level"), (_S,)),
    Kind("column_parity", "voltage", column_parity, "e- rms", 0.2, 100, "gain", ("column",), (), (_S,)),
    Kind("read_noise_nonuniformity", "voltage", read_noise_nonuniformity, "e- rms", 0.5, 100, "few", ("pixel", "time")),
    Kind("line_defects", "voltage", line_defects, "share of lines", 0.01, 0.3, "unstable rows", ("column", "row")),
    Kind("correlated_row_noise", "voltage", correlated_row_noise, "e- rms", 0.3, 200, "autoregression", ("row", "time")),
    Kind("slanted_interference", "voltage", slanted_interference, "e-", 0.3, 100, "square", ("time",)),
    Kind("dual_gain", "converter", dual_gain, "e- rms", 5, 500, "gain", ("level", "pixel", "time"), (_S,)),
    Kind("code_widths", "converter", code_widths, "DN rms of a code's width", 0.1, 0.6, "even and odd", ("level",), (),
         (_S,)),
)
# fmt: on
