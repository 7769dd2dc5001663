#!/usr/bin/env python
"""Makes docs/pictures/colour_*.png: what a colour camera and JPEG make of noise, beside a monochrome camera of the same numbers.

Usage: python scripts/colour_pictures.py
"""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.colors import LogNorm
from PIL import Image

from visaug.augment import SensorNoise
from visaug.augment.exposure import linear_to_srgb
from visaug.camera import Camera

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures"
SIDE, COUNT, SHOWN = 96, 64, 48  # px of a picture, pictures of a spectrum, px of the part that is shown
CAMERA = {
    "resolution": [SIDE, SIDE],
    "bit_depth": 12,
    "gain_e_per_dn": 0.2,
    "black_level_dn": 120,
    "read_noise": {"sigma_e": 4.0},
    "effects": [{"name": "row_noise", "sigma_e": 1.5}],
}
COLOUR = {
    "cfa": "RGGB",
    "white_balance": [2.0, 1.0, 1.7],
    "matrix": [[1.6, -0.45, -0.15], [-0.25, 1.5, -0.25], [-0.05, -0.55, 1.6]],
}
JPEG = {"name": "jpeg", "quality": 85}
CHAINS = {
    "monochrome": CAMERA,
    "colour, bilinear": CAMERA | {"colour": COLOUR},
    "colour, Malvar": CAMERA | {"colour": COLOUR | {"demosaic": "malvar"}},
    "colour, JPEG 85": CAMERA | {"colour": COLOUR, "effects": [*CAMERA["effects"], JPEG]},
}
COLOURS = ("#c0392b", "#2e8b57", "#1f5fa8")


def scenes() -> dict[str, torch.Tensor]:
    """Linear light, (1, 3, SIDE, SIDE) each, all gray but for the flat."""
    y, x = torch.meshgrid(torch.arange(SIDE) + 0.5, torch.arange(SIDE) + 0.5, indexing="ij")
    middle = SIDE / 2
    star = 0.02 + 0.9 * torch.exp(-((x - middle - 0.3) ** 2 + (y - middle + 0.2) ** 2) / (2 * 1.0**2))
    edge = torch.sigmoid((x - middle + 0.15 * (y - middle)) * 4) * 0.55 + 0.05
    planes = {"flat, 0.2": torch.full_like(x, 0.2), "ramp, 0 to 0.6": 0.6 * (x - 24).clamp(0, 48) / 48}
    planes |= {"star": star, "edge": edge}
    return {name: plane[None, None].expand(1, 3, SIDE, SIDE) for name, plane in planes.items()}


def taken(camera: dict, light: torch.Tensor, count: int) -> np.ndarray:
    """(count, 3, H, W) sRGB-encoded pictures, 0 to 255."""
    noise = SensorNoise(Camera.load(camera), transfer="srgb", seed=3)
    encoded = linear_to_srgb(light).expand(count, -1, -1, -1)
    return 255 * noise(encoded).double().numpy()


def gallery(path: Path) -> None:
    figure, axes = plt.subplots(len(CHAINS), len(scenes()), figsize=(8.4, 8.8), layout="constrained")
    first = (SIDE - SHOWN) // 2
    for row, axes_of_row, (chain, camera) in zip(range(len(CHAINS)), axes, CHAINS.items()):
        for axis, (name, light) in zip(axes_of_row, scenes().items()):
            picture = taken(camera, light, 1)[0].transpose(1, 2, 0)[
                first : first + SHOWN, first : first + SHOWN
            ]
            axis.imshow(picture.round().clip(0, 255).astype(np.uint8), interpolation="nearest")
            axis.set_xticks([0, SHOWN - 1])
            axis.set_yticks([0, SHOWN - 1])
            axis.tick_params(labelsize=6)
            if row == 0:
                axis.set_title(name, fontsize=9)
            if row == len(CHAINS) - 1:
                axis.set_xlabel("column, px", fontsize=7)
            if name.startswith("flat"):
                axis.set_ylabel(f"{chain}\nrow, px", fontsize=8)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    Image.open(path).convert("RGB").save(
        path, optimize=True
    )  # a palette would lose what noise does to colours


def spectra(path: Path) -> None:
    """Power of the noise of a flat over spatial frequency: maps of green above, all channels along the rows below."""
    figure, axes = plt.subplots(
        2, len(CHAINS), figsize=(10.5, 5.2), layout="constrained", height_ratios=(1.1, 1)
    )
    light = scenes()["flat, 0.2"]
    shown: Any = None
    for (above, below), (chain, camera) in zip(axes.T, CHAINS.items()):
        noise = taken(camera, light, COUNT)
        noise -= noise.mean((0, 2, 3), keepdims=True)
        power = (np.abs(np.fft.fft2(noise)) ** 2).mean(0) / SIDE**2  # levels^2; its mean is the variance
        power = np.fft.fftshift(power, axes=(1, 2))
        shown = above.imshow(
            power[1],
            extent=(-0.5, 0.5, -0.5, 0.5),
            norm=LogNorm(1, 1000),
            cmap="magma",
            interpolation="nearest",
        )
        deviation = noise.std((0, 2, 3))
        above.set_title(
            f"{chain}\nsd {deviation[0]:.1f} / {deviation[1]:.1f} / {deviation[2]:.1f}", fontsize=8
        )
        frequency = np.fft.rfftfreq(SIDE)
        rows = (np.abs(np.fft.rfft(noise, axis=3)) ** 2).mean((0, 2)) / SIDE
        for channel, (colour, letter) in enumerate(zip(COLOURS, "RGB")):
            below.semilogy(frequency[1:], rows[channel, 1:], color=colour, lw=1.2, label=letter)
        below.set_ylim(1, 1000)
        below.set_xlabel("along the rows, cycles/px", fontsize=7)
        for axis in (above, below):
            axis.tick_params(labelsize=6)
    axes[0, 0].set_ylabel("down the columns, cycles/px", fontsize=7)
    axes[1, 0].set_ylabel("power, levels² of 8 bit", fontsize=7)
    axes[1, 1].legend(fontsize=7, frameon=False, ncol=3, loc="lower left")
    bar = figure.colorbar(shown, ax=axes[0], shrink=0.9, pad=0.01)
    bar.set_label("power of green, levels²", fontsize=7)
    bar.ax.tick_params(labelsize=6)
    figure.savefig(path, dpi=95)
    plt.close(figure)
    Image.open(path).convert("RGB").save(path, optimize=True)


if __name__ == "__main__":
    PICTURES.mkdir(exist_ok=True)
    gallery(PICTURES / "colour_scenes.png")
    spectra(PICTURES / "colour_spectra.png")
