"""The `emva1288` package and ours on the same frames of a real CCD, beside the published figures.

    python scripts/emva_oracle.py ../shared/data/emva1288_ccd12 --page docs/characterization.md

The package (GPL, by the EMVA1288 authors) needs NumPy 1, so it gets an environment of its own, `.venv-emva1288`,
made at the first call, and runs in a process of its own: nothing of it is imported here.
"""

import argparse
import json
import subprocess
import sys
import venv
import xml.etree.ElementTree as ET
from pathlib import Path

from visaug.characterization import characterize
from visaug.core.files import write_text
from visaug.frames import FrameSet

ENVIRONMENT = Path(__file__).parents[1] / ".venv-emva1288"
REQUIREMENTS = ("emva1288==1.0.2", "numpy<2")
START, END = "<!-- oracle: made by scripts/emva_oracle.py -->", "<!-- end of oracle -->"

# Our figure, the package's, what its figure is to be multiplied by, and the unit.
FIGURES = (
    ("system_gain_dn_per_e", "K", 1.0, "DN/e-"),
    ("quantum_efficiency", "QE", 0.01, "e-/photon"),
    ("dark_noise_e", "sigma_d", 1.0, "e-"),
    ("dark_noise_dn", "sigma_y_dark", 1.0, "DN"),
    ("saturation_photons", "u_p_sat", 1.0, "photons"),
    ("saturation_e", "u_e_sat", 1.0, "e-"),
    ("dsnu_e", "DSNU1288", 1.0, "e-"),
    ("dsnu_dn", "DSNU1288_DN", 1.0, "DN"),
    ("prnu_fraction", "PRNU1288", 0.01, "fraction"),
    ("linearity_error_min", "LE_min", 0.01, "fraction"),
    ("linearity_error_max", "LE_max", 0.01, "fraction"),
    ("dark_current_mean_e_per_s", "u_I_mean", 1.0, "e-/s"),
    ("dark_current_variance_e_per_s", "u_I_var", 1.0, "e-/s"),
)

ITS_SIDE = """
import json, logging, os, sys
from emva1288.process import Data1288, LoadImageData, ParseEmvaDescriptorFile, Results1288
folder, names = sys.argv[1], sys.argv[2:]
quiet = {"loglevel": logging.ERROR}
parser = ParseEmvaDescriptorFile(os.path.join(folder, "EMVA1288_Data.txt"), path=folder, **quiet)
data = Data1288(LoadImageData(parser.images, **quiet).data, **quiet)
results = Results1288(data.data, **quiet)
found = {name: getattr(results, name) for name in names}
print(json.dumps({name: float(value() if callable(value) else value) for name, value in found.items()}))
"""


def its_figures(folder: Path) -> dict[str, float]:
    """What the package finds, by its own names."""
    python = ENVIRONMENT / "bin" / "python"
    if not python.exists():
        venv.create(ENVIRONMENT, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "-q", *REQUIREMENTS], check=True)
    names = [name for _, name, _, _ in FIGURES]
    command = [python, "-c", ITS_SIDE, folder.resolve(), *names]
    return json.loads(
        subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()[-1]
    )


def published_figures(folder: Path) -> dict[str, float]:
    """Those of the example in the package's documentation, by its names."""
    sections = ET.parse(folder / "published_reference_results.xml").getroot()
    values = {figure.tag: figure.findtext("Value") for section in sections for figure in section}
    figures = {name: float(value) for name, value in values.items() if value}
    return figures | {"u_I_var": figures["u_I_var"] ** 2}  # an older version printed the root of it


def table(folder: Path) -> str:
    found, theirs, published = (
        characterize(FrameSet.load(folder)),
        its_figures(folder),
        published_figures(folder),
    )
    rows = ["| figure | ours, 95 % interval | `emva1288` | published | ours / `emva1288` | unit |"]
    rows.append("| --- | --- | --- | --- | --- | --- |")
    for key, name, scale, unit in FIGURES:
        ours, its = found[f"emva.{key}"], theirs[name] * scale
        rows.append(
            f"| `emva.{key}` | {ours.value:.5g} ({ours.low:.4g} to {ours.high:.4g}) | {its:.5g} | "
            f"{published[name] * scale:.5g} | {ours.value / its:.4f} | {unit} |"
        )
    return "\n".join(rows)


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("frames", type=Path, help="folder with EMVA1288_Data.txt and the published figures")
    parser.add_argument(
        "--page", type=Path, help="page whose marked part the table replaces; else it is printed"
    )
    args = parser.parse_args(arguments)
    made = table(args.frames)
    if not args.page:
        print(made)
        return
    before, rest = args.page.read_text().split(START)
    write_text(args.page, f"{before}{START}\n{made}\n{END}{rest.split(END)[1]}")


if __name__ == "__main__":
    main(sys.argv[1:])
