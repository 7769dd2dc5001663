"""The paper's camera in the dark: its sensors, its frames, and what theory says of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy import optimize, stats

from visaug.camera import Camera
from visaug.camera.patterns import FixedPatternLaw, LineLaw, Mixture
from visaug.core.sampling import Stream, derive_key

ROWS, COLUMNS = 1024, 1280
DARK = {"exposure_s": 0.5, "temperature_c": 30.0}  # of Fig. 7, Fig. 8 and Table 1
BIAS = {"exposure_s": 1e-5, "temperature_c": 30.0}
TEMPERATURES_C = (15.0, 19.0, 23.0, 27.0, 30.0)
EXPOSURES_S = (0.001, 0.010, 0.020, 0.500, 0.999)
DARK_FRAMES = 10  # a condition
BATCH = 4

# Fig. 2 tells three bands at about 11, 6 and 1 e-, more of the high ones in columns 0 to 250,
# and a deviation of 2.82 e-. The bands' shares are assumed, such that the deviation comes out; so are the
# trend and the spectra.
TREND = np.array([-0.15, -0.30, 0.45, -0.35])
LEVELS = Mixture(np.array([0.74, 0.21, 0.05]), np.array([1.0, 6.0, 11.0]), np.full(3, 0.33))
SMOOTH = 1 / (0.002 + np.linspace(0, 0.5, 513))  # rows: a profile that wanders, as Fig. 2 tells


def accurate_pattern() -> FixedPatternLaw:
    """The paper's accurate DSNU as far as its text tells it: levels, deviations and a trend."""
    u = (2 * np.arange(COLUMNS) + 1) / COLUMNS - 1
    rest = 1 - np.polynomial.polynomial.polyval(u, TREND).var()
    rows = LineLaw(Mixture(np.ones(1), np.zeros(1), np.array([0.21])), np.zeros(1), SMOOTH / SMOOTH.mean())
    return FixedPatternLaw(LineLaw(LEVELS, TREND, np.full(641, rest)), rows, 1.1)


def paper_camera(dsnu_map: Path | None = None, /, **values: object) -> Camera:
    """The shipped camera, with a measured DSNU map instead of the drawn one, or other values by path."""
    content = Camera.load("flir_cm3_u3_13y3c").to_dict()
    if dsnu_map is not None:
        content["dsnu"] = {"map": str(dsnu_map.resolve())}
    camera = Camera.load(content)
    return camera.replace(values) if values else camera


def frames(
    camera: Camera, count: int, condition: dict[str, float], rows: int = ROWS, sensor: int = 1
) -> Iterator[np.ndarray]:
    """`count` dark frames of one sensor in batches (B, rows, 1280), float32 DN."""
    window = (range(rows), range(COLUMNS))
    for first in range(0, count, BATCH):
        keys = [derive_key(sensor, *condition.values(), i) for i in range(first, min(count, first + BATCH))]
        stream = Stream(keys, [derive_key("sensor", sensor)] * len(keys), 1, window)
        yield camera.expose(torch.zeros(len(keys), 1, rows, COLUMNS), stream, condition)[:, 0].numpy()


def frame(camera: Camera, condition: dict[str, float] = DARK, sensor: int = 1) -> np.ndarray:
    """One whole dark frame, (1024, 1280) DN."""
    return next(frames(camera, 1, condition, sensor=sensor))[0]


def gaussian_deviation_dn(camera: Camera, mean_photons: float = 0.0) -> float:
    """Eq. 6: the deviation of white noise that stands for shot noise, dark current and read noise, DN."""
    v = camera.values()
    heat = np.exp(v["dark_current.b_per_c"] * DARK["temperature_c"])
    dark_e = DARK["exposure_s"] * v["dark_current.a_e_per_s"] * heat
    light_e2 = mean_photons * v["quantum_efficiency"] ** 2
    return float(np.sqrt(light_e2 + dark_e + v["read_noise.sigma_e"] ** 2) / v["gain_e_per_dn"])


def white_gaussian(camera: Camera) -> np.ndarray:
    """Eq. 6 on a black image, (1024, 1280) DN, rounded and clipped."""
    noise = np.random.default_rng(6).normal(0, gaussian_deviation_dn(camera), (ROWS, COLUMNS))
    return np.clip(np.round(noise), 0, 65535)


