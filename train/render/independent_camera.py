"""The cameras of the test domains, in plain NumPy, sharing no code with the noise that is under test.

A network trained with the package's sensor noise is judged on frames of these cameras. Would they come from
the same code, the test would only show that training and test noise are alike. So this file imports nothing
but NumPy (a test holds it), and its numbers are chosen outside what the shipped training cameras'
randomisation reaches.
"""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class IndependentCamera:
    """A 12-bit camera: photons in, DN out. A level of 0 turns an effect off; the fixed pattern hangs on `serial`.

    Beyond a base chain (quantum efficiency, shot noise, read noise with heavy tails, pixel and column patterns) it has

    - row_noise_e: an offset of each row, new in every frame;
    - row_banding_e: the amplitude of a sine along the rows, whose phase changes from frame to frame;
    - tap_gain, tap_offset_e: the right half is read with this much more gain and offset;
    - bloom_share: of the charge above full well, that spills into the neighbours of the column;
    - flare_share: of the light of bright spots, that comes again as a halo and as ghosts;
    - bend: response e (1 - bend e / full well), the share of signal missing at full well.

    `heavy_tails`: the read noise has them, else it is normal. `keeps_black`: the 8-bit pictures keep the black level, so
    that noise around black is not cut.
    """

    serial: int = 1
    quantum_efficiency: float = 0.55
    full_well_e: float = 2000.0
    e_per_dn: float = 0.5
    black_level_dn: float = 64.0
    read_noise_e: float = 3.0
    pixel_offset_e: float = 1.0
    column_offset_e: float = 1.0
    pixel_gain: float = 0.01
    row_noise_e: float = 0.0
    row_banding_e: float = 0.0
    row_banding_period: float = 19.0
    tap_gain: float = 0.0
    tap_offset_e: float = 0.0
    bloom_share: float = 0.0
    flare_share: float = 0.0
    bend: float = 0.0
    heavy_tails: bool = True
    keeps_black: bool = False

    def expose(self, photons: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Photons per pixel (rows, columns) -> DN of 12 bit, uint16."""
        light = _flare(photons, self.flare_share, self.full_well_e / self.quantum_efficiency)
        pattern = np.random.default_rng(self.serial)
        rows, columns = light.shape
        gains = 1 + self.pixel_gain * pattern.standard_normal(light.shape)
        offsets = self.pixel_offset_e * pattern.standard_normal(light.shape)
        offsets = offsets + self.column_offset_e * pattern.standard_normal(columns)
        charge = rng.poisson(np.clip(self.quantum_efficiency * light * gains, 0, 1e12)).astype(float)
        charge = _bloom(charge, self.full_well_e, self.bloom_share)
        signal = charge * (1 - self.bend * charge / self.full_well_e) + offsets
        if self.heavy_tails:  # Student's t with 4 degrees of freedom has a variance of 2
            signal = signal + self.read_noise_e / np.sqrt(2) * rng.standard_t(4, light.shape)
        else:
            signal = signal + self.read_noise_e * rng.standard_normal(light.shape)
        sine = np.sin(2 * np.pi * np.arange(rows) / self.row_banding_period + rng.uniform(0, 2 * np.pi))
        signal = signal + self.row_banding_e * sine[:, None]
        if self.row_noise_e:
            signal = signal + self.row_noise_e * rng.standard_normal((rows, 1))
        right = np.arange(columns) >= columns // 2
        signal = signal * np.where(right, 1 + self.tap_gain, 1) + np.where(right, self.tap_offset_e, 0)
        return np.clip(np.rint(signal / self.e_per_dn + self.black_level_dn), 0, 4095).astype(np.uint16)

    def to_8bit(self, dn: np.ndarray) -> np.ndarray:
        """The 8-bit gray image that is published: full well (or the converter's end) is 255, black is 0 or, where the
        camera keeps it, the black level.
        """
        black = 0.0 if self.keeps_black else self.black_level_dn
        return np.clip(np.rint((dn.astype(float) - black) / self.white_dn * 255), 0, 255).astype(np.uint8)

    @property
    def saturation_e(self) -> float:
        """The charge that is 255 of the 8-bit image: the full well, or the converter's end."""
        return min(self.full_well_e, (4095 - self.black_level_dn) * self.e_per_dn)

    @property
    def white_dn(self) -> float:
        """DN of the 12-bit converter between 0 and 255 of the 8-bit image."""
        top = min(self.full_well_e * (1 - self.bend) / self.e_per_dn, 4095 - self.black_level_dn)
        return top + (self.black_level_dn if self.keeps_black else 0.0)

    def without_effects(self) -> "IndependentCamera":
        levels = ("row_noise_e", "row_banding_e", "tap_gain", "tap_offset_e")
        levels += ("bloom_share", "flare_share", "bend")
        return replace(self, **dict.fromkeys(levels, 0.0))


# Low light: few electrons at high gain, so read noise and patterns are large against the signal.
_LOW_LIGHT = IndependentCamera(
    serial=11, full_well_e=900.0, e_per_dn=0.25, read_noise_e=14.0, pixel_offset_e=6.0, column_offset_e=9.0
)
LIGHTBOX_CAMERA = replace(_LOW_LIGHT, row_banding_e=18.0, tap_gain=0.12, tap_offset_e=22.0)
# Hard light on a sensor with a small well: saturation and its consequences.
_SMALL_WELL = IndependentCamera(
    serial=12, full_well_e=1400.0, e_per_dn=0.4, read_noise_e=16.0, pixel_offset_e=5.0, column_offset_e=8.0
)
SUNLAMP_CAMERA = replace(_SMALL_WELL, bloom_share=0.85, flare_share=0.12)
# Cameras that pictures alone can tell of: black is above 0, the converter ends before the well is full, and every row and
# column has an offset.
_LIFTED_BLACK = IndependentCamera(black_level_dn=320.0, keeps_black=True, heavy_tails=False)
_DIM = replace(_LIFTED_BLACK, serial=13, full_well_e=1500.0, e_per_dn=0.04)
_BRIGHT = replace(_LIFTED_BLACK, serial=14, full_well_e=2500.0, e_per_dn=0.06)
LIGHTBOX_LINES_CAMERA = replace(_DIM, read_noise_e=4.0, column_offset_e=2.4, row_noise_e=2.4)
SUNLAMP_LINES_CAMERA = replace(_BRIGHT, read_noise_e=6.0, column_offset_e=4.0, row_noise_e=4.0)


def _bloom(charge: np.ndarray, full_well_e: float, share: float) -> np.ndarray:
    """Half of the excess goes up the column, half down; `share` of it survives each step; the rest is drained."""
    if share <= 0:
        return np.minimum(charge, full_well_e)
    excess = np.maximum(charge - full_well_e, 0)
    kept = np.minimum(charge, full_well_e)
    for order in (range(len(charge)), range(len(charge) - 1, -1, -1)):
        carried = np.zeros(charge.shape[1])
        for row in order:
            total = kept[row] + carried
            kept[row] = np.minimum(total, full_well_e)
            carried = (total - kept[row] + 0.5 * excess[row]) * share
    return kept


def _flare(photons: np.ndarray, share: float, bright: float) -> np.ndarray:
    """A halo around pixels brighter than half the well, and two ghosts mirrored at the image's centre."""
    if share <= 0:
        return photons
    source = np.maximum(photons - 0.5 * bright, 0)
    halo = 0.5 * _blurred(source, photons.shape[1] / 12)
    first = 0.3 * _blurred(_ghost(source, -0.7), photons.shape[1] / 60)
    second = 0.2 * _blurred(_ghost(source, -1.3), photons.shape[1] / 30)
    return photons + share * (halo + first + second)


def _blurred(image: np.ndarray, sigma: float) -> np.ndarray:
    """A Gaussian blur by the Fourier transform, over a border wide enough that nothing wraps around."""
    border = int(4 * sigma) + 1
    padded = np.pad(image, border)
    y, x = np.fft.fftfreq(padded.shape[0])[:, None], np.fft.rfftfreq(padded.shape[1])[None, :]
    kernel = np.exp(-2 * np.pi**2 * sigma**2 * (x**2 + y**2))
    blurred = np.fft.irfft2(np.fft.rfft2(padded) * kernel, s=padded.shape)
    return np.maximum(blurred[border:-border, border:-border], 0)


def _ghost(source: np.ndarray, magnification: float) -> np.ndarray:
    """The image scaled about its centre by `magnification`, upside down where negative; light is conserved."""
    rows, columns = source.shape
    y = np.rint((np.arange(rows) - (rows - 1) / 2) / magnification + (rows - 1) / 2).astype(int)
    x = np.rint((np.arange(columns) - (columns - 1) / 2) / magnification + (columns - 1) / 2).astype(int)
    inside = ((y >= 0) & (y < rows))[:, None] & ((x >= 0) & (x < columns))[None, :]
    scaled = source[np.clip(y, 0, rows - 1)[:, None], np.clip(x, 0, columns - 1)[None, :]]
    return np.where(inside, scaled, 0) / magnification**2
