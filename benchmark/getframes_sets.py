"""Frame sets taken by getframes, another author's camera (MIT): `pip install getframes==2.6.1` in an environment of its own.

Its chain: Poisson electrons of photons * QE * PRNU + dark current (doubling per so many degrees), effects on charge,
clipping at the full well, Gaussian read noise, division by e-/DN, bias with a texture of pixels, rounding. Strengths
are chosen by hand so that each effect is plain to see; forms are getframes' own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from . import cameras
from .camera import Sensor, Shot
from .sets import Recipe, write_taken

# name in visaug's catalogue -> what getframes is told
EFFECTS: dict[str, dict[str, Any]] = {
    "amplifier_glow": {"detector_glow_e_per_s": 2.0, "detector_glow_edge_scale_px": 12.0},  # from all edges
    "black_level_drift": {"readout_common_mode_noise_adu": 4.0},  # white from frame to frame
    "blooming": {"blooming": True},
    "charge_transfer_inefficiency": {"cti": 2e-5},  # one trailing pixel, in proportion to the transfers
    "clock_induced_charge": {"clock_induced_charge_e": 8.0},
    "cosmic_rays": {"cosmic_ray_rate_per_cm2_s": 1500.0, "cosmic_ray_track_length_px": 8.0},
    "dark_current_nonuniformity": {"dark_current_nonuniformity": 0.5},  # log-normal
    "dead_pixels": {"dead_pixel_fraction": 0.002},
    "fixed_pattern_structure": {"bias_structure_amplitude_adu": 12.0},  # a plane, and columns
    "hot_pixels": {"hot_pixel_fraction": 0.002, "hot_pixel_factor": 100.0},  # all alike
    "image_lag": {"persistence_fraction": 0.01, "persistence_decay": 0.6},  # of the mean; none is taken away
    "interpixel_crosstalk": {"ipc_coupling": 0.008},
    "nonlinearity": {"nonlinearity": 0.03},
    "tap_mismatch": {
        "amplifier_layout": (1, 2), "amplifier_gain_factors": (1.0, 1.01), "amplifier_offsets_adu": (0.0, 4.0)
    },
}  # fmt: skip


# getframes moves this charge before it clips at the full well: a spot of twelve full wells would leave trails that no well holds
BELOW_THE_WELL = ("charge_transfer_inefficiency", "interpixel_crosstalk")


def sensor_of(camera: int) -> Sensor:
    """One of the ten with what getframes has: PRNU and offsets of pixels, Gaussian read noise."""
    s = cameras.sensor(camera)
    return replace(s, tail=0.14, prnu=(0.0, 0.0, s.prnu[2]), dsnu_e=(0.0, 0.0, s.dsnu_e[2]))


def configuration(sensor: Sensor, seed: int, **hidden: Any) -> Any:
    """getframes' description of a sensor. Dark current is quoted at 0 C, as ours is."""
    from getframes import CameraConfig

    return CameraConfig(
        name=sensor.name,
        sensor_type="CMOS",
        resolution=sensor.shape,
        pixel_size_um=5.0,
        quantum_efficiency=sensor.efficiency,
        full_well_e=sensor.well_e,
        bit_depth=sensor.bits,
        gain_e_per_adu=sensor.e_per_dn,
        bias_offset_adu=sensor.pedestal_dn,
        read_noise_e=sensor.read_e,
        dark_current_e_per_s=sensor.dark_e_per_s,
        dark_current_ref_temp_c=0.0,
        dark_current_doubling_temp_c=math.log(2) / sensor.dark_per_c,
        prnu=sensor.prnu[2],
        bias_pixel_spread_adu=sensor.dsnu_e[2] / sensor.e_per_dn,
        fixed_pattern_seed=seed,
        **hidden,
    )


def taken(sensor: Sensor, plan: tuple[Shot, ...], targets: dict[str, np.ndarray], configured: Any, seed: int):
    """(frames, rows, columns) in the order of the plan; charge that persists goes from frame to frame."""
    from getframes import Camera

    camera = Camera(configured)
    frames, latent = [], np.zeros(sensor.shape)
    for i, shot in enumerate(plan):
        photons = targets[shot.target] if shot.target else np.full(sensor.shape, shot.photons or 0.0)
        released = configured.persistence_decay * latent if configured.persistence_fraction else 0.0
        frame = camera.expose(
            photons / shot.seconds, shot.seconds, shot.celsius, extra_electrons=released, seed=1000 * seed + i
        )
        if configured.persistence_fraction:
            held = np.minimum(photons * sensor.efficiency, sensor.well_e)
            latent = latent - released + configured.persistence_fraction * held
        frames.append(np.asarray(frame.data).astype(np.uint16))
    return np.array(frames)


def recipes(seed: int, camera: int) -> Iterator[tuple[Recipe, dict[str, Any]]]:
    """Nothing hidden, then every effect alone, each with what getframes is told."""
    yield Recipe(f"getframes-nothing-{seed}", "getframes", "none", seed, camera), {}
    for name, told in EFFECTS.items():
        identity = f"getframes-{name}-{seed}"
        yield Recipe(identity, "getframes", "strong", seed, camera, expect=(name,)), told


def write_sets(seed: int, camera: int, wanted: set[str] | None, folder: Path, answers: Path) -> int:
    """One set for each recipe; the count."""
    sensor, plan, targets = sensor_of(camera), cameras.plan(camera), cameras.targets(camera)
    made = 0
    for recipe, told in recipes(seed, camera):
        if wanted and not wanted & set(recipe.expect):
            continue
        most = 0.9 * sensor.well_e / sensor.efficiency if set(recipe.expect) & set(BELOW_THE_WELL) else np.inf
        lit = {name: np.minimum(target, most) for name, target in targets.items()}
        frames = taken(sensor, plan, lit, configuration(sensor, seed, **told), seed)
        write_taken(recipe, frames, plan, lit, sensor, folder, answers)
        made += 1
    return made
