"""Make the camera files of five photographic cameras from the noise fits published with ELD.

    python scripts/make_photographic_cameras.py eld_camera_params visaug/camera/data

The folder holds one JSON a camera: `camera_params/release/*.npy` of the public repository Vandermode/ELD
(MIT, Copyright (c) 2020 Kaixuan Wei), commit 53d5408dec3a33e5ca304bb49682d7b6b6dc79c2, converted to JSON.
The fits are those of K. Wei, Y. Fu, Y. Zheng, J. Yang, "Physics-based noise modeling for extreme low-light
photography", IEEE TPAMI 44 (2022) 8520.

What is converted, and how:

- K, DN of 14 bit per electron. Kmax is 64 times Kmin in every file: six stops. The files name no ISO. ISO
  100 at Kmin is our reading of them: 15583 DN / Kmin is then a full well of 35 to 166 ke-, right for pixels
  of 4 to 8 um. Cameras are made three, five and six stops up, where read noise matters.
- Read noise: log of the Tukey-lambda scale in DN is slope * log(K) + bias (G_scale). The scale is that of
  the plain quantile function, as SciPy has it, so the standard deviation is the scale times that of the
  unit law of the same shape. The Gaussian fits in the same files (g_scale) bear this out: they agree with
  it within 1 to 17 %.
- Shape: G_shape lists two values a stop; those of the stop are averaged.
- Row noise, Gaussian, fresh in every frame: log sigma in DN = slope * log(K) + bias (R_scale).
- Black level and saturation: the authors' own simulation takes 16383 - 800 DN between black and white for
  all five.
- Spreads: `sigma` of G_scale and R_scale, the scatter of the logarithms about their lines, is a relative
  standard deviation.

Not in the files: quantum efficiency, dark current, PRNU, DSNU; usual values are assumed.

The colour path is that of dcraw and LibRaw from Adobe's published colour matrix of each camera (XYZ to camera RGB
under D65, times 10000, as in LibRaw's src/tables/colordata.cpp): N = matrix x (sRGB to XYZ); white balance of
daylight is 1 over the row sums of N; the colour matrix is the inverse of N with rows brought to sum 1. That the
first pixel of the raw image is red (RGGB) is assumed. The noise fits are of the raw planes, before all this.
"""

import json
import math
import sys
from pathlib import Path

import numpy as np
from scipy.stats import tukeylambda

from visaug.core.files import write_text

SRGB_TO_XYZ = np.array(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
)
XYZ_TO_CAMERA = {  # LibRaw e419de0: Adobe's matrices, times 10000
    "CanonEOS5D4": (6446, -366, -864, -4436, 12204, 2513, -952, 2496, 6348),
    "CanonEOS70D": (7034, -804, -1014, -4420, 12564, 2058, -851, 1994, 5758),
    "CanonEOS700D": (6602, -841, -939, -4472, 12458, 2247, -975, 2039, 6148),
    "NikonD850": (10405, -3755, -1270, -5461, 13787, 1793, -1040, 2015, 6785),
    "SonyA7S2": (5838, -1430, -246, -3497, 11477, 2297, -748, 1885, 5778),
}
STOPS = (3, 5, 6)  # above the lowest gain: ISO 800, 3200 and 6400 where that is ISO 100
BODIES = {  # name, rows and columns of the raw image (the makers' specifications), file of the fit
    "canon_5d4": ("Canon EOS 5D Mark IV", 4480, 6720, "CanonEOS5D4"),
    "canon_70d": ("Canon EOS 70D", 3648, 5472, "CanonEOS70D"),
    "canon_700d": ("Canon EOS 700D", 3456, 5184, "CanonEOS700D"),
    "nikon_d850": ("Nikon D850", 5504, 8256, "NikonD850"),
    "sony_a7s2": ("Sony alpha 7S II", 2832, 4240, "SonyA7S2"),
}
CAMERAS = {f"{stem}_iso{100 * 2**stops}": (*body, stops) for stem, body in BODIES.items() for stops in STOPS}

