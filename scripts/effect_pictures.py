"""Pictures of an effect, computed: a scene with and without it, and what it does to usual measures."""

from functools import cache
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image

from visaug.camera import Camera
from visaug.camera.spec import check_spec
from visaug.core.sampling import Stream
from visaug.effects import Effect, Stage, Unexplained, catalogue

ROWS, COLUMNS = 120, 160
CAMERA = {
    "resolution": [ROWS, COLUMNS],
    "bit_depth": 16,
    "quantum_efficiency": 0.5,
    "gain_e_per_dn": 0.2,
    "black_level_dn": 240,
    "full_well_e": 11000,
    "exposure_s": 0.5,
    "temperature_c": 25,
    "read_noise": {"sigma_e": 2.5, "shape": -0.1},
    "dark_current": {"a_e_per_s": 1.0, "b_per_c": 0.0866},
    "prnu": {"column": 0.001, "row": 0.001, "pixel": 0.004},
    "dsnu": {"column_e": 0.8, "row_e": 0.4, "pixel_e": 1.0},
}
LADDER = [0.0, 200.0, 1500.0, 8000.0, 19000.0]  # photons of flats
FRAMES = 8
BLUES, GREYS = "#1f5fa8", "#9a9a9a"
OTHER_FORMS = {"blooming": {"spread": "isotropic"}}  # with a picture of their own


def shown(effect: type[Effect]) -> dict[str, float]:
    """The stronger of the values at which a diagnosis first tries each strength."""
    return {n: p.trials[-1] for n, p in effect.parameters.items() if p.strength and p.trials}


def cameras(effect: type[Effect], **form: str) -> tuple[Camera, Camera]:
    """A small CMOS camera without and with the effect; a base term is taken out of its chain."""
    camera = Camera.load(CAMERA)
    if effect is Unexplained:
        camera = measured_camera()
    elif not effect.base:
        camera = camera.with_effect(effect.name, **shown(effect), **form)
    without = Camera(camera.spec, None, camera.maps)
    without.effects = [other for other in without.effects if other.name != effect.name]
    return without, camera


def measured_camera() -> Camera:
    """The camera with a component as it may be measured: a checkerboard, a wave along the rows, noise above 2000 e-."""
    y, x = np.indices((ROWS, COLUMNS))
    power = np.zeros(ROWS)
    power[[10, ROWS - 10]] = 8 * ROWS
    parts = {
        "map_e": np.where((y + x) % 2, 5.0, -5.0),
        "row_power_e2": power,
        "level_e": np.array([2000.0, 8000.0]),
        "variance_e2": np.array([0.0, 900.0]),
    }
    maps = {f"unexplained.{name}": torch.from_numpy(v.astype(np.float32)) for name, v in parts.items()}
    content = CAMERA | {"effects": [{"name": "unexplained", "map": "better_unexplained.npz"}]}
    return Camera(check_spec(content), None, maps)


def scene() -> torch.Tensor:
    """Photons of a slope, a dark body with a window, bars, a source beyond full well; (1, 1, H, W)."""
    y, x = torch.meshgrid(torch.arange(ROWS) / ROWS, torch.arange(COLUMNS) / COLUMNS, indexing="ij")
    light = 300 + 2500 * y * x
    light[40:100, 20:75] = 150
    light[60:75, 35:50] = 4000
    light[25:95, 100:140] = torch.where(torch.arange(40) % 8 < 4, 9000.0, 900.0)
    light[15:21, 60:66] = 80000
    return light[None, None]


def unit(effect: type[Effect]) -> str:
    return "levels of 8 bit" if effect.stage == Stage.PICTURE else "DN"


def expose(camera: Camera, photons: torch.Tensor, seed: int = 1, developed: bool = False) -> np.ndarray:
    """Consecutive frames (B, H, W) of one camera, DN; `developed`: as finished pictures, levels of 8 bit."""
    count = len(photons)
    keys = [1000 * seed + i for i in range(count)]
    stream = Stream(keys, [7] * count, 1, (range(ROWS), range(COLUMNS)))
    frames = camera.expose(photons, stream, sequence=True)
    if developed:
        spec = camera.spec
        full_dn = (spec.full_well_e or 1) / spec.gain_e_per_dn
        frames = 255 * camera.finish(((frames - spec.black_level_dn) / full_dn).clamp(0, 1))
    return frames.squeeze(1).numpy()


