"""The pictures of docs/paper.md: one function, one figure."""

import io
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.figure import Figure
from paper_model import (
    COLUMNS,
    EXPOSURES_S,
    ROWS,
    TEMPERATURES_C,
    DarkCurrent,
    frame,
    gaussian_deviation_dn,
    paper_camera,
    white_gaussian,
)
from PIL import Image, ImageDraw
from scipy import stats

from visaug.augment import SensorNoise
from visaug.camera import Camera
from visaug.core.sampling import Stream

plt.rcParams.update(
    {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False}
)
GRAY: dict[str, Any] = {"cmap": "gray", "interpolation": "nearest", "aspect": "equal"}


def save(figure: Figure, path: Path) -> None:
    """As a PNG of 128 colours, which keeps pictures of noise small."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=90, bbox_inches="tight")
    plt.close(figure)
    picture = Image.open(buffer).convert("RGB").quantize(128, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)


def _counts(axes, values_by_label: dict[str, np.ndarray], edges: np.ndarray, unit: str, styles=()) -> None:
    for i, (label, values) in enumerate(values_by_label.items()):
        counts, _ = np.histogram(values, edges)
        axes.stairs(
            counts / values.size, edges, label=label, color=f"C{i}", lw=1.3, ls=styles[i] if styles else "-"
        )
    axes.set_yscale("log")
    axes.set_xlabel(unit)
    axes.set_ylabel("share of pixels")
    axes.legend()


def dsnu_and_profiles(pattern_e: np.ndarray) -> Figure:
    """Fig. 2: the DSNU as an image, its columns above, its rows to the right."""
    figure, grid = plt.subplots(
        2,
        2,
        figsize=(7.5, 5.2),
        width_ratios=(4, 1),
        height_ratios=(1, 2.6),
        gridspec_kw={"wspace": 0.05, "hspace": 0.08},
    )
    grid[0, 0].plot(pattern_e.mean(0), lw=0, marker=".", ms=1.5)
    grid[0, 0].set_ylabel("column mean, e-")
    grid[1, 0].imshow(
        pattern_e[::4, ::4], vmin=-2, vmax=13, extent=(0, COLUMNS, ROWS, 0), **(GRAY | {"aspect": "auto"})
    )
    grid[1, 0].set_xlabel("column")
    grid[1, 0].set_ylabel("row")
    grid[1, 1].plot(pattern_e.mean(1) - pattern_e.mean(), np.arange(len(pattern_e)), lw=0.6)
    grid[1, 1].invert_yaxis()
    grid[1, 1].set_xlabel("row mean\nless frame mean, e-")
    grid[1, 1].set_yticks([])
    grid[0, 1].axis("off")
    grid[0, 0].set_xlim(0, COLUMNS)
    grid[0, 0].set_xticks([])
    grid[1, 1].set_ylim(ROWS, 0)
    return figure


def compared(
    images: dict[str, np.ndarray], edges: np.ndarray, unit: str, limits: tuple[float, float]
) -> Figure:
    """Figs. 3, 4 and 7: images on one scale, and their histograms below."""
    figure = plt.figure(figsize=(8.5, 4.6))
    grid = figure.add_gridspec(2, len(images), height_ratios=(1.2, 1), hspace=0.15, wspace=0.05)
    for i, (label, image) in enumerate(images.items()):
        axes = figure.add_subplot(grid[0, i])
        axes.imshow(image[::4, ::4], vmin=limits[0], vmax=limits[1], **GRAY)
        axes.set_title(label, fontsize=9)
        axes.axis("off")
    _counts(figure.add_subplot(grid[1, :]), images, edges, unit)
    return figure


def read_noise_laws() -> Figure:
    """Fig. 5: read noise of shape 0.14 and -0.23 with 2.37 e- as standard deviation, and as scale."""
    figure, axes = plt.subplots(1, 2, figsize=(8.5, 3.2), sharey=True)
    x = np.linspace(-40, 40, 1601)
    for panel, (title, meaning) in zip(
        axes, {"2.37 e- is the standard deviation": "sd", "2.37 e- is the scale": "scale"}.items()
    ):
        for shape in (0.14, -0.23):
            scale = 2.37 if meaning == "scale" else 2.37 / stats.tukeylambda.std(shape)
            deviation = scale * stats.tukeylambda.std(shape)
            panel.plot(
                x,
                stats.tukeylambda.pdf(x / scale, shape) / scale,
                label=f"shape {shape:g}: sd {deviation:.2f} e-",
            )
        panel.set(title=title, yscale="log", ylim=(1e-6, 10), xlabel="read noise, e-")
        panel.legend(loc="upper right", fontsize=8)
    axes[0].set_ylabel("density, 1/e-")
    return figure


def dark_current_fits(fits: dict[str, DarkCurrent]) -> Figure:
    """Fig. 6: dark current over temperature, by the paper's procedure on simulated frames."""
    figure, axes = plt.subplots(figsize=(6, 3.6))
    t = np.linspace(14, 31, 100)
    axes.plot(t, 0.136 * np.exp(0.14 * t), "k--", label="published: 0.136 exp(0.14 T)")
    for i, (label, fit) in enumerate(fits.items()):
        text = f"{label}: {fit.a_e_per_s:.3f} exp({fit.b_per_c:.3f} T)"
        axes.plot(TEMPERATURES_C, fit.slopes_e_per_s, f"C{i}o", ms=4)
        axes.plot(t, fit.a_e_per_s * np.exp(fit.b_per_c * t), f"C{i}", label=text)
    axes.set_xlabel(f"temperature, C ({len(EXPOSURES_S)} exposures each)")
    axes.set_ylabel("dark current, e-/s")
    axes.legend()
    return figure


