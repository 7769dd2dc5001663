"""The chain from photons to DN, and where in it each effect stands.

    photons -> lens -> QE, PRNU -> + dark current -> one Poisson draw -> particles, lag, brighter-fatter, blooming
            -> full well -> lag, transfer, crosstalk, nonlinearity -> + DSNU + read noise -> lines and frames
            -> / (e-/DN) -> taps -> + pedestal -> rounding, clipping -> codes
(Janesick, Photon Transfer; EMVA 1288, linear model)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..camera import Shot
from ..randomness import tukey_lambda
from . import charge, digital, optics, readout, unknown, wells
from .cameras import Camera
from .effect import Effect, Moment, Numbers
from .randomness import poisson

LIGHT: dict[str, type[Effect]] = {
    "light_drift": optics.LightDrift,
    "point_spread": optics.PointSpread,
    "veiling_glare": optics.VeilingGlare,
    "lens_flare": optics.LensFlare,
    "vignetting": optics.Vignetting,
    "own_dust": unknown.Dust,
    "own_moving_fringes": unknown.MovingFringes,
}
SENSOR: dict[str, type[Effect]] = {
    "smear": charge.Smear,
    "dark_current_nonuniformity": charge.DarkCurrentNonuniformity,
    "hot_pixels": charge.HotPixels,
    "amplifier_glow": charge.AmplifierGlow,
    "clock_induced_charge": charge.ClockInducedCharge,
    "cosmic_rays": charge.CosmicRays,
    "image_lag": wells.ImageLag,
    "brighter_fatter": wells.BrighterFatter,
    "blooming": wells.Blooming,
    "charge_transfer_inefficiency": wells.ChargeTransferInefficiency,
    "interpixel_crosstalk": wells.InterpixelCrosstalk,
    "nonlinearity": readout.Nonlinearity,
    "dead_pixels": readout.DeadPixels,
    "own_video_echo": unknown.VideoEcho,
    "own_row_droop": unknown.RowDroop,
    "rts_noise": readout.RtsNoise,
    "fixed_pattern_structure": readout.FixedPatternStructure,
    "row_noise": readout.RowNoise,
    "column_noise": readout.ColumnNoise,
    "flicker_noise": readout.FlickerNoise,
    "periodic_banding": readout.PeriodicBanding,
    "own_pickup_stripes": unknown.PickupStripes,
    "row_parity": readout.RowParity,
    "black_level_drift": readout.BlackLevelDrift,
    "tap_mismatch": readout.TapMismatch,
    "own_adc_step": unknown.AdcStep,
    "missing_codes": digital.MissingCodes,
    "bit_truncation": digital.BitTruncation,
}


class Specimen:
    """One individual camera: its maps of response and offset, and its effects, each with what it remembers."""

    def __init__(
        self, camera: Camera, hidden: Mapping[str, Numbers], rng: np.random.Generator, frames: int = 70
    ):
        self.camera, self.rng = camera, rng
        self.response = np.maximum(1 + self._map(camera.prnu), 0)
        self.offset_e = self._map(camera.dsnu_e)
        sensor = [SENSOR[name](hidden[name], camera, rng, frames) for name in SENSOR if name in hidden]
        lens = [LIGHT[name](hidden[name], camera, rng, frames) for name in LIGHT if name in hidden]
        if "own_moving_fringes" not in hidden:
            rng.random()  # a phase is drawn for every specimen, with fringes or without
        self.effects = lens + sensor

    def _map(self, sizes: tuple[float, float, float]) -> np.ndarray:
        """A map with parts of columns, rows and pixels."""
        (rows, columns), normal = self.camera.shape, self.rng.normal
        return (
            sizes[0] * normal(size=(1, columns))
            + sizes[1] * normal(size=(rows, 1))
            + sizes[2] * normal(size=(rows, columns))
        )

    def expose(self, shot: Shot, index: int, targets: Mapping[str, np.ndarray]) -> np.ndarray:
        """Take one frame; effects that remember go on from the one before."""
        camera, effects = self.camera, self.effects
        at = Moment(index, shot, np.zeros(camera.shape))
        photo = np.zeros(camera.shape)
        if shot.kind in ("flat", "scene"):
            photons = targets[shot.target] if shot.target else shot.photons or 0.0
            light = np.broadcast_to(photons, camera.shape).astype(float)
            for effect in effects:
                light = effect.light(light, at)
            photo = np.maximum(light, 0) * camera.efficiency * self.response
        for effect in effects:
            photo = effect.photo(photo, at)

        dark = np.full(camera.shape, camera.dark_e_per_s * np.exp(camera.dark_per_c * shot.celsius))
        for effect in effects:
            dark = effect.dark(dark, at)
        expected = photo + dark * shot.seconds
        for effect in effects:
            expected = effect.expected(expected, at)

        charge_e = poisson(
            self.rng, expected
        )  # detection picks photons, so electrons are Poisson of their own mean
        for effect in effects:
            charge_e = effect.collected(charge_e, at)
        charge_e = np.clip(charge_e, 0, camera.well_e)
        for effect in effects:
            charge_e = effect.well(charge_e, at)

        at.charge_e = charge_e
        voltage = charge_e + self.offset_e + tukey_lambda(self.rng, camera.tail, camera.read_e, camera.shape)
        for effect in effects:
            voltage = effect.voltage(voltage, at)
        return self._convert(voltage, at)

    def _convert(self, voltage_e: np.ndarray, at: Moment) -> np.ndarray:
        """Amplify and convert."""
        dn = voltage_e / self.camera.e_per_dn
        for effect in self.effects:
            dn = effect.amplified(dn, at)
        dn = dn + self.camera.pedestal_dn
        for effect in self.effects:
            dn = effect.converter(dn, at)
        code = np.clip(np.rint(dn), 0, 2**self.camera.bits - 1).astype(np.int64)
        for effect in self.effects:
            code = effect.code(code, at)
        return code.astype(np.uint16)


def take(
    camera: Camera,
    plan: Sequence[Shot],
    targets: Mapping[str, np.ndarray],
    hidden: Mapping[str, Numbers],
    rng: np.random.Generator,
) -> np.ndarray:
    """Take the frames of a plan with a new specimen. Returns (frames, rows, columns) uint16 in DN."""
    specimen = Specimen(camera, hidden, rng, len(plan))
    return np.stack([specimen.expose(shot, index, targets) for index, shot in enumerate(plan)])
