"""Make the pictures of the README: python scripts/readme_pictures.py docs/pictures"""

import sys
from pathlib import Path

from visaug.camera.simulation import simulate
from visaug.report.html import figure
from visaug.report.plots import sensor
from visaug.report.real_camera import load_real_camera, sensor_curves


def main(folder: Path) -> None:
    camera, frames = load_real_camera()
    measured = sensor_curves(frames)
    modelled = sensor_curves(simulate(camera, frames, seed=0))
    pictures = {
        "photon_transfer": sensor.plot_photon_transfer(measured, modelled),
        "row_spectrum": sensor.plot_row_spectrum(measured, modelled),
    }
    for name, drawn in pictures.items():
        print(figure(drawn, name, raster=True).save(folder / name))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