def histograms(frames_dn: dict[str, np.ndarray], upper_dn: float) -> Figure:
    """Fig. 8: dark frames by the shape of their read noise."""
    figure, axes = plt.subplots(figsize=(7, 3.6))
    _counts(axes, frames_dn, np.arange(0, upper_dn + 1, upper_dn / 150), "DN", ("-", "-", "--", "--", ":"))
    axes.legend(fontsize=8)
    return figure


def scene() -> np.ndarray:
    """A drawn satellite before black space, (300, 480) in [0, 1]: stands in for a SPEED image."""
    picture = Image.new("L", (1920, 1200))
    pen = ImageDraw.Draw(picture)
    pen.polygon([(760, 420), (1150, 330), (1260, 640), (860, 760)], fill=205)
    pen.polygon([(760, 420), (860, 760), (800, 900), (690, 560)], fill=70)
    pen.polygon([(860, 760), (1260, 640), (1190, 780), (800, 900)], fill=28)
    for i in range(5):
        shift = 90 * i
        pen.polygon(
            [
                (780 + shift, 430 - 20 * i),
                (850 + shift, 414 - 20 * i),
                (950 + shift, 715 - 27 * i),
                (880 + shift, 735 - 27 * i),
            ],
            fill=150,
        )
    for start, end in (((760, 420), (560, 250)), ((1150, 330), (1290, 160)), ((1260, 640), (1500, 720))):
        pen.line([start, end], fill=120, width=8)
    return np.asarray(picture.resize((480, 300), Image.Resampling.BOX), np.float32) / 255


def augmented() -> Figure:
    """Fig. 9: a synthetic image, with the camera's noise at its gain and at 20 dB more, and with eq. 6's."""
    clean = scene()
    camera = paper_camera(exposure_s=0.5, temperature_c=30.0)
    images = {"clean": clean}
    for gain_db in (3.0, 23.0):
        noise = SensorNoise(camera, fixed_pattern="camera", seed=1, values={"gain_db": gain_db})
        with torch.no_grad():
            images[f"sensor model, {gain_db:g} dB"] = noise(torch.from_numpy(clean)[None, None])[0, 0].numpy()
    bright = camera.replace({"gain_e_per_dn": camera.gain_at(23.0)})
    v = bright.values()
    mean_photons = clean.mean() * 65535 * v["gain_e_per_dn"] / v["quantum_efficiency"]  # eq. 7
    white = np.random.default_rng(9).normal(
        0, gaussian_deviation_dn(bright, mean_photons) / 65535, clean.shape
    )
    images["white Gaussian (eq. 6), 23 dB"] = (clean + white).clip(0, 1)
    figure, grid = plt.subplots(
        2, 4, figsize=(10, 4), height_ratios=(1, 1), gridspec_kw={"wspace": 0.04, "hspace": 0.05}
    )
    for (label, image), (above, below) in zip(images.items(), grid.T):
        above.imshow(image, vmin=0, vmax=1, **GRAY)
        above.set_title(label, fontsize=9)
        below.imshow(image[150:250, 150:310], vmin=0, vmax=0.15, **GRAY)
        above.axis("off")
        below.axis("off")
    grid[1, 0].set_title("a part, 0 to 15 % of white", fontsize=8, loc="left", y=-0.16)
    return figure


