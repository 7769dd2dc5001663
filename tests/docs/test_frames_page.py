"""Every snippet of docs/frames.md runs on frames of the kind that it is written for."""

import re
from pathlib import Path

import numpy as np
import pytest
import tifffile
from astropy.io import fits

from visaug.app.cli import main
from visaug.frames.table import COLUMNS, FURTHER

PAGE = (Path(__file__).parents[2] / "docs" / "frames.md").read_text()
SHAPE = (32, 48)


def section(heading):
    return PAGE.split(f"### {heading}")[1].split("\n### ")[0]


def shot(rng, photons=0.0, dark_e=0.0):
    """12 bits, 0.5 DN/e-, read noise of 4 e-, black level of 100 DN."""
    electrons = rng.poisson(0.6 * photons + dark_e, SHAPE) + 4 * rng.standard_normal(SHAPE)
    return np.clip(np.rint(100 + 0.5 * electrons), 0, 4095).astype(np.uint16)


def set_of(rng):
    """Name and pixels of bias, dark and flat frames."""
    made = [(f"bias/{i}", shot(rng)) for i in range(6)]
    made += [(f"darks/{t}s_{i}", shot(rng, dark_e=5.0 * t)) for t in (1, 2, 4) for i in range(2)]
    return made + [(f"flats/{t}ms_{i}", shot(rng, 100.0 * t)) for t in (5, 20, 40, 60) for i in range(2)]


def machine_vision(rng):
    for name, pixels in set_of(rng):
        path = Path("tiff") / f"{name}.tif"
        path.parent.mkdir(parents=True, exist_ok=True)
        tifffile.imwrite(path, pixels, photometric="minisblack")


def observatory(rng):
    Path("night").mkdir()
    for n, (name, pixels) in enumerate(set_of(rng)):
        kind, rest = name.split("/")
        exposure = (
            0.0
            if kind == "bias"
            else float(rest.split("_")[0].rstrip("ms")) / (1 if kind == "darks" else 1e3)
        )
        header = fits.Header(
            {
                "IMAGETYP": {"bias": "Bias", "darks": "Dark", "flats": "Flat"}[kind] + " Frame",
                "EXPTIME": exposure,
                "GAIN": 100,
            }
        )
        header["DATE-OBS"] = f"2026-03-01T00:00:{n:02d}"
        fits.PrimaryHDU(pixels, header).writeto(f"night/{n:03d}.fits")


def emva(rng):
    lines = [f"n 12 {SHAPE[1]} {SHAPE[0]}"]
    Path("emva").mkdir()
    for photons in (None, 100, 1000, 3000, 6000, 9000, 12000, 14000):
        lines.append("d 1000000" if photons is None else f"b 1000000 {photons}")
        for i in range(4 if photons is None else 2):
            name = f"{photons}_{i}.tif"
            tifffile.imwrite(f"emva/{name}", shot(rng, photons or 0.0), photometric="minisblack")
            lines.append(f"i {name}")
    Path("emva/EMVA1288_Data.txt").write_text("\n".join(lines))


def microscopy(rng):
    frames = set_of(rng)
    Path("scmos").mkdir()
    for group in dict.fromkeys(name.rsplit("_", 1)[0] if "_" in name else "bias" for name, _ in frames):
        stack = np.stack([pixels for name, pixels in frames if name.startswith(group)])
        tifffile.imwrite(f"scmos/{group.replace('/', '_')}.tif", stack, photometric="minisblack")


def photography(rng):
    pytest.importorskip("rawpy")
    from tests.frames.test_survey import dng

    Path("dslr").mkdir()
    for i in range(2):
        dng(Path(f"dslr/bias_{i}.dng"), rng.integers(500, 600, (64, 96), dtype=np.uint16))
        dng(Path(f"dslr/flat_{i}.dng"), rng.integers(5000, 6000, (64, 96), dtype=np.uint16))


def arrays(_):
    """The page's own Python makes them."""


LABORATORIES = {
    "Machine vision: folders of TIFF": (machine_vision, ["tiff/frames.csv", "machine_vision.yaml"]),
    "An observatory: FITS with headers": (observatory, ["telescope.yaml"]),
    "An EMVA 1288 laboratory: the descriptor": (emva, ["sheet.html", "sheet.json"]),
    "Microscopy: stacks of an sCMOS camera": (microscopy, ["scmos/frames.csv", "scmos.yaml", "scmos_maps"]),
    "Photography: raw files of a DSLR": (photography, ["dslr/frames.csv"]),
    "Python: arrays in npz or HDF5": (arrays, ["arrays/frames.csv"]),
}


def run(words, capsys):
    """Status of a command, and what it said."""
    status = 0
    try:
        main(words)
    except SystemExit as end:
        status = end.code
    return status, "".join(capsys.readouterr())


@pytest.mark.parametrize("heading", LABORATORIES)
def test_snippets_of_each_laboratory_run(heading, tmp_path, monkeypatch, capsys):
    make, results = LABORATORIES[heading]
    monkeypatch.chdir(tmp_path)
    make(np.random.default_rng(51))
    snippets = re.findall(r"```(bash|python)\n(.*?)```", section(heading), re.DOTALL)
    assert snippets
    for language, text in snippets:
        if language == "python":
            exec(compile(text, heading, "exec"), {})
            continue
        for line in text.strip().splitlines():
            program, *words = line.split()
            assert program == "visaug"
            status, said = run(words, capsys)
            assert status == 0, f"{line}: {said}"
            assert "not complete" not in said, line
    for result in results:
        assert (tmp_path / result).exists(), result


def test_every_column_is_explained():
    for name in (*COLUMNS, *FURTHER):
        assert f"| `{name}` |" in PAGE, name
