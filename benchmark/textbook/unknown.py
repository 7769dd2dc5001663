"""Effects that no catalogue has. Their names begin with own_."""

from __future__ import annotations

import numpy as np

from .effect import Effect, Moment
from .randomness import grid
from .readout import TURN


class Dust(Effect):
    """Specks on the window cast defocused shadows, rings where the lens has a central obstruction.

    n: how many, of 5 to 12 pixels radius; depth: fraction of the light that one takes, each 0.6 to 1.2 of it.
    """

    def prepare(self) -> None:
        y, x = grid(self.camera.shape)
        rows, columns = self.camera.shape
        self.shade = np.ones(self.camera.shape)
        for _ in range(self.numbers["n"]):
            r = np.hypot(y - self.rng.uniform(0, rows), x - self.rng.uniform(0, columns))
            size = self.rng.uniform(5, 12)
            depth = self.numbers["depth"] * self.rng.uniform(0.6, 1.2)
            outer, inner = 1 / (1 + np.exp((r - size) / 0.8)), 0.8 / (1 + np.exp((r - 0.4 * size) / 0.8))
            self.shade *= 1 - depth * (outer - inner)

    def light(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x * self.shade


class MovingFringes(Effect):
    """Interference in a thin plate: slightly bent stripes in the light, which move on with every frame that is lit.

    contrast: relative amplitude; period_px: in pixels; angle: of the stripes' normal, in radians; bend: how many periods
    a stripe is bent at half a width from the middle line; drift_rad_per_frame: mean step of the phase, each 0.6 to 1.4 of it.
    """

    def prepare(self) -> None:
        y, x = grid(self.camera.shape)
        cos, sin = np.cos(self.numbers["angle"]), np.sin(self.numbers["angle"])
        across = (x * cos + y * sin) / self.numbers["period_px"]
        along = (y * cos - x * sin) / self.camera.columns
        self.periods = across + self.numbers["bend"] * 4 * along * along
        self.phase = self.rng.uniform(0, 6.28)

    def light(self, x: np.ndarray, at: Moment) -> np.ndarray:
        self.phase += self.numbers["drift_rad_per_frame"] * self.rng.uniform(0.6, 1.4)
        return x * (1 + self.numbers["contrast"] * np.sin(2 * np.pi * self.periods + self.phase))


class VideoEcho(Effect):
    """A share of the signal comes again later in its row, of either sign: a reflection on the video line.

    share: of the signal; delay_px: in pixels.
    """

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        late = self.numbers["delay_px"]
        x = x.copy()
        x[:, late:] += self.numbers["share"] * at.charge_e[:, :-late]
        return x


class RowDroop(Effect):
    """Bright rows draw the supply down, which recovers over the rows that follow.

    k: fall of the base line over the mean signal of the rows; recover_rows: e-folding time in rows.
    """

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        keeps, level = np.exp(-1 / self.numbers["recover_rows"]), 0.0
        x = x.copy()
        for r in range(x.shape[0]):
            level = level * keeps + (1 - keeps) * at.charge_e[r].mean()
            x[r] -= self.numbers["k"] * level
        return x


class PickupStripes(Effect):
    """A damped sine along the stream of pixels, phase new in every frame: slanted stripes, from a motor or a supply nearby.

    amplitude_e: in electrons; period_px: in pixels of the stream; damping_frames: e-folding time in frames;
    blanking_px: the pause after each row in pixels.
    """

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        p, (rows, columns) = self.numbers, x.shape
        line = columns + p["blanking_px"]
        time = (np.arange(rows)[:, None] * line + np.arange(columns)).astype(float)
        fades = p["amplitude_e"] * np.exp(-time / (rows * line) / p["damping_frames"])
        return x + fades * np.sin(2 * np.pi * time / p["period_px"] + self.rng.uniform(0, TURN))


class AdcStep(Effect):
    """From a major transition of the converter on every code is shifted: an integral nonlinearity.

    code: the first that is; step_dn: by how much, in DN.
    """

    def converter(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return np.where(x >= self.numbers["code"], x + self.numbers["step_dn"], x)
