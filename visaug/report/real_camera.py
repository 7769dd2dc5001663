"""The plain chain beside a real camera: the first step of `compare`, on frames that come with the package."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from visaug.core.errors import InputError
from visaug.report.html import Section, Table, Text, figure

if TYPE_CHECKING:
    from visaug.camera import Camera
    from visaug.frames import FrameSet

FOLDER = Path(__file__).parents[1] / "data" / "ccd12"


@dataclass(frozen=True)
class SensorCurves:
    """What photon transfer, dark histogram and row spectrum show of a frame set.

    Attributes:
        mean_dn, variance_dn2: flats of each level: mean above dark, temporal variance (EMVA 1288, pairs).
        levels_dn, counts: how many dark pixels lie how far from the mean of the dark stack.
        frequency, row_power: spectrum of the dark frames' temporal noise along the row (EMVA 1288's
            horizontal spectrogram), 0 to 0.5 cycles per pixel; 1 for white noise. At 0 stands what a row has
            in common.
        column_dn: column means of the dark stack, less their mean.
        drift_dn: means of the dark stack's frames in order, less their mean.
    """

    mean_dn: np.ndarray
    variance_dn2: np.ndarray
    levels_dn: np.ndarray
    counts: np.ndarray
    frequency: np.ndarray
    row_power: np.ndarray
    column_dn: np.ndarray
    drift_dn: np.ndarray

    @property
    def dark_noise_dn(self) -> float:
        return float(np.sqrt(np.average(self.levels_dn**2, weights=self.counts)))

    @property
    def far(self) -> int:
        """Dark pixels further than four standard deviations from the mean."""
        return int(self.counts[np.abs(self.levels_dn) > 4 * self.dark_noise_dn].sum())

    @property
    def row_noise(self) -> float:
        """Power that the pixels of a row share, over the median power; 1 for independent pixels."""
        return float(self.row_power[0] / np.median(self.row_power))

    @property
    def half_sampling(self) -> float:
        """Power at half the sampling frequency over the median power."""
        return float(self.row_power[-1] / np.median(self.row_power))


def sensor_curves(frames: "FrameSet") -> SensorCurves:
    """Reduce flats, their darks of the same exposure, and the longest stack of darks."""
    groups = frames.groups()
    darks = {g.exposure_s: g for g in groups if g.kind == "dark"}
    means, variances = [], []
    for g in groups:
        if g.kind == "flat" and len(g.indices) == 2 and g.exposure_s in darks:
            bright, dark = frames.read_many(g.indices), frames.read_many(darks[g.exposure_s].indices)
            means.append(float(bright.mean() - dark.mean()))
            variances.append(float(np.var(bright[0] - bright[1], dtype=np.float64) / 2))
    stack = frames.read_many(max(darks.values(), key=lambda g: len(g.indices)).indices).astype(np.float64)
    count, _, columns = stack.shape
    noise = (stack - stack.mean(0)) * np.sqrt(count / (count - 1))
    noise -= noise.mean((1, 2), keepdims=True)
    power = np.mean(np.abs(np.fft.rfft(noise, axis=2)) ** 2, axis=(0, 1)) / columns / noise.var()
    about = np.rint(stack - stack.mean()).astype(int)
    levels = np.arange(about.min(), about.max() + 1)
    return SensorCurves(
        np.array(means),
        np.array(variances),
        levels.astype(float),
        np.bincount((about - about.min()).ravel(), minlength=len(levels)).astype(float),
        np.fft.rfftfreq(columns),
        power,
        stack.mean((0, 1)) - stack.mean(),
        stack.mean((1, 2)) - stack.mean(),
    )


def load_real_camera() -> "tuple[Camera, FrameSet]":
    """The 12-bit CCD's published parameters and its frames, which are in the source tree alone.

    Raises:
        InputError: visaug was installed from a wheel, which has no frames under a share-alike licence.
    """
    from visaug.camera import Camera
    from visaug.frames import FrameSet

    if not FOLDER.is_dir():
        raise InputError(
            "is not in the wheel: its licence is CC BY-SA 3.0",
            file=FOLDER,
            expected="a clone, or the source archive",
        )
    camera = Camera.load(FOLDER / "camera.yaml")
    return camera, FrameSet.load(FOLDER, resolution=camera.resolution, bit_depth=camera.bit_depth)


def real_camera_section(seed: int = 0) -> Section:
    """Measured and modelled in the same axes, and in a sentence where they differ."""
    from visaug.camera.simulation import simulate
    from visaug.report.plots import sensor

    camera, frames = load_real_camera()
    measured = sensor_curves(frames)
    modelled = sensor_curves(simulate(camera, frames, seed=seed))
    intro = (
        "Real frames first: a 12-bit CCD (640 x 480), the EMVA 1288 reference set of Basler AG, 2011 (M. "
        "Grimm; CC BY-SA 3.0, and so are the pictures of this section), cut to 192 x 256 pixels. Beside "
        "them the same frames as the plain chain makes them from the parameters that were published for "
        "this camera, nothing fitted."
    )
    captions = {
        sensor.plot_photon_transfer: "Photon transfer: temporal variance of flats against their mean above dark. The slope is "
        "the gain, the fall at the end is the converter's limit.",
        sensor.plot_dark_histogram: "Dark frames at 5.16 ms: how many pixels lie how far from the mean, on a logarithmic axis that "
        "shows the tails.",
        sensor.plot_row_spectrum: "Spectrum of the dark noise along the row, of noise that changes from frame to frame (EMVA "
        "1288's horizontal spectrogram); independent pixels give 1; frequency 0 is the power that a whole row has in common.",
        sensor.plot_dark_columns: "Column means of the dark stack: the pattern that stays from frame to frame.",
    }
    drawn = [figure(plot(measured, modelled), caption, wide=False) for plot, caption in captions.items()]
    rows = Table(["quantity", "measured", "modelled"], _rows(measured, modelled))
    found = Text(difference(measured, modelled), "finding")
    return Section("A real camera beside its model", [Text(intro), found, *drawn, rows])


def difference(measured: SensorCurves, modelled: SensorCurves) -> str:
    """One sentence: where the model agrees, and where it does not."""
    slope, slope_model = _gain(measured), _gain(modelled)
    agree = f"Photon transfer agrees (gain {slope:.3f} against {slope_model:.3f} DN/e-)"
    if abs(slope / slope_model - 1) > 0.03:
        agree = f"Photon transfer differs (gain {slope:.3f} against {slope_model:.3f} DN/e-)"
    missing = []
    if measured.row_noise > 1.5 * modelled.row_noise:
        missing.append(
            f"the pixels of a row share noise that changes from frame to frame ({measured.row_noise:.1f} times "
            f"the power of independent pixels, against {modelled.row_noise:.1f})"
        )
    if measured.half_sampling > 1.5 * modelled.half_sampling:
        missing.append(
            "neighbouring columns alternate, a line at half the sampling frequency "
            f"({measured.half_sampling:.1f} times the median power, against {modelled.half_sampling:.1f})"
        )
    if measured.far > 2 * modelled.far + 5:
        missing.append(
            f"the dark noise has tails ({measured.far} pixels beyond four deviations, against {modelled.far})"
        )
    columns, columns_model = measured.column_dn.std(), modelled.column_dn.std()
    if columns > 1.1 * columns_model:
        missing.append(f"columns keep an offset ({columns:.3f} against {columns_model:.3f} DN)")
    drift, drift_model = measured.drift_dn.std(), modelled.drift_dn.std()
    if drift > 2 * drift_model:
        missing.append(f"the level drifts from frame to frame ({drift:.3f} against {drift_model:.3f} DN)")
    if not missing:
        return agree + "; nothing else in these pictures distinguishes the two."
    *most, last = missing
    return f"{agree}; what the plain model lacks: {'; '.join(most)}{'; and ' if most else ''}{last}."


def _gain(curves: SensorCurves) -> float:
    """Slope of variance over mean up to 70 % of the mean where the variance is largest, DN/e-."""
    top = 0.7 * curves.mean_dn[np.argmax(curves.variance_dn2)]
    use = curves.mean_dn <= top
    return float(np.polyfit(curves.mean_dn[use], curves.variance_dn2[use], 1)[0])


def _rows(measured: SensorCurves, modelled: SensorCurves) -> list[list[str]]:
    quantities = {
        "slope of photon transfer, DN/e-": _gain,
        "dark noise, DN": lambda c: c.dark_noise_dn,
        "dark pixels beyond four standard deviations": lambda c: c.far,
        "power that a row has in common, 1 for independent pixels": lambda c: c.row_noise,
        "power at half the sampling frequency over the median": lambda c: c.half_sampling,
        "standard deviation of dark columns, DN": lambda c: float(c.column_dn.std()),
        "standard deviation of dark frames' means, DN": lambda c: float(c.drift_dn.std()),
    }
    return [[name, f"{of(measured):.4g}", f"{of(modelled):.4g}"] for name, of in quantities.items()]