def strip(effect: type[Effect], path: Path, **form: str) -> str:
    """Writes without | with | difference side by side; returns what the difference's colours span."""
    frames = torch.cat([scene().flip(-1), scene()])  # the frame before shows the scene mirrored
    developed = effect.stage == Stage.PICTURE
    off, on = (expose(camera, frames, developed=developed)[1] for camera in cameras(effect, **form))
    top = np.quantile(off, 0.97)
    change = on - off
    span = max(float(np.quantile(np.abs(change), 0.995)), 0.5)
    if (np.abs(change) > 0).mean() < 0.02:
        span = max(float(np.abs(change).max()), 0.5)
    greys = [np.clip(frame / top, 0, 1) ** 0.5 * 31 for frame in (off, on)]
    colours = 32 + (np.clip(change / span, -1, 1) + 1) / 2 * 30
    gap = np.full((ROWS, 4), 31.0)
    panels = np.concatenate([greys[0], gap, greys[1], gap, colours], axis=1).round().astype(np.uint8)
    diverging = plt.get_cmap("RdBu_r")(np.linspace(0, 1, 31))[:, :3]
    palette = np.concatenate([np.repeat(np.linspace(0, 1, 32)[:, None], 3, axis=1), diverging])
    image = Image.fromarray(panels, mode="P")
    image.putpalette((palette * 255).round().astype(np.uint8).tobytes())
    image.resize((image.width * 2, image.height * 2), Image.Resampling.NEAREST).save(path, optimize=True)
    return f"{span:.3g}"


def series(name: str, present: bool) -> list[np.ndarray]:
    """Flats of rising light with and without an effect; beyond the base chain they share the latter."""
    effect = catalogue()[name]
    shared = "row_noise" if effect.stage != Stage.PICTURE else name
    return _series(name if present or effect.base else shared, present)


@cache
def _series(name: str, present: bool) -> list[np.ndarray]:
    effect = catalogue()[name]
    camera, developed = cameras(effect)[present], effect.stage == Stage.PICTURE
    light = torch.ones(FRAMES, 1, ROWS, COLUMNS)
    return [expose(camera, photons * light, i + 2, developed) for i, photons in enumerate(LADDER)]


def signature(effect: type[Effect], path: Path) -> None:
    """Writes photon transfer, profiles, correlation of noise and histogram, with and without the effect."""
    lit = effect.stage in (Stage.OPTICS, Stage.PICTURE) or effect.name in (
        "prnu",
        "quantum_efficiency",
        "smear",
    )
    figure, axes = plt.subplots(1, 5, figsize=(11, 2.1), layout="constrained")
    for colour, label in ((GREYS, "without"), (BLUES, "with")):
        stacks = series(effect.name, label == "with")
        means = np.array([stack.mean() for stack in stacks])
        means[means < 0.01] = np.nan  # a dark picture has no place on a logarithmic axis
        variances = [np.median(stack.var(axis=0, ddof=1).mean(axis=1)) for stack in stacks]
        axes[0].loglog(means, np.maximum(variances, 1e-3), "o-", ms=3, lw=1, color=colour, label=label)
        frame = stacks[3][-1] if lit else stacks[0][-1]
        for axis, profile in zip(axes[1:3], (frame.mean(axis=1), frame.mean(axis=0))):
            axis.plot(profile, lw=0.8, color=colour)
        noise = (stacks[3] - stacks[3].mean(axis=0)).astype(np.float64)
        noise -= noise.mean(axis=(1, 2), keepdims=True)
        power = (noise**2).mean() + 1e-12
        lags = range(1, 7)
        axes[3].plot(
            lags, [(noise[..., k:] * noise[..., :-k]).mean() / power for k in lags], "o-", ms=3, color=colour
        )
        axes[3].plot(
            lags, [(noise[:, k:] * noise[:, :-k]).mean() / power for k in lags], "x--", ms=4, color=colour
        )
        dark = stacks[0].ravel()
        low, high = np.quantile(dark, [0.0005, 0.9995])
        step = 1 / 16 if effect.stage == Stage.PICTURE else max(1, (high - low) // 80)
        margin = 2.5 * min(step, 1)
        bins = np.arange(np.floor(low) - margin, np.ceil(high) + margin + step / 2, step)
        axes[4].hist(dark, bins=bins, histtype="step", lw=0.9, color=colour, log=True)
    low, high = axes[3].get_ylim()
    axes[3].set_ylim(min(low, -0.02), max(high, 0.05))
    axes[0].legend(fontsize=6, frameon=False)
    titles = (
        "variance in time against mean",
        f"row means, {'flat' if lit else 'dark'}, {unit(effect)}",
        f"column means, {'flat' if lit else 'dark'}, {unit(effect)}",
        "noise correlation: o columns, x rows",
        "dark frames: pixels a code",
    )
    for axis, title in zip(axes, titles):
        axis.set_title(title, fontsize=7)
        axis.tick_params(labelsize=6)
    figure.savefig(path, dpi=80)
    plt.close(figure)
    Image.open(path).convert("RGB").quantize(32).save(path, optimize=True)
