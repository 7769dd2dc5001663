"""Effects in the light: the lamp and the lens. All act on expected photons."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import affine_transform, gaussian_filter
from scipy.signal import fftconvolve

from .effect import Effect, Moment
from .randomness import grid, radius, wander


def spread(light: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Convolve with a kernel scaled to sum one; light goes on beyond the frame as in a mirror."""
    reach = kernel.shape[0] // 2
    return fftconvolve(np.pad(light, reach, mode="symmetric"), kernel / kernel.sum(), mode="valid")


def disc(size: float, reach: int) -> np.ndarray:
    """A disc of radius `size` pixels with a soft edge."""
    return np.clip(size + 0.5 - radius(reach), 0, 1)


class LightDrift(Effect):
    """The lamp wavers: a factor 1 + Ornstein-Uhlenbeck of the frame number, on flats and scenes alike.

    sigma: relative standard deviation; tau_frames: memory in frames.
    """

    def prepare(self) -> None:
        self.lamp = self.numbers["sigma"] * wander(self.rng, self.frames, self.numbers["tau_frames"])

    def light(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x * (1 + self.lamp[at.index])


class PointSpread(Effect):
    """The lens blurs: a Moffat profile of exponent 3, or defocus, a disc with a little diffraction (texts on optics).

    size_px: the Moffat radius, or 0.8 of the disc's, in pixels; law: moffat or defocus.
    """

    def prepare(self) -> None:
        size, reach = self.numbers["size_px"], 8
        if self.numbers["law"] == "moffat":
            self.kernel = (1 + (radius(reach) / size) ** 2) ** -3.0
        else:
            self.kernel = gaussian_filter(disc(1.25 * size, reach), 0.45)

    def light(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return spread(x, self.kernel)


class VeilingGlare(Effect):
    """Light scattered in the lens lies over the image as a wide halo (the idea of ISO 9358).

    share: fraction of the light; scale_px: radius in pixels; law: exponential, or lorentz, (1 + r^2)^-1.5.
    """

    def prepare(self) -> None:
        r = radius(min(self.camera.shape) - 1) / self.numbers["scale_px"]
        self.kernel = np.exp(-r) if self.numbers["law"] == "exponential" else (1 + r**2) ** -1.5

    def light(self, x: np.ndarray, at: Moment) -> np.ndarray:
        share = self.numbers["share"]
        return (1 - share) * x + share * spread(x, self.kernel)


class LensFlare(Effect):
    """Reflections between surfaces: defocused ghosts of the whole image, and a halo (ghost analysis of lens design).

    ghosts: of each the share of the light, the magnification m about the centre (turned over where negative) and the
    radius of its blur in pixels; halo_share, halo_px: share and e-folding radius of an exponential halo.
    """

    def prepare(self) -> None:
        self.halo = np.exp(-radius(60) / self.numbers["halo_px"])

    def ghosts(self, light: np.ndarray) -> np.ndarray:
        """The sum of the ghosts."""
        centre = (np.array(light.shape) - 1) / 2
        total = np.zeros(light.shape)
        for ghost in self.numbers["ghosts"]:
            m, size = ghost["m"], ghost["radius"]
            image = affine_transform(
                light, np.eye(2) / m, offset=centre - centre / m, order=1, mode="nearest"
            )
            total = total + ghost["share"] / m**2 * spread(image, disc(size, int(np.ceil(size)) + 1))
        return total

    def light(self, x: np.ndarray, at: Moment) -> np.ndarray:
        share = self.numbers["halo_share"]
        return (1 - share) * x + share * spread(x, self.halo) + self.ghosts(x)


class Vignetting(Effect):
    """The image darkens away from the axis: cos^4 of the field angle, or a polynomial in r^2 and r^4 (texts on optics).

    corner_loss: fraction lost in the corner of a centred lens; law: cos4 or poly; centre: the axis' place off the middle
    in fractions of the height and the width.
    """

    def prepare(self) -> None:
        (rows, columns), (down, along) = self.camera.shape, self.numbers["centre"]
        y, x = grid(self.camera.shape)
        cy, cx = (rows - 1) / 2, (columns - 1) / 2
        r2 = ((y - cy - down * rows) ** 2 + (x - cx - along * columns) ** 2) / (cy**2 + cx**2)
        loss = self.numbers["corner_loss"]
        if self.numbers["law"] == "cos4":
            self.map = 1 / (1 + r2 * ((1 - loss) ** -0.5 - 1)) ** 2  # cos^4 = 1 / (1 + tan^2)^2
        else:
            self.map = 1 - loss * (0.6 * r2 + 0.4 * r2**2)

    def light(self, x: np.ndarray, at: Moment) -> np.ndarray:
        return x * self.map