def readings() -> Figure:
    """What the switch `reading` does: shot noise by photon transfer, and the comb of DN codes."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.2))
    base = {
        "resolution": [128, 256],
        "bit_depth": 16,
        "gain_e_per_dn": 0.4,
        "quantum_efficiency": 0.5,
        "black_level_dn": 100,
        "read_noise": {"sigma_e": 2.37},
    }
    photons = np.geomspace(20, 20000, 9)
    for i, reading in enumerate(("physical", "paper")):
        camera = Camera.load({**base, "reading": reading})
        stream = Stream(range(len(photons)), [0] * len(photons), 1, (range(128), range(256)))
        light = torch.tensor(photons, dtype=torch.float32).view(-1, 1, 1, 1).expand(-1, 1, 128, 256)
        y = camera.expose(light.contiguous(), stream)[:, 0].double().numpy()
        left.loglog(y.mean((1, 2)) - 100, y.var((1, 2)), f"C{i}o", ms=4, label=reading)
        electrons = photons / 2
        shot = electrons if reading == "physical" else electrons / 2
        left.loglog(electrons / 0.4, (shot + 2.37**2) / 0.4**2, f"C{i}", lw=0.8)
        codes = np.bincount(y[0].astype(int).ravel(), minlength=260)
        right.step(np.arange(100, 150), codes[100:150], f"C{i}", where="mid", label=reading)
    left.set(xlabel="mean, DN", ylabel="variance, DN$^2$", title="lines: theory", box_aspect=0.7)
    right.set(xlabel="DN code", ylabel="pixels", title="20 photons, 0.4 e- per DN", box_aspect=0.7)
    left.legend()
    right.legend()
    return figure


def make_all(folder: Path, maps: dict[str, Path], fits: dict[str, DarkCurrent]) -> None:
    """Every picture into `folder`.

    Args:
        maps: DSNU maps in e-, files of (1024, 1280): "accurate", and "learnt" from simulated bias frames.
        fits: dark current by arm.
    """
    folder.mkdir(parents=True, exist_ok=True)
    accurate, again = (np.load(maps[name]) for name in ("accurate", "learnt"))
    rng = np.random.default_rng(3)
    gaussian = 2.82 * rng.standard_normal(COLUMNS)[None] + 0.21 * rng.standard_normal(ROWS)[:, None]
    gaussian = gaussian + 1.1 * rng.standard_normal((ROWS, COLUMNS))
    gain = paper_camera().spec.gain_e_per_dn
    save(dsnu_and_profiles(accurate), folder / "fig2.png")
    pair = {"accurate model": accurate / gain, "Gaussian model": gaussian / gain}
    save(compared(pair, np.arange(-150, 200, 4), "DSNU, DN", (-40, 140)), folder / "fig3.png")
    pair = {
        "simulated sensor": accurate / gain,
        "another, drawn from the fit to 200 bias frames": again / gain,
    }
    save(compared(pair, np.arange(-60, 200, 4), "DSNU, DN", (-40, 140)), folder / "fig4.png")
    save(read_noise_laws(), folder / "fig5.png")
    save(dark_current_fits(fits), folder / "fig6.png")
    scale = {"read_noise.meaning": "scale"}
    dark = {
        "accurate DSNU": frame(paper_camera(maps["accurate"], **scale)),
        "Gaussian DSNU": frame(paper_camera(**scale)),
        "white Gaussian, eq. 6": white_gaussian(paper_camera()),
    }
    save(compared(dark, np.arange(0, 1200, 10), "DN", (0, 250)), folder / "fig7.png")
    by_shape = {
        "shape -0.23, 2.37 e- is the scale": frame(paper_camera(**scale)),
        "shape -0.23, 2.37 e- is the standard deviation": frame(paper_camera()),
        "shape 0.14, scale": frame(paper_camera(**scale, **{"read_noise.shape": 0.14})),
        "shape 0.14, standard deviation": frame(paper_camera(**{"read_noise.shape": 0.14})),
        "white Gaussian, eq. 6": white_gaussian(paper_camera()),
    }
    save(histograms(by_shape, 1200.0), folder / "fig8.png")
    save(augmented(), folder / "fig9.png")
    save(readings(), folder / "readings.png")
