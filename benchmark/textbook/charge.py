"""Effects that make charge: on expected electrons, on the dark current, and tracks of particles."""

from __future__ import annotations

import numpy as np

from .effect import Effect, Moment
from .randomness import grid, poisson


class Smear(Effect):
    """While a frame is shifted through the image every pixel sees its whole column (frame-transfer CCDs).

    transfer_over_exposure: time of the shift over that of the exposure; each pixel gets that share of its column's mean.
    """

    def photo(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x + self.numbers["transfer_over_exposure"] * x.mean(0, keepdims=True)


class DarkCurrentNonuniformity(Effect):
    """Pixels differ in dark current by a log-normal factor of mean one (Janesick; EMVA 1288, DSNU over time).

    sigma_ln: standard deviation of the factor's logarithm.
    """

    def prepare(self) -> None:
        sigma = self.numbers["sigma_ln"]
        self.factor = np.exp(self.rng.normal(size=self.camera.shape) * sigma - sigma**2 / 2)

    def dark(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x * self.factor


class HotPixels(Effect):
    """Some pixels leak far more, and less steeply with temperature, as traps near midgap do (Widenhorn 2002).

    fraction: share of the pixels; median_e_per_s, sigma_ln: log-normal rate at the camera's nominal temperature; b_ratio:
    mean of the exponent over that of the dark current, with a scatter of 0.08.
    """

    def prepare(self) -> None:
        p, rng = self.numbers, self.rng
        self.hot = rng.random(self.camera.shape) < p["fraction"]
        count = self.hot.sum()
        self.rate = p["median_e_per_s"] * np.exp(p["sigma_ln"] * rng.normal(size=count))
        self.per_c = self.camera.dark_per_c * np.clip(p["b_ratio"] + 0.08 * rng.normal(size=count), 0.3, 1)

    def dark(self, x: np.ndarray, at: Moment) -> np.ndarray:
        x = x.copy()
        x[self.hot] += self.rate * np.exp(self.per_c * (at.shot.celsius - self.camera.celsius))
        return x


class AmplifierGlow(Effect):
    """The output amplifier shines, whatever the temperature: from a corner, or from a part of an edge (Janesick).

    peak_e_per_s: at the place itself; where: tl, tr, bl, br, left, right or top; length_px: e-folding distance in pixels;
    pos: place along an edge as a fraction of it, about which the glow falls as a Lorentzian.
    """

    def prepare(self) -> None:
        where, length = self.numbers["where"], self.numbers["length_px"]
        rows, columns = self.camera.shape
        y, x = grid(self.camera.shape)
        if len(where) == 2:
            distance = np.hypot(y - (0 if where[0] == "t" else rows), x - (0 if where[1] == "l" else columns))
            glow = np.exp(-distance / length)
        else:
            distance = {"left": x, "right": columns - 1 - x, "top": y}[where]
            along = x / columns if where == "top" else y / rows
            glow = np.exp(-distance / length) / (1 + ((along - self.numbers["pos"]) / 0.3) ** 2)
        self.glow = glow * self.numbers["peak_e_per_s"]

    def dark(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x + self.glow


class ClockInducedCharge(Effect):
    """Clocking makes electrons by impact ionisation, Poisson and alike everywhere (Janesick).

    mean_e: electrons per pixel and frame.
    """

    def expected(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x + self.numbers["mean_e"]


class CosmicRays(Effect):
    """Muons leave straight tracks, 80 e- per um with a Moyal fluctuation, wider where they run deep (McLean; Groom).

    per_second: tracks a second over the frame; readout_s: seconds of readout, in which they arrive too.
    """

    def collected(self, x: np.ndarray, at: Moment) -> np.ndarray:
        count = self.rng.poisson(self.numbers["per_second"] * (at.shot.seconds + self.numbers["readout_s"]))
        for _ in range(count):
            x = x + poisson(self.rng, self.track())
        return x

    def zenith(self) -> float:
        """Zenith angle of a ray on a horizontal sensor: intensity cos^2, projected area cos, solid angle sin."""
        while True:
            theta = self.rng.uniform(0, np.pi / 2)
            if self.rng.random() < np.cos(theta) ** 3 * np.sin(theta) / 0.325:
                return theta

    def track(self) -> np.ndarray:
        """Expected electrons of one track; each of its steps is a cloud of forty parts that diffusion has spread."""
        rng, pitch, depth = self.rng, self.camera.pitch_um, self.camera.depth_um
        length_px = min(depth * np.tan(self.zenith()), 60 * pitch) / pitch
        path_um = np.hypot(length_px * pitch, depth)
        azimuth = rng.uniform(0, 2 * np.pi)
        steps, parts = max(8, int(8 * length_px)), 40
        way = (np.arange(steps) + 0.5) / steps  # share of the depth
        rows, columns = self.camera.shape
        y, x = rng.uniform(0, rows), rng.uniform(0, columns)

        moyal = -np.log(rng.chisquare(1, steps)) - 1.27  # less its mean
        step_e = path_um / steps * 80 * np.maximum(0.2, 1 + 0.25 * moyal * (steps / 8) ** 0.25)
        width_px, cloud = np.repeat(0.08 + 0.35 * np.sqrt(way), parts), steps * parts
        down = np.repeat(y + way * length_px * np.sin(azimuth), parts) + width_px * rng.normal(size=cloud)
        along = np.repeat(x + way * length_px * np.cos(azimuth), parts) + width_px * rng.normal(size=cloud)
        weights = np.repeat(step_e / parts, parts)
        borders = [[0, rows], [0, columns]]
        return np.histogram2d(down, along, bins=self.camera.shape, range=borders, weights=weights)[0]
