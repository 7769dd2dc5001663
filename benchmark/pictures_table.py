"""Effective cameras found from pictures of known cameras, as a table for docs/target_studies.md."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from . import pictures

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
BEGIN, END = "<!-- table of python -m benchmark pictures -->", "<!-- end of table -->"


COLUMNS = (
    "camera", "content", "tone", "file", "gain", "found (e-/DN)", "read", "found (e-)", "row", "found (e-)",
    "columns", "found (e-)",
)  # fmt: skip


def characterized(folder: Path) -> dict[str, Any]:
    """The parameters that `visaug characterize` finds in a folder of pictures."""
    with tempfile.TemporaryDirectory() as scratch:
        told = Path(scratch) / "found.json"
        command = [sys.executable, "-m", "visaug", "characterize", str(folder), "--json", str(told)]
        subprocess.run([*command, "-o", str(Path(scratch) / "camera.yaml")], check=True, capture_output=True)
        return json.loads(told.read_text())["parameters"]


def row(
    camera: pictures.PictureCamera, content: str, tone: str, quality: int | None, count: int
) -> list[str]:
    """One line of the table: the camera, what it took, and each true parameter beside the one that was found."""
    rng = np.random.default_rng(round(camera.gain_e_per_dn))
    scenes = [getattr(pictures, content)(rng) for _ in range(count)]
    with tempfile.TemporaryDirectory() as folder:
        taken = pictures.take(camera, scenes, 3, tone)
        found = characterized(pictures.save(taken, Path(folder), quality))
    file = f"JPEG {quality}" if quality else "PNG"
    cells = [camera.name, content, "gamma 2.2" if tone == "gamma" else tone, file]
    for name, true in (
        ("gain_e_per_dn", camera.gain_e_per_dn),
        ("read_noise.sigma_e", camera.read_e),
        ("row_noise.sigma_e", camera.row_e),
        ("dsnu.column_e", camera.column_fixed_e),
    ):
        one = found.get(name)
        cells.append(f"{true:g}")
        cells.append(f"{one['value']:.3g} [{one['low']:.3g}, {one['high']:.3g}]" if one else "not determined")
    return cells


def write(count: int, cases: int, page: Path | None) -> None:
    """Print the table; put it between the marks of a page where one is given."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + " --- |" * len(COLUMNS)]
    for content, tone, quality in CASES[:cases]:
        for camera in pictures.CAMERAS:
            lines.append("| " + " | ".join(row(camera, content, tone, quality, count)) + " |")
            print(lines[-1], flush=True)
    if page:
        table = "\n".join([BEGIN, "", *lines, "", END])
        page.write_text(re.sub(f"{BEGIN}.*{END}", lambda _: table, page.read_text(), flags=re.DOTALL))
