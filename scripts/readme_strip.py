"""Make the README's picture of noise: python scripts/readme_strip.py docs/pictures/noise_strip.png

The middle of the example picture at 4x zoom, nearest neighbour: clean, and by a Sony IMX174 under three conditions.
Two by two, with large words, so that a telephone shows it.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

import visaug

ZOOM, ROWS, COLUMNS, GAP, HEAD = (
    4,
    84,
    104,
    12,
    44,
)  # ROWS and COLUMNS of the picture, the rest in pixels of the output
TOP, LEFT = 32, 78  # of the window: the lit corner of the body
CAMERA = "sony_imx174"
BANDING = {"amplitude_e": 25.0, "period_rows": 9.0}  # 4 times the read noise at this gain: a strong case


def main(output: Path) -> None:
    import matplotlib

    fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    font = ImageFont.truetype(str(fonts / "DejaVuSans.ttf"), 28)
    tiles = list(conditions())
    cell_w, cell_h = COLUMNS * ZOOM, ROWS * ZOOM
    sheet = Image.new("RGB", (2 * cell_w + 3 * GAP, 2 * (cell_h + HEAD) + 2 * GAP), "white")
    words = ImageDraw.Draw(sheet)
    for number, (name, pixels) in enumerate(tiles):
        left = GAP + number % 2 * (cell_w + GAP)
        top = number // 2 * (cell_h + HEAD + GAP)
        words.text((left, top + 5), name, "#1c2430", font)
        tile = Image.fromarray(pixels).resize((cell_w, cell_h), Image.Resampling.NEAREST)
        sheet.paste(tile.convert("RGB"), (left, top + HEAD))
    sheet.save(output, optimize=True)


def conditions():
    """Name and (ROWS, COLUMNS) uint8 of each tile."""
    picture = np.asarray(Image.open(visaug.data.example_picture()))
    window = slice(TOP, TOP + ROWS), slice(LEFT, LEFT + COLUMNS)
    yield "clean render", picture[window]
    camera = visaug.Camera.load(CAMERA)
    banded = camera.with_effect("periodic_banding", **BANDING)
    for name, one, options in (
        ("IMX174, gain 24 dB", camera, {"gain_db": 24}),
        ("and a tenth of the light", camera, {"gain_db": 24, "exposure": 0.1}),
        ("24 dB and banding", banded, {"gain_db": 24}),
    ):
        torch.manual_seed(0)
        noise = visaug.VISNoise(one, transfer="srgb", **options)  # pyrefly: ignore[bad-argument-type]
        light = torch.from_numpy(picture.astype(np.float32) / 255)[None, None]
        yield name, (noise(light)[0, 0] * 255).round().byte().numpy()[window]


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
