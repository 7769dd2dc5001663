"""Frame sets taken by ESA's Pyxel: `pip install pyxel-sim==3.0.2` in an environment of its own.

Its models are called in the order of a CMOS pipeline: Poisson photons, binomial QE, dark current, collection, a map of
the pixels' response, full well, volts, Gaussian noise, an offset, amplification, an ADC that truncates (hence the half
DN that is added before it). Left out is what was found wrong in it: the noise of `output_node_noise_cmos` (doubles the
signal) and the random factor of its dark current. Strengths are chosen by hand so that each effect is plain to see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from . import cameras
from .camera import Sensor, Shot
from .randomness import stream
from .sets import Recipe, write_taken

VOLT_PER_E = 1e-5
OUTSIDE = "crosstalk_of_channels"  # what bright pixels of one half do to the other: in no catalogue


def sensor_of(camera: int) -> Sensor:
    """One of the ten with what these models have: PRNU of pixels, Gaussian read noise, no offsets of pixels."""
    s = cameras.sensor(camera)
    return replace(s, tail=0.14, prnu=(0.0, 0.0, s.prnu[2]), dsnu_e=(0.0, 0.0, 0.0))


def detector_of(sensor: Sensor, ccd: bool, halves: bool, gains: Any) -> Any:
    """Pyxel's description of a sensor; `halves` reads the left and the right half by channels of their own."""
    from pyxel.detectors import (
        CCD,
        CMOS,
        CCDGeometry,
        Channels,
        Characteristics,
        CMOSCharacteristics,
        CMOSGeometry,
        Environment,
        Matrix,
        ReadoutPosition,
    )
    from pyxel.detectors.charge_to_volt_settings import ChargeToVoltSettings

    sides = ReadoutPosition({"left": "top-left", "right": "top-right"})
    size = {
        "row": sensor.rows,
        "col": sensor.columns,
        "total_thickness": 10.0,
        "pixel_vert_size": 5.0,
        "pixel_horz_size": 5.0,
        "channels": Channels(matrix=Matrix([["left", "right"]]), readout_position=sides) if halves else None,
    }
    volts = {
        "quantum_efficiency": sensor.efficiency,
        "charge_to_volt": ChargeToVoltSettings(value=VOLT_PER_E),
        "pre_amplification": gains,
        "full_well_capacity": sensor.well_e,
        "adc_bit_resolution": sensor.bits,
        "adc_voltage_range": (0.0, (2**sensor.bits - 1) * sensor.e_per_dn * VOLT_PER_E),
    }
    place = Environment(temperature=273.15 + sensor.celsius)
    if ccd:
        return CCD(CCDGeometry(**size), place, Characteristics(**volts))
    return CMOS(CMOSGeometry(**size), place, CMOSCharacteristics(**volts))


class Hidden:
    """What an effect does at two places of the pipeline; nothing unless a method is set."""

    def __init__(
        self,
        pixel: Callable[[Any, int], None] | None = None,
        volt: Callable[[Any, int], None] | None = None,
        ccd: bool = False,
        halves: bool = False,
        gains: Any = 1.0,
    ):
        self.pixel, self.volt = pixel, volt
        self.ccd, self.halves, self.gains = ccd, halves, gains


def hidden_effects(sensor: Sensor) -> dict[str, Hidden]:
    """Name in visaug's catalogue, or of what it does not have -> Pyxel's models."""
    from pyxel.models import charge_collection, charge_measurement, charge_transfer

    full_v = sensor.well_e * VOLT_PER_E

    def lag(detector: Any, _: int) -> None:
        charge_collection.simple_persistence(
            detector, trap_time_constants=[0.03, 0.3], trap_densities=[0.01, 0.01]
        )

    def traps(detector: Any, _: int) -> None:
        charge_transfer.cdm(
            detector, direction="parallel", beta=0.3, trap_release_times=[3e-3], trap_densities=[2e10],
            sigma=[1e-15], max_electron_volume=1.6e-10, transfer_period=9.4722e-4,
        )  # fmt: skip

    return {
        "charge_transfer_inefficiency": Hidden(pixel=traps, ccd=True),
        "flicker_noise": Hidden(
            volt=lambda d, seed: charge_measurement.uncorrelated_pink_noise_cmos(d, std=1.5, seed=seed)
        ),
        "image_lag": Hidden(pixel=lag),
        "interpixel_crosstalk": Hidden(
            volt=lambda d, _: charge_measurement.simple_ipc(d, coupling=0.008, diagonal_coupling=0.002)
        ),
        "nonlinearity": Hidden(
            volt=lambda d, _: charge_measurement.output_node_linearity_poly(
                d, coefficients=[0.0, 1.0, -0.03 / full_v]
            )
        ),
        "tap_mismatch": Hidden(halves=True, gains={"left": 1.0, "right": 1.01}),
        OUTSIDE: Hidden(
            volt=lambda d, _: charge_measurement.dc_crosstalk(d, coupling_matrix=[[1.0, 0.01], [0.01, 1.0]]),
            halves=True,
        ),
    }