TEMPLATE = """\
# Made by scripts/make_photographic_cameras.py, which tells how each figure follows from the published fits.
# The fits name no ISO: {iso} takes Kmin = {kmin:.4f} DN/e- for 100, and 0 dB is this ISO.
# Fixed patterns and dark current are not in the fits and are assumed, see docs/cameras.md.
name: {name}, ISO {iso}
source:
  resolution: the maker's specification, pixels of the raw image
  bit_depth: ELD, raw values of 14 bit
  gain_e_per_dn: ELD, K = {times} Kmin = {k:.4f} DN/e- of 14 bit
  black_level_dn: ELD, noise.py takes 16383 - 800 DN from black to white
  read_noise: ELD, G_scale at this K ({scale:.3f} DN) times the unit law's deviation ({unit:.4f}); G_shape
  row_noise: ELD, R_scale at this K ({row_dn:.3f} DN)
  colour.white_balance: daylight (D65), by dcraw's relation from Adobe's matrix as in LibRaw e419de0, colordata.cpp
  colour.matrix: the same
  ELD: https://github.com/Vandermode/ELD at 53d5408, and K. Wei et al., IEEE TPAMI 44 (2022) 8520
assumed:
  - quantum_efficiency            # not in the fits, which count electrons
  - prnu.column                   # the paper: 0.1 to 1 % for each part where it is not known
  - prnu.row
  - prnu.pixel
  - dsnu.column_e                 # usual for a pinned photodiode
  - dsnu.row_e
  - dsnu.pixel_e
  - dark_current.reference_e_per_s
  - dark_current.reference_temperature_c
  - dark_current.doubling_c
  - colour.cfa                    # the first pixel of the raw image may be another
  - colour.demosaic
licence: MIT, Copyright (c) 2020 Kaixuan Wei (the fitted parameters)
resolution: [{rows}, {columns}]
bit_depth: 14
quantum_efficiency: 0.5
gain_e_per_dn: {gain:.5f}
black_level_dn: 800
read_noise: {{sigma_e: {sigma:.3f}, shape: {shape:.4f}}}
prnu: {{column: 0.001, row: 0.001, pixel: 0.006}}
dsnu: {{column_e: 0.2, row_e: 0.1, pixel_e: 0.5}}
dark_current: {{reference_e_per_s: 1, reference_temperature_c: 25, doubling_c: 7}}
colour:
  cfa: RGGB
  white_balance: {balance}
  matrix: {matrix}
  demosaic: malvar
effects:
  - {{name: row_noise, sigma_e: {row:.4f}}}
randomize:
  gain_db: {{std: 1.0}}           # a third of a stop: the read noise in electrons is that of one gain
  read_noise.sigma_e: {spread:.2f}        # scatter of the fits about their line
  read_noise.shape: {{std: 0.05}}   # scatter of the fitted shapes
  row_noise.sigma_e: {row_spread:.2f}
  prnu.column: 0.3
  prnu.row: 0.3
  prnu.pixel: 0.3
  dsnu.column_e: 0.3
  dsnu.row_e: 0.3
  dsnu.pixel_e: 0.3
"""


def colour(xyz_to_camera: tuple[int, ...]) -> tuple[list[float], list[list[float]]]:
    """White balance and colour matrix, rounded, from a published matrix times 10000."""
    camera_of_rgb = np.array(xyz_to_camera).reshape(3, 3) / 1e4 @ SRGB_TO_XYZ
    sums = camera_of_rgb.sum(1)
    balance = sums[1] / sums
    matrix = np.linalg.inv(camera_of_rgb / sums[:, None])
    return balance.round(4).tolist(), matrix.round(4).tolist()


def camera_file(fit: dict, stem: str, name: str, rows: int, columns: int, stops: int) -> str:
    """The text of a camera.yaml from one camera's published fits, so many stops above its lowest gain."""
    k = fit["Kmin"] * 2**stops
    lines = fit["Profile-1"]

    def at_k(law: str) -> float:
        return math.exp(lines[law]["slope"] * math.log(k) + lines[law]["bias"])

    shape = sum(fit["G_shape"][2 * stops : 2 * stops + 2]) / 2
    unit = float(tukeylambda.std(shape))
    balance, matrix = colour(XYZ_TO_CAMERA[stem])
    return TEMPLATE.format(
        balance=balance, matrix=matrix,
        name=name, iso=100 * 2**stops, times=2**stops, rows=rows, columns=columns,
        kmin=fit["Kmin"], k=k, gain=1 / k, shape=shape, unit=unit,
        scale=at_k("G_scale"), sigma=at_k("G_scale") * unit / k, spread=lines["G_scale"]["sigma"],
        row_dn=at_k("R_scale"), row=at_k("R_scale") / k, row_spread=lines["R_scale"]["sigma"],
    )  # fmt: skip


def main(source: Path, target: Path) -> None:
    for stem, (name, rows, columns, fit, stops) in CAMERAS.items():
        content = json.loads((source / f"{fit}_params.json").read_text())
        write_text(target / f"{stem}.yaml", camera_file(content, fit, name, rows, columns, stops))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
