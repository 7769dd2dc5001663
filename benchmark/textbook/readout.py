"""Effects between the wells and the converter: pixels, offsets of lines and frames, amplifiers."""

from __future__ import annotations

import numpy as np

from .effect import Effect, Moment
from .randomness import grid, wander

TURN = 6.2832  # radians; phases are drawn from 0 to here


class Nonlinearity(Effect):
    """The response sags: Q (1 - k (Q / full well)^power) (EMVA 1288, linearity).

    loss_at_full_well: k; power: its exponent.
    """

    def well(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x * (1 - self.numbers["loss_at_full_well"] * (x / self.camera.well_e) ** self.numbers["power"])


class DeadPixels(Effect):
    """Some pixels rest at empty, at full or between; offset and read noise stay theirs (EMVA 1288, defect pixels).

    fraction: share of the pixels; share_low, share_high: of these, the parts that are empty and full.
    """

    def prepare(self) -> None:
        p, rng, well = self.numbers, self.rng, self.camera.well_e
        self.dead = rng.random(self.camera.shape) < p["fraction"]
        count = self.dead.sum()
        kind = rng.random(count)
        between = well * rng.uniform(0.05, 0.8, count)
        self.rest_e = np.where(kind < p["share_low"], 0, np.where(kind > 1 - p["share_high"], well, between))

    def well(self, x: np.ndarray, at: Moment) -> np.ndarray:
        x = x.copy()
        x[self.dead] = self.rest_e
        return x


class RtsNoise(Effect):
    """A trap by the transistor of some pixels is empty or full, which adds a step: random telegraph signal (Janesick).

    A Markov chain of two states for each pixel, from frame to frame, with 0.1 to 0.7 as its chances of change. fraction: share
    of the pixels; amp_min_e, amp_exp_e: the step in electrons, the least and the mean of what comes on top, exponential.
    """

    def prepare(self) -> None:
        rng = self.rng
        self.where = rng.random(self.camera.shape) < self.numbers["fraction"]
        count = self.where.sum()
        self.step_e = self.numbers["amp_min_e"] + rng.exponential(self.numbers["amp_exp_e"], count)
        self.rises, self.falls = rng.uniform(0.1, 0.7, (2, count))
        self.high = rng.random(count) < self.rises / (self.rises + self.falls)

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        stays = self.rng.random(self.high.size) > self.falls
        rises = self.rng.random(self.high.size) < self.rises
        self.high = np.where(self.high, stays, rises)
        x = x.copy()
        x[self.where] += self.step_e * self.high
        return x


class FixedPatternStructure(Effect):
    """Offsets that vary in order along rows or columns, the same in every frame: steps, a slope with a bow, a sine.

    kinds: which of bands, slope and period; axis: column or row, whose number it follows; bands: place as a fraction and
    height in electrons of each step; slope_e: slope and bow in electrons from the middle to the edge; period_px, amplitude_e,
    phase: the sine, in pixels, electrons and radians.
    """

    def prepare(self) -> None:
        p, (rows, columns) = self.numbers, self.camera.shape
        y, x = grid(self.camera.shape)
        number, share = (x, x / columns) if p["axis"] == "column" else (y, y / rows)
        self.offset_e = np.zeros(self.camera.shape)
        for place, height in p.get("bands", []):
            self.offset_e += height / (1 + np.exp(-(share - place) * 150))  # about a pixel wide
        if "slope" in p["kinds"]:
            self.offset_e += p["slope_e"][0] * (share - 0.5) * 2 + p["slope_e"][1] * (share - 0.5) ** 2 * 4
        if "period" in p["kinds"]:
            self.offset_e += p["amplitude_e"] * np.sin(2 * np.pi * number / p["period_px"] + p["phase"])

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x + self.offset_e


class RowNoise(Effect):
    """An offset of each row, Gaussian and new in every frame (EMVA 1288, release 4).

    sigma_e: standard deviation in electrons.
    """

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x + self.numbers["sigma_e"] * self.rng.normal(size=(x.shape[0], 1))


class ColumnNoise(Effect):
    """An offset of each column, Gaussian and new in every frame (EMVA 1288, release 4).

    sigma_e: standard deviation in electrons.
    """

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x + self.numbers["sigma_e"] * self.rng.normal(size=(1, x.shape[1]))


class FlickerNoise(Effect):
    """1/f noise of the amplifier along the stream of pixels, pauses between rows included (Janesick).

    sigma_e: standard deviation in electrons, of a record two frames long; exponent: of 1/f in power; blanking_px: the
    pause after each row in pixels.
    """

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        rows, columns = x.shape
        line = columns + self.numbers["blanking_px"]
        length = 2 * rows * line
        frequency = np.fft.rfftfreq(length)
        amplitude = np.zeros(frequency.size)
        amplitude[1:] = frequency[1:] ** (-self.numbers["exponent"] / 2)
        waves = self.rng.normal(size=frequency.size) + 1j * self.rng.normal(size=frequency.size)
        stream = np.fft.irfft(amplitude * waves, length)
        stream *= self.numbers["sigma_e"] / np.sqrt((amplitude**2).sum() * 4) * length
        return x + stream[: rows * line].reshape(rows, line)[:, :columns]


class PeriodicBanding(Effect):
    """A sine of the row number whose phase is new in every frame: mains, or a beat of clocks.

    amplitude_e: in electrons; period_rows: in rows.
    """

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        phase = 2 * np.pi * np.arange(x.shape[0]) / self.numbers["period_rows"] + self.rng.uniform(0, TURN)
        return x + self.numbers["amplitude_e"] * np.sin(phase)[:, None]


class RowParity(Effect):
    """Even and odd rows are read by two circuits, which differ a little.

    offset_e, gain: what odd rows have more than even ones, in electrons and relative.
    """

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        parity = (np.arange(x.shape[0]) % 2 - 0.5)[:, None]
        return x * (1 + self.numbers["gain"] * parity) + self.numbers["offset_e"] * parity


class BlackLevelDrift(Effect):
    """The offset of whole frames wanders: Ornstein-Uhlenbeck of the frame number, at times after a warm-up.

    sigma_e: standard deviation in electrons; tau_frames: memory in frames; warm_up: height of the decay over the first
    dozen frames, in sigma_e.
    """

    def prepare(self) -> None:
        p, number = self.numbers, np.arange(self.frames)
        drift = wander(self.rng, self.frames, p["tau_frames"])
        self.black_e = p["sigma_e"] * (drift + p["warm_up"] * np.exp(-number / 12.0))

    def voltage(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x + self.black_e[at.index]


class TapMismatch(Effect):
    """One half is read by an amplifier of its own. Its gain acts on all that the pixels give, not on the pedestal.

    axis: left/right or top/bottom; gain: relative, of the second half; offset_dn: in DN.
    """

    def amplified(self, x: np.ndarray, at: Moment) -> np.ndarray:
        row, column = np.ogrid[: x.shape[0], : x.shape[1]]
        across = self.numbers["axis"] == "left/right"
        second = column >= x.shape[1] // 2 if across else row >= x.shape[0] // 2
        return np.where(second, x * (1 + self.numbers["gain"]) + self.numbers["offset_dn"], x)