def taken(
    sensor: Sensor, plan: tuple[Shot, ...], targets: dict[str, np.ndarray], hidden: Hidden, seed: int
) -> np.ndarray:
    """(frames, rows, columns) in the order of the plan; the detector remembers what it should."""
    from pyxel.models import (
        charge_collection,
        charge_generation,
        charge_measurement,
        photon_collection,
        readout_electronics,
    )

    detector = detector_of(sensor, hidden.ccd, hidden.halves, hidden.gains)
    detector.set_readout(times=[1.0])
    response = 1 + sensor.prnu[2] * stream(seed, "response").standard_normal(sensor.shape)
    frames = []
    for i, shot in enumerate(plan):
        number = 1000 * seed + 10 * i
        detector.empty()
        detector.time_step = shot.seconds
        photons = targets[shot.target] if shot.target else np.full(sensor.shape, shot.photons or 0.0)
        detector.photon.array = photons.astype(float)
        photon_collection.shot_noise(detector, seed=number)
        charge_generation.simple_conversion(detector, seed=number + 1)
        rate = sensor.thermal_e(1.0, shot.celsius)
        charge_generation.simple_dark_current(detector, dark_rate=rate, seed=number + 2)
        charge_collection.simple_collection(detector)
        detector.pixel.array = detector.pixel.array * response
        charge_collection.simple_full_well(detector)
        if hidden.pixel:
            hidden.pixel(detector, number + 3)
        charge_measurement.simple_measurement(detector)
        if hidden.volt:
            hidden.volt(detector, number + 4)
        charge_measurement.output_node_noise(
            detector, std_deviation=sensor.read_e * VOLT_PER_E, seed=number + 5
        )
        readout_electronics.simple_amplifier(detector)
        offset = (sensor.pedestal_dn + 0.5) * sensor.e_per_dn * VOLT_PER_E
        charge_measurement.dc_offset(detector, offset=offset)
        readout_electronics.simple_adc(detector, data_type="uint16")
        frames.append(np.array(detector.image.array, np.uint16))
    return np.array(frames)


def recipes(seed: int, camera: int) -> Iterator[tuple[Recipe, Hidden]]:
    """Nothing hidden, then every effect alone."""
    yield Recipe(f"pyxel-nothing-{seed}", "pyxel", "none", seed, camera), Hidden()
    for name, hidden in hidden_effects(sensor_of(camera)).items():
        recipe = Recipe(f"pyxel-{name}-{seed}", "pyxel", "strong", seed, camera, expect=(name,))
        if name == OUTSIDE:
            seen = {"axis": ("column", "pixel", "smooth"), "grows": ("signal",), "may_grow": ("exposure",)}
            recipe = replace(recipe, kind="foreign", **seen)
        yield recipe, hidden


def write_sets(seed: int, camera: int, wanted: set[str] | None, folder: Path, answers: Path) -> int:
    """One set for each recipe; the count."""
    sensor, plan, targets = sensor_of(camera), cameras.plan(camera), cameras.targets(camera)
    made = 0
    for recipe, hidden in recipes(seed, camera):
        if wanted and not wanted & {recipe.identity.split("-")[1]}:
            continue
        frames = taken(sensor, plan, targets, hidden, seed)
        write_taken(recipe, frames, plan, targets, sensor, folder, answers)
        made += 1
    return made
