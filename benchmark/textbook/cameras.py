"""Five sensors as a data sheet would state them, and the frames that are taken with each."""

from __future__ import annotations

from dataclasses import dataclass

from ..camera import Sensor, Shot


@dataclass(frozen=True)
class Camera(Sensor):
    """A sensor, with what its dark ladder and its cosmic rays need.

    `dark_s` and `dark_c` are the exposures and temperatures of the dark frames; `pitch_um` and `depth_um` the size of a
    pixel and the depth that collects charge.
    """

    dark_s: tuple[float, ...]
    dark_c: tuple[float, ...]
    pitch_um: float
    depth_um: float


CAMERAS: tuple[Camera, ...] = (
    Camera(
        name="CMOS, 12 bit", rows=120, columns=160, bits=12, efficiency=0.62, e_per_dn=2.75, pedestal_dn=96,
        well_e=10400.0, integration_s=0.01, celsius=20, read_e=2.9, tail=-0.12, dark_e_per_s=0.21,
        dark_per_c=0.115, prnu=(0.0021, 0.0014, 0.0072), dsnu_e=(0.9, 0.45, 1.3), dark_s=(0.1, 0.5, 2.0),
        dark_c=(20, 32), pitch_um=4.8, depth_um=6.0,
    ),
    Camera(
        name="CCD, 16 bit", rows=160, columns=200, bits=16, efficiency=0.81, e_per_dn=1.12, pedestal_dn=1040,
        well_e=64000.0, integration_s=0.05, celsius=5, read_e=6.2, tail=0.11, dark_e_per_s=0.35,
        dark_per_c=0.095, prnu=(0.0008, 0.0006, 0.0051), dsnu_e=(0.5, 0.35, 0.9), dark_s=(0.5, 4.0, 20.0),
        dark_c=(5, 18), pitch_um=7.4, depth_um=9.0,
    ),
    Camera(
        name="CMOS, 10 bit, coarse steps, heavy tails", rows=128, columns=192, bits=10, efficiency=0.55,
        e_per_dn=5.9, pedestal_dn=44, well_e=5400.0, integration_s=0.008, celsius=25, read_e=5.4, tail=-0.2,
        dark_e_per_s=0.45, dark_per_c=0.1, prnu=(0.0034, 0.0022, 0.0098), dsnu_e=(2.1, 0.9, 2.4),
        dark_s=(0.1, 0.6, 2.5), dark_c=(25, 38), pitch_um=3.45, depth_um=5.0,
    ),
    Camera(
        name="CCD, 14 bit", rows=200, columns=256, bits=14, efficiency=0.7, e_per_dn=2.95, pedestal_dn=310,
        well_e=44000.0, integration_s=0.02, celsius=10, read_e=11.6, tail=0.14, dark_e_per_s=1.1,
        dark_per_c=0.09, prnu=(0.0011, 0.0007, 0.0063), dsnu_e=(1.2, 1.0, 2.2), dark_s=(0.4, 2.0, 10.0),
        dark_c=(10, 22), pitch_um=9.0, depth_um=12.0,
    ),
    Camera(
        name="scientific CMOS, 16 bit", rows=96, columns=128, bits=16, efficiency=0.78, e_per_dn=0.47,
        pedestal_dn=105, well_e=29500.0, integration_s=0.01, celsius=0, read_e=1.55, tail=-0.16,
        dark_e_per_s=0.32, dark_per_c=0.11, prnu=(0.0026, 0.0009, 0.0041), dsnu_e=(0.5, 0.2, 0.7),
        dark_s=(0.5, 3.0, 12.0), dark_c=(0, 14), pitch_um=6.5, depth_um=6.0,
    ),
)  # fmt: skip

FLAT_LEVELS = (0.004, 0.015, 0.05, 0.15, 0.35, 0.6, 0.8, 0.94)  # of the full well
SCENES = ("chart", "chart", "scene", "scene", "spot", "spot")


def plan(camera: Camera) -> tuple[Shot, ...]:
    """70 frames: bias, a dark ladder at two temperatures, flats to near full well, scenes each followed by a dark frame."""
    shots = [Shot("bias", 1e-5, camera.celsius)] * 16
    for celsius in camera.dark_c:
        for seconds in camera.dark_s:
            shots += [Shot("dark", seconds, celsius)] * 3
    for level in FLAT_LEVELS:
        photons = float(f"{level * (camera.well_e / camera.efficiency):.3g}")
        shots += [Shot("flat", camera.integration_s, camera.celsius, photons=photons)] * 3
    for target in SCENES:
        shots.append(Shot("scene", camera.integration_s, camera.celsius, target=target))
        shots.append(Shot("dark", camera.integration_s, camera.celsius))
    return tuple(shots)