@dataclass(frozen=True)
class Law:
    """Mean and standard deviation in e- of a dark frame clipped at zero, over pixels and sensors."""

    mean_e: float
    deviation_e: float


def dark_law(accurate: bool, meaning: str, shape: float = -0.23, rounded: bool = False) -> Law:
    """Theory, apart from the chain: densities of read noise and DSNU folded with the Poisson law, cut at 0.

    Args:
        accurate: three levels of columns, else Gaussian ones.
        meaning: of sigma_read = 2.37 e-: "standard_deviation" or "scale" of SciPy's tukeylambda.
        rounded: electrons are rounded before the converter, as in eq. 12.
    """
    step = 0.01
    x = np.arange(-500, 500, step)
    scale = 2.37 if meaning == "scale" else 2.37 / stats.tukeylambda.std(shape)
    edges = np.append(x, x[-1] + step) - step / 2
    read = np.diff(stats.tukeylambda.cdf(edges / scale, shape))
    other = np.hypot(1.1, 0.21)
    if accurate:
        parts = zip(LEVELS.weights, LEVELS.means, np.hypot(LEVELS.deviations, other))
    else:
        parts = [(1.0, 0.0, np.hypot(2.82, other))]
    dsnu = sum(w * np.diff(stats.norm.cdf(edges, m, s)) for w, m, s in parts)
    mean = DARK["exposure_s"] * 0.136 * np.exp(0.14 * DARK["temperature_c"])
    cycles = 2 * np.pi * np.fft.rfftfreq(len(x), step)
    transform = np.fft.rfft(np.fft.ifftshift(read)) * np.fft.rfft(np.fft.ifftshift(dsnu))
    density = np.fft.fftshift(np.fft.irfft(transform * np.exp(mean * (np.exp(-1j * cycles) - 1)), len(x)))
    value = np.maximum(np.round(x) if rounded else x, 0)
    first = density @ value
    return Law(float(first), float(np.sqrt(density @ value**2 - first**2)))


@dataclass(frozen=True)
class Characterised:
    """Section 4.1 carried out on simulated bias frames; electrons."""

    master_e: np.ndarray
    column_e: float
    row_e: float
    pixel_e: float
    read_e: float


def characterise(camera: Camera, count: int = 200, rows: int = 320) -> Characterised:
    """Master bias, its columns, rows and pixels (eq. 14), and the residuals' deviation, as in the paper."""
    gain, black = camera.spec.gain_e_per_dn, camera.spec.black_level_dn
    total, squares = np.zeros((rows, COLUMNS)), np.zeros((rows, COLUMNS))
    for batch in frames(camera, count, BIAS, rows):
        e = (batch.astype(np.float64) - black) * gain
        total += e.sum(0)
        squares += (e**2).sum(0)
    master = total / count
    read = np.sqrt((squares / count - master**2).mean())
    column, row = master.mean(0).std(), master.mean(1).std()
    pixel = np.sqrt(max(master.var() - column**2 - row**2, 0.0))
    return Characterised(master, float(column), float(row), float(pixel), float(read))


@dataclass(frozen=True)
class DarkCurrent:
    """Dark current at TEMPERATURES_C by regression over exposures, and A exp(B T) through it."""

    slopes_e_per_s: np.ndarray
    a_e_per_s: float
    b_per_c: float


def dark_current(camera: Camera, rows: int = 128) -> DarkCurrent:
    """Section 4.1.3: ten frames a condition, least and largest mean dropped, a line, an exponential."""
    gain = camera.spec.gain_e_per_dn
    slopes = []
    for temperature in TEMPERATURES_C:
        means = []
        for exposure in EXPOSURES_S:
            condition = {"exposure_s": exposure, "temperature_c": temperature}
            levels = np.concatenate(
                [b.astype(np.float64).mean((1, 2)) for b in frames(camera, DARK_FRAMES, condition, rows)]
            )
            means.append(np.sort(levels)[1:-1].mean() * gain)
        slopes.append(np.polyfit(EXPOSURES_S, means, 1)[0])
    (a, b), _ = optimize.curve_fit(lambda t, a, b: a * np.exp(b * t), TEMPERATURES_C, slopes, p0=(0.1, 0.1))  # pyrefly: ignore[bad-unpacking]
    return DarkCurrent(np.array(slopes), float(a), float(b))
