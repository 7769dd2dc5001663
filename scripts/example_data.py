"""Make the example data of the package: python scripts/example_data.py visaug/data/example

A clean rendered picture, and frames of a camera in plain NumPy that shares no code with the package (EMVA 1288's linear
model; Janesick, Photon Transfer, 2007), with a noise of whole columns that its data sheet does not tell.
"""

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

ROWS, COLUMNS = 64, 80
EFFICIENCY = 0.6  # electrons per photon
GAIN_E_PER_DN = 2.0
BLACK_LEVEL_DN = 64.0
READ_NOISE_E = 6.0  # standard deviation
PRNU, DSNU_E = 0.005, 1.0  # standard deviations over pixels
DARK_E_PER_S = 0.5  # at 20 C
COLUMN_NOISE_E = 2.0  # standard deviation; one offset per column and frame: what the data sheet lacks
WHITE_DN = 4095
FLAT_S = 0.01
PLAN = [
    *[("bias", 1e-5, None)] * 12,
    *[("dark", exposure_s, None) for exposure_s in (2.0, 8.0) for _ in range(6)],
    *[("flat", FLAT_S, photons) for photons in (200, 1000, 3000, 5000, 8000, 11000, 20000) for _ in range(4)],
]
DATA_SHEET = """\
# What a manufacturer would state of the camera of these frames. It lacks one effect.
name: example camera
resolution: [64, 80]
bit_depth: 12
quantum_efficiency: 0.6
gain_e_per_dn: 2.0
black_level_dn: 64
full_well_e: 9000                 # above what the converter can show, it clips first
exposure_s: 0.01
temperature_c: 20
read_noise: {sigma_e: 6.0, shape: 0.14}          # 0.14 is Gaussian
dark_current: {a_e_per_s: 0.5, b_per_c: 0}
prnu: {column: 0, row: 0, pixel: 0.005}
dsnu: {column_e: 0, row_e: 0, pixel_e: 1.0}
"""


def main(folder: Path) -> None:
    (folder / "frames").mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(2026)
    prnu = rng.normal(1, PRNU, (ROWS, COLUMNS))
    dsnu_e = rng.normal(0, DSNU_E, (ROWS, COLUMNS))
    frames, rows = [], []
    for number, (kind, exposure_s, photons) in enumerate(PLAN):
        mean_e = EFFICIENCY * (photons or 0) * prnu + DARK_E_PER_S * exposure_s
        charge_e = rng.poisson(mean_e) + dsnu_e + rng.normal(0, READ_NOISE_E, (ROWS, COLUMNS))
        charge_e += rng.normal(0, COLUMN_NOISE_E, COLUMNS)
        value_dn = np.rint(charge_e / GAIN_E_PER_DN + BLACK_LEVEL_DN)
        frames.append(np.clip(value_dn, 0, WHITE_DN).astype(np.uint16))
        rows.append([number, f"frames.npz#frames[{number}]", kind, exposure_s, 20, 0, photons or "", ""])
    np.savez_compressed(folder / "frames" / "frames.npz", frames=np.array(frames))
    with (folder / "frames" / "frames.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(
            ["sequence", "file", "kind", "exposure_s", "temperature_c", "gain_db", "photons", "clean"]
        )
        table.writerows(rows)
    (folder / "data_sheet.yaml").write_text(DATA_SHEET)
    render(folder / "render.png")


def render(path: Path) -> None:
    """One picture of the pose harness's spacecraft, without noise, encoded as sRGB."""
    from visaug_train.render.dataset import RenderSettings, render_dataset

    with tempfile.TemporaryDirectory() as folder:
        settings = RenderSettings(
            width=320, height=200, images={"synthetic": {"test": 16}}, distance_m=(3.2, 4.0), seed=1
        )
        made = render_dataset(folder, settings)
        last = sorted((made / "synthetic").rglob("*.*g"))[-1]  # the one that shows the whole body, evenly lit
        light = np.asarray(Image.open(last)) / 255
        tag = PngInfo()
        tag.add(b"sRGB", b"\0")  # the encoding (IEC 61966-2-1), with perceptual intent
        encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        Image.fromarray(np.rint(255 * encoded).astype(np.uint8)).save(path, optimize=True, pnginfo=tag)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
