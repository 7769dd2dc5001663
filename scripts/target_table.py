"""Effective cameras found from pictures of independent cameras, as a table for docs/target.md.

python scripts/target_table.py [--update docs/target.md]
"""

import argparse
import re
import tempfile
from pathlib import Path

import numpy as np
from independent import pictures

import visaug

CASES = [
    ("spacecraft", "linear", None),
    ("natural", "gamma", 95),
    ("natural", "linear", None),
    ("spacecraft", "gamma", 95),
    ("spacecraft", "linear", 95),
    ("natural", "linear", 95),
    ("spacecraft", "gamma", None),
    ("natural", "gamma", None),
]
BEGIN, END = "<!-- table of target_table.py -->", "<!-- end of table -->"


def row(
    camera: pictures.PictureCamera, content: str, tone: str, quality: int | None, count: int
) -> list[str]:
    rng = np.random.default_rng(round(camera.gain_e_per_dn))
    scenes = [getattr(pictures, content)(rng) for _ in range(count)]
    with tempfile.TemporaryDirectory() as folder:
        taken = pictures.take(camera, scenes, 3, tone)
        found = visaug.characterize(visaug.FrameSet.load(pictures.save(taken, Path(folder), quality)))
    cells = [
        camera.name,
        content,
        "gamma 2.2" if tone == "gamma" else tone,
        f"JPEG {quality}" if quality else "PNG",
    ]
    for name, true in (
        ("gain_e_per_dn", camera.gain_e_per_dn),
        ("read_noise.sigma_e", camera.read_e),
        ("row_noise.sigma_e", camera.row_e),
        ("dsnu.column_e", camera.column_fixed_e),
    ):
        value = found.parameters.get(name)
        cells.append(f"{true:g}")
        cells.append(
            "not determined" if value is None else f"{value.value:.3g} [{value.low:.3g}, {value.high:.3g}]"
        )
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--update", type=Path)
    parser.add_argument("--pictures", type=int, default=40)
    parser.add_argument(
        "--cases", type=int, default=len(CASES), help="how many of the pairs of scenes and files"
    )
    options = parser.parse_args()
    head = [
        "camera",
        "content",
        "tone",
        "file",
        "gain",
        "found (e-/DN)",
        "read",
        "found (e-)",
        "row",
        "found (e-)",
        "columns",
        "found (e-)",
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for content, tone, quality in CASES[: options.cases]:
        for camera in pictures.CAMERAS:
            lines.append("| " + " | ".join(row(camera, content, tone, quality, options.pictures)) + " |")
            print(lines[-1], flush=True)
    if options.update:
        text = options.update.read_text()
        table = "\n".join([BEGIN, "", *lines, "", END])
        options.update.write_text(re.sub(f"{BEGIN}.*{END}", lambda _: table, text, flags=re.DOTALL))


if __name__ == "__main__":
    main()
