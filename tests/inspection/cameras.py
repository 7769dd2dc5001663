"""Eight cameras in NumPy alone, each with one or two patterns of known size, and clean ones."""

from dataclasses import dataclass

import numpy as np

SHAPE = (120, 160)
ROWS, COLUMNS = np.arange(SHAPE[0])[:, None], np.arange(SHAPE[1])[None, :]


@dataclass(frozen=True)
class Truth:
    what: str
    kind: str
    amplitude: float
    period: float | None = None
    axis: str | None = None


def banding(rng, n, size, period, axis="row", fixed=False):
    place = ROWS if axis == "row" else COLUMNS
    phase = rng.uniform(0, 2 * np.pi, (1 if fixed else n, 1, 1))
    return size * np.sin(2 * np.pi * place / period + phase)


def offsets(rng, n, size, axis, fixed):
    shape = (SHAPE[0], 1) if axis == "row" else (1, SHAPE[1])
    drawn = rng.normal(0, 1, (1 if fixed else n, *shape))
    return size * (drawn - drawn.mean((1, 2), keepdims=True)) / drawn.std((1, 2), keepdims=True)


def frames(rng, patterns, n, bits, sigma=3.0, black=40.0, light=0.0):
    """(n, H, W) integers: noise of `sigma` DN, `patterns` (broadcast to the frames) added before rounding."""
    values = black + light + rng.normal(0, sigma, (n, *SHAPE))
    for pattern in patterns:
        values = values + pattern
    top = 2**bits - 1
    return np.clip(np.rint(values), 0, top).astype(np.uint8 if bits == 8 else np.uint16)


def flicker(rng, n, size):
    """1/f noise along the readout of each frame, standard deviation `size`."""
    length = SHAPE[0] * SHAPE[1]
    f = np.arange(1, length // 2 + 1)
    white = rng.normal(size=(n, len(f))) + 1j * rng.normal(size=(n, len(f)))
    noise = np.fft.irfft(np.concatenate([np.zeros((n, 1)), white / np.sqrt(f)], 1), length)
    return (size * noise / noise.std()).reshape(n, *SHAPE)


def camera(name, rng, n):
    """Patterns and what is true of them."""
    half = SHAPE[1] // 2 <= COLUMNS
    corner = np.exp(-np.hypot(ROWS, COLUMNS) / 40)
    match name:
        case "banding and columns":
            return [banding(rng, n, 2.5, 13), offsets(rng, n, 1.5, "column", True)], [
                Truth("row_banding", "per_frame", 2.5, 13, "row"),
                Truth("column_offset", "fixed", 1.5, None, "column"),
            ]
        case "row noise":
            return [offsets(rng, n, 1.0, "row", False)], [Truth("row_offset", "per_frame", 1.0, None, "row")]
        case "column noise and halves":
            return [offsets(rng, n, 1.2, "column", False), 4.0 * half], [
                Truth("column_offset", "per_frame", 1.2, None, "column"),
                Truth("halves", "fixed", 2.0, None, "column"),
            ]
        case "stripes":
            return [banding(rng, n, 2.0, 21.3, "column", True)], [
                Truth("column_banding", "fixed", 2.0, 21.3, "column")
            ]
        case "fixed banding and row offsets":
            return [banding(rng, n, 3.0, 7.7, "row", True), offsets(rng, n, 1.0, "row", True)], [
                Truth("row_banding", "fixed", 3.0, 7.7, "row"),
                Truth("row_offset", "fixed", 1.0, None, "row"),
            ]
        case "parity and drift":
            drift = rng.permutation(np.linspace(-1, 1, n))
            drift = 2.0 * drift / drift.std(ddof=1)
            return [1.0 * (ROWS % 2), drift[:, None, None]], [
                Truth("parity", "fixed", 0.5, 2, "row"),
                Truth("frame_drift", "per_frame", 2.0),
            ]
        case "glow":
            return [12.0 * corner], [Truth("glow", "fixed", float((12 * corner).std()))]
        case "pixels":
            return [rng.normal(0, 5.0, SHAPE)], [Truth("pixel_pattern", "fixed", 5.0)]
    raise ValueError(name)


CAMERAS = (
    "banding and columns",
    "row noise",
    "column noise and halves",
    "stripes",
    "fixed banding and row offsets",
    "parity and drift",
    "glow",
    "pixels",
)


def tukey(rng, shape, size, lam):
    u = rng.uniform(1e-9, 1 - 1e-9, size)
    values = (u**lam - (1 - u) ** lam) / lam
    return shape * values / values.std()


def clean(seed):
    """One of twenty clean sets: noise and ordinary pixel non-uniformity alone."""
    rng = np.random.default_rng(1000 + seed)
    n = (2, 3, 4, 8, 16)[seed % 5]
    bits = (8, 12)[seed % 2]
    sigma = (1.0, 2.0, 3.0, 6.0)[seed % 4]
    scale = 2**bits / 4096
    light = (0.0, 800.0, 2500.0)[seed % 3] * max(scale, 0.05) if bits == 8 else (0.0, 800.0, 2500.0)[seed % 3]
    gain = 0.5 if bits == 12 else 0.05  # DN per electron
    electrons = rng.poisson(light / gain * (1 + rng.normal(0, 0.006, SHAPE)), (n, *SHAPE))
    read = tukey(rng, sigma, (n, *SHAPE), -0.1) if seed % 7 == 3 else rng.normal(0, sigma, (n, *SHAPE))
    dsnu = rng.normal(0, 0.4 * sigma, SHAPE) if seed % 3 != 1 else 0.0
    values = 40 + gain * electrons + read + dsnu
    return np.clip(np.rint(values), 0, 2**bits - 1).astype(np.uint8 if bits == 8 else np.uint16)
