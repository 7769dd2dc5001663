"""Remake what the paper shows and simulation can: Figs. 2 to 9 and Table 1, next to the published figures.

    python scripts/paper.py [docs]

Writes docs/paper.md and its pictures, docs/paper/*.png; takes 20 s of one free core.
"""

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from paper_figures import make_all
from paper_model import (
    COLUMNS,
    ROWS,
    Characterised,
    DarkCurrent,
    accurate_pattern,
    characterise,
    dark_current,
    dark_law,
    frame,
    paper_camera,
    white_gaussian,
)

from visaug.camera.patterns import fit_pattern
from visaug.core.files import write_text

SENSORS = 6  # an arm of Table 1 is the mean over as many sensors
NEAR_NOMINAL = 11  # the sensor in the pictures: its columns deviate by 2.83 e-
PUBLISHED = {"Gaussian": (65.4, 3736.9), "accurate": (81.5, 4531.5)}  # mean in DN, variance in DN^2
MEANINGS = {"standard_deviation": "deviation", "scale": "scale"}


@dataclass(frozen=True)
class Arm:
    """One line of Table 1 by simulation and by theory, and the gains that match the published figures."""

    dsnu: str
    reading: str
    meaning: str
    mean_dn: float
    scatter_dn: float
    variance_dn2: float
    theory_mean_dn: float
    theory_variance_dn2: float
    gain_by_mean: float
    gain_by_variance: float


def table_one(folder: Path, gain: float) -> list[Arm]:
    """Every DSNU model, reading and meaning of sigma_read, each over SENSORS sensors."""
    arms = []
    for dsnu in PUBLISHED:
        for reading in ("physical", "paper"):
            for meaning in MEANINGS:
                values = {"reading": reading, "read_noise.meaning": meaning}
                moments = []
                for sensor in range(SENSORS):
                    camera = paper_camera(_accurate(folder, sensor) if dsnu == "accurate" else None, **values)
                    dark = frame(camera, sensor=sensor).astype(np.float64)
                    moments.append((dark.mean(), dark.var()))
                mean, variance = np.mean(moments, 0)
                law = dark_law(dsnu == "accurate", meaning, rounded=reading == "paper")
                published_mean, published_variance = PUBLISHED[dsnu]
                arms.append(
                    Arm(
                        dsnu,
                        reading,
                        meaning,
                        mean,
                        np.std(moments, 0, ddof=1)[0],
                        variance,
                        law.mean_e / gain,
                        (law.deviation_e / gain) ** 2,
                        law.mean_e / published_mean,
                        law.deviation_e / np.sqrt(published_variance),
                    )
                )
    return arms


def _accurate(folder: Path, sensor: int) -> Path:
    path = folder / f"accurate_{sensor}.npy"
    if not path.exists():
        np.save(path, accurate_pattern().draw((ROWS, COLUMNS), sensor))
    return path


def main(docs: Path) -> None:
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sensor = _accurate(folder, NEAR_NOMINAL)
        arms = table_one(folder, paper_camera().spec.gain_e_per_dn)
        offset = {"black_level_dn": 2000.0}
        bias = {
            "as it is": characterise(paper_camera(sensor)),
            "black level 2000 DN": characterise(paper_camera(sensor, **offset)),
        }
        fits = {
            "as it is": dark_current(paper_camera(sensor)),
            "black level 2000 DN": dark_current(paper_camera(sensor, **offset)),
        }
        learnt = bias["black level 2000 DN"]
        law = fit_pattern(learnt.master_e, noise_e=learnt.read_e / np.sqrt(200))
        np.save(folder / "learnt.npy", law.draw((ROWS, COLUMNS), 5))
        make_all(docs / "paper", {"accurate": sensor, "learnt": folder / "learnt.npy"}, fits)
        truth = np.load(sensor).astype(np.float64)
        write_text(docs / "paper.md", page(arms, bias, fits, truth, np.load(folder / "learnt.npy")))
    print(f"{docs / 'paper.md'}: written in {time.perf_counter() - began:.0f} s")


def page(
    arms: list[Arm],
    bias: dict[str, Characterised],
    fits: dict[str, DarkCurrent],
    truth: np.ndarray,
    learnt: np.ndarray,
) -> str:
    """The text of docs/paper.md."""
    camera = paper_camera()
    white = white_gaussian(camera)
    scaled = [arm for arm in arms if arm.meaning == "scale" and arm.reading == "paper"]
    gaussian, accurate = scaled
    gains = [gain for arm in scaled for gain in (arm.gain_by_mean, arm.gain_by_variance)]
    template = (Path(__file__).parent / "paper_template.md").read_text()
    return template.format(
        gain=camera.spec.gain_e_per_dn,
        gain_0=camera.gain_at(0.0),
        gains=", ".join(f"{gain:.4f}" for gain in gains),
        full_e=camera.spec.gain_e_per_dn * 65535,
        white_mean=white.mean(),
        white_variance=white.var(),
        white_ratio=white.mean() / white.std(),
        scale_mean=accurate.mean_dn,
        scale_variance=accurate.variance_dn2,
        scale_gaussian_mean=gaussian.mean_dn,
        scale_gaussian_variance=gaussian.variance_dn2,
        darker=100 * (1 - gaussian.mean_dn / accurate.mean_dn),
        sensors=SENSORS,
        table="\n".join(_line(arm) for arm in arms),
        worst=100 * max(abs(arm.mean_dn / arm.theory_mean_dn - 1) for arm in arms),
        bias="\n".join(
            f"| {name} | {c.column_e:.2f} | {c.row_e:.2f} | {c.pixel_e:.2f} | {c.read_e:.2f} |"
            for name, c in bias.items()
        ),
        fits="\n".join(f"| {name} | {f.a_e_per_s:.4f} | {f.b_per_c:.4f} |" for name, f in fits.items()),
        column=truth.mean(0).std(),
        row=truth.mean(1).std(),
        left=truth[:, :250].mean(),
        right=truth[:, 250:].mean(),
        learnt_column=learnt.mean(0).std(),
        learnt_row=learnt.mean(1).std(),
        learnt_left=learnt[:, :250].mean(),
        learnt_right=learnt[:, 250:].mean(),
    )


def _line(arm: Arm) -> str:
    cells = [
        arm.dsnu,
        arm.reading,
        MEANINGS[arm.meaning],
        f"{arm.mean_dn:.1f} ± {arm.scatter_dn:.1f}",
        f"{arm.variance_dn2:.0f}",
        f"{arm.theory_mean_dn:.1f} / {arm.theory_variance_dn2:.0f}",
        f"{arm.theory_mean_dn / np.sqrt(arm.theory_variance_dn2):.2f}",
        f"{arm.gain_by_mean:.4f}",
        f"{arm.gain_by_variance:.4f}",
    ]
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
