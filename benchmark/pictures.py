"""Cameras of their own that take pictures of a target: 8 bit, with a tone curve and JPEG. NumPy and Pillow alone."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

SIDE = (192, 256)


@dataclass(frozen=True)
class PictureCamera:
    """Electrons per 8-bit step of the linear picture, read noise, black level in such steps, patterns in e-."""

    name: str
    gain_e_per_dn: float
    read_e: float
    black_dn: float = 0.0
    row_e: float = 0.0
    column_fixed_e: float = 0.0
    pixel_fixed_e: float = 0.0
    prnu: float = 0.0
    banding_e: float = 0.0  # amplitude of a sine over the rows, its phase new in every picture
    banding_rows: float = 19.0
    tap_e: float = 0.0  # added to the right half
    hot_share: float = 0.0  # of the pixels
    hot_e: float = 0.0  # mean of their exponential excess
    corner_loss: float = 0.0  # of the light, growing as the fourth power of the cosine falls
    bloom_share: float = 0.0  # of the charge above saturation that goes on along the column


CAMERAS = (
    PictureCamera("A, quiet", 60.0, 40.0, black_dn=6.0),
    PictureCamera("B, small well", 22.0, 30.0, black_dn=8.0),
    PictureCamera("C, noisy", 9.0, 18.0, black_dn=12.0),
    PictureCamera("D, cut at 0", 25.0, 38.0),
    PictureCamera("E, rows", 30.0, 45.0, black_dn=9.0, row_e=25.0),
    PictureCamera("F, columns", 18.0, 30.0, black_dn=10.0, column_fixed_e=20.0),
    PictureCamera("G, patterns", 14.0, 25.0, black_dn=11.0, pixel_fixed_e=15.0, prnu=0.01),
    PictureCamera("H, rows and columns", 40.0, 90.0, black_dn=12.0, row_e=40.0, column_fixed_e=40.0),
)


def spacecraft(rng: np.random.Generator, side: tuple[int, int] = SIDE, size: float = 1.0) -> np.ndarray:
    """A lit body of shaded panels with edges and some texture before a black sky, in [0, 1], linear in light.

    `size` scales the body: 1 fills about half of 192 x 256 pixels.
    """
    rows, columns = np.indices(side).astype(float)
    scene = np.zeros(side)
    centre = np.array(side) * rng.uniform(0.35, 0.65, 2)
    for _ in range(rng.integers(4, 9)):
        angle = rng.uniform(0, np.pi)
        y, x = rows - centre[0] - size * rng.normal(0, 18), columns - centre[1] - size * rng.normal(0, 25)
        along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        half = size * rng.uniform(15, 55), size * rng.uniform(8, 35)
        inside = (abs(along) < half[0]) & (abs(across) < half[1])
        shade = rng.uniform(0.08, 0.9) * (1 + rng.uniform(-0.5, 0.5) * along / half[0])
        if rng.random() < 0.3:
            shade = shade * (1 + 0.3 * (np.sin(along / rng.uniform(1.5, 4)) > 0))
        scene[inside] = shade[inside]
    return ndimage.gaussian_filter(np.clip(scene, 0, 0.97), rng.uniform(0.7, 1.1))


def sunlit(rng: np.random.Generator, side: tuple[int, int] = SIDE, size: float = 1.0) -> np.ndarray:
    """A spacecraft with glints far above saturation on its panels."""
    scene, rows, columns = spacecraft(rng, side, size), *np.indices(side)
    lit = np.argwhere(scene > 0.1)
    for _ in range(rng.integers(2, 6)):
        y, x = lit[rng.integers(len(lit))] if len(lit) else np.array(side) // 2
        radius = rng.uniform(1.6, 3.2)  # no sharper than the lens leaves them
        scene = scene + rng.uniform(2, 8) * np.exp(-((rows - y) ** 2 + (columns - x) ** 2) / radius**2)
    return scene


def natural(rng: np.random.Generator, side: tuple[int, int] = SIDE) -> np.ndarray:
    """Occluding surfaces with 1/f texture whose contrast changes from one to the next, seen through a lens."""
    rows, columns = np.indices(side).astype(float)
    scene = np.full(side, rng.uniform(0.1, 0.8))
    f = np.hypot(np.fft.fftfreq(side[0])[:, None], np.fft.rfftfreq(side[1])[None])
    f[0, 0] = np.inf
    texture = np.fft.irfft2(np.fft.rfft2(rng.normal(size=side)) / f, side)
    texture /= texture.std()
    scene = scene * np.exp(0.1 * texture)
    for _ in range(40):
        y, x = rng.uniform(0, side[0]), rng.uniform(0, side[1])
        radius = rng.pareto(1.5) * 8 + 10
        inside = np.hypot(rows - y, (columns - x) * rng.uniform(0.6, 1.6)) < radius
        contrast = rng.choice([0.01, 0.03, 0.1, 0.25])
        moved = np.roll(texture, tuple(rng.integers(0, 100, 2)), (0, 1))
        scene[inside] = (np.exp(rng.uniform(np.log(0.03), np.log(0.85))) * np.exp(contrast * moved))[inside]
    return ndimage.gaussian_filter(np.clip(scene, 0, 0.97), rng.uniform(0.7, 1.1))


def take(
    camera: PictureCamera, scenes: list[np.ndarray], seed: int, encoding: str = "linear"
) -> list[np.ndarray]:
    """Pictures of the scenes as 8-bit steps; `encoding` is linear, srgb or gamma (2.2)."""
    rng = np.random.default_rng(seed)
    side = scenes[0].shape
    offset = (
        rng.normal(0, 1, side) * camera.pixel_fixed_e + rng.normal(0, 1, (1, side[1])) * camera.column_fixed_e
    )
    offset = offset + camera.tap_e * (np.arange(side[1]) >= side[1] // 2)
    response = (1 + rng.normal(0, 1, side) * camera.prnu) * _transmission(camera, side)
    hot = (rng.random(side) < camera.hot_share) * rng.exponential(max(camera.hot_e, 1e-9), side)
    top_e = (255 - camera.black_dn) * camera.gain_e_per_dn
    pictures = []
    for scene in scenes:
        charge = rng.poisson(scene * top_e * response + hot).astype(float)
        if camera.bloom_share:
            charge = _bloomed(charge, top_e, camera.bloom_share)
        charge = charge + offset + rng.normal(0, camera.read_e, side)
        charge = charge + rng.normal(0, 1, (side[0], 1)) * camera.row_e
        wave = 2 * np.pi * (np.arange(side[0]) / camera.banding_rows + rng.random())
        charge = charge + camera.banding_e * np.sin(wave)[:, None]
        linear = np.clip((charge / camera.gain_e_per_dn + camera.black_dn) / 255, 0, 1)
        pictures.append(np.rint(255 * encoded(linear, encoding)).astype(np.uint8))
    return pictures


def _transmission(camera: PictureCamera, side: tuple[int, int]) -> np.ndarray:
    y, x = ((np.arange(n) - (n - 1) / 2) / np.hypot(*side) * 2 for n in side)
    square = y[:, None] ** 2 + x[None, :] ** 2
    return (1 + ((1 - camera.corner_loss) ** -0.5 - 1) * square) ** -2  # cos^4 of the field angle


def _bloomed(charge: np.ndarray, well_e: float, share: float) -> np.ndarray:
    """Half of the charge above saturation goes up the column and half down; a share survives each step."""
    kept = np.minimum(charge, well_e)
    excess = charge - kept
    for order in (range(len(charge)), range(len(charge) - 1, -1, -1)):
        carried = np.zeros(charge.shape[1])
        for row in order:
            total = kept[row] + carried
            kept[row] = np.minimum(total, well_e)
            carried = (total - kept[row] + 0.5 * excess[row]) * share
    return kept


def encoded(linear: np.ndarray, encoding: str) -> np.ndarray:
    if encoding == "srgb":
        return np.where(
            linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
        )
    return linear if encoding == "linear" else linear ** (1 / 2.2)


def save(pictures: list[np.ndarray], folder: Path, quality: int | None = None) -> Path:
    """PNG files, or JPEG of a quality."""
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    for n, pixels in enumerate(pictures):
        if quality is None:
            Image.fromarray(pixels).save(folder / f"{n:04d}.png")
        else:
            Image.fromarray(pixels).save(folder / f"{n:04d}.jpg", quality=quality)
    return folder


def compressed(pixels: np.ndarray, quality: int) -> np.ndarray:
    """The picture after JPEG."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=quality)
    return np.asarray(Image.open(buffer))
