"""The noise curve of developed pictures: shot and read noise under a tone curve, cut at both ends and rounded.

A. Foi et al., IEEE Trans. Image Processing 17 (2008) 1737: variance a + b x of a raw picture, clipped. Here the value passes
through a tone curve before it is rounded, and mean and variance of the code are exact sums over the codes, so strong curves
near black and noise below one step are covered as well.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, special

_LEVELS = 255 * np.linspace(0, 1, 140) ** 2
TONES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "linear": lambda y: y,
    "srgb": lambda y: np.where(y <= 0.04045, y / 12.92, ((np.maximum(y, 0) + 0.055) / 1.055) ** 2.4),
    "gamma 2.2": lambda y: np.maximum(y, 0) ** 2.2,
}


@dataclass(frozen=True)
class VarianceLaw:
    """Variance `read` + `shot` x + (`prnu` x)^2 about `black` + x, x the light in 1/255 of the linear full scale."""

    tone: str
    shot: float
    read: float
    black: float = 0.0
    prnu: float = 0.0
    codes: int = 255

    def developed(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and variance of the picture's value, in 1/255, at each of `_LEVELS` of light."""
        codes = min(self.codes, 1023)  # finer ones differ by the variance of rounding alone
        step = 255 / codes
        k = np.arange(1, codes + 1)
        threshold = 255 * TONES[self.tone]((k - 0.5) / codes)
        sigma = np.sqrt(self.read + self.shot * _LEVELS + (self.prnu * _LEVELS) ** 2)
        above = special.ndtr((self.black + _LEVELS[:, None] - threshold) / sigma[:, None])
        mean = above.sum(1)
        variance = ((above * (2 * k - 1)).sum(1) - mean**2) * step**2
        if self.codes > codes:  # rounding adds a twelfth of a step squared to noise of half a step or more
            true_step = 255 / self.codes
            variance = np.maximum(variance - (step**2 - true_step**2) / 12, true_step**2 / 12)
        return mean * step, variance

    def variance_at(self, level: np.ndarray) -> np.ndarray:
        mean, variance = self.developed()
        return np.exp(np.interp(level, mean, np.log(np.maximum(variance, 1e-6))))

    def light_at(self, level: np.ndarray) -> np.ndarray:
        """Light in 1/255 of full scale where the mean value is `level`; 0 at black and below."""
        return np.interp(level, self.developed()[0], _LEVELS)

    def slope_at(self, level: np.ndarray) -> np.ndarray:
        """Derivative of the mean value with respect to the light; at black, to the offset."""
        mean, _ = self.developed()
        moved, _ = replace(self, black=self.black + 0.5).developed()
        return np.interp(level, mean, (moved - mean) / 0.5)


@dataclass(frozen=True)
class Sky:
    """Level of the black sky, its standard error, and the standard deviation of the levels of its blocks."""

    level: float
    error: float
    spread: float = 0.0

    @property
    def reach(self) -> float:
        """How far from its level, in DN, a block may lie and be sky."""
        return max(2.0, 3 * self.spread)


def fit(
    tone: str,
    level: np.ndarray,
    variance: np.ndarray,
    error: np.ndarray,
    sky: Sky | None,
    start: VarianceLaw,
    free_response: bool = False,
) -> tuple[VarianceLaw, float]:
    """The law under a tone curve that fits the noise curve best, and its chi-square.
    With a sky the black level is fitted, else it is the start's; the response of pixels only if it is free. Levels whose noise
    lies above the law count less (soft L1): structure that passed for noise is always too much.
    """
    good = np.isfinite(variance)
    level, variance, error = level[good], np.log(variance[good]), error[good]

    def law(x: np.ndarray) -> VarianceLaw:
        black = x[2] if sky else start.black
        prnu = math.exp(x[-1]) if free_response else start.prnu
        return replace(start, tone=tone, shot=math.exp(x[0]), read=math.exp(x[1]), black=black, prnu=prnu)

    def residual(x: np.ndarray) -> np.ndarray:
        mean, modelled = law(x).developed()
        r = (variance - np.interp(level, mean, np.log(np.maximum(modelled, 1e-6)))) / error
        r = np.sign(r) * np.sqrt(8 * (np.sqrt(1 + r**2 / 4) - 1))
        return np.append(r, (mean[0] - sky.level) / sky.error) if sky else r

    black = max(start.black, -20)
    parts = [(math.log(start.shot), -9.0, 4.0, 0.3), (math.log(start.read), -9.0, 8.0, 0.3)]
    parts += [(black, -60.0, 200.0, 1.0)] if sky else []
    parts += [(math.log(max(start.prnu, 0.01)), math.log(1e-4), 0.0, 0.3)] if free_response else []
    x0, low, high, scale = np.array(parts).T
    x0 = np.clip(x0, low + 1e-3, high - 1e-3)
    found = optimize.least_squares(residual, x0, bounds=(low, high), x_scale=scale, max_nfev=40)
    return law(found.x), float(2 * found.cost)
