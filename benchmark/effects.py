"""Every hidden effect: where it acts, its other form, and what a careful observer would say of it.

`start` is where the search for the plain strength begins; `largest` is where the parameter ends. `axis`
holds the words of which one must be told, `grows` those that must and `may_grow` those that may be told,
where the effect is left unexplained.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from . import charge, light, readout
from .camera import Hidden, Moment


@dataclass(frozen=True)
class Kind:
    """An entry.

    `act` with its place, its forms beside the default, the meaning of `strength`, and its look.
    """

    name: str
    stage: str
    act: Callable[[np.ndarray, float, Moment], np.ndarray]
    unit: str
    start: float
    largest: float
    other_form: str | None
    axis: tuple[str, ...]
    grows: tuple[str, ...] = ()
    may_grow: tuple[str, ...] = ()

    def at(self, strength: float, form: str = "default") -> Hidden:
        return Hidden(self.name, self.stage, self.act, strength, form)


_S, _E, _T = "signal", "exposure", "temperature"

# fmt: off
KINDS: tuple[Kind, ...] = (
    # Order is that of physics: light, expected charge, charge in wells (collected before moved), voltage.
    Kind("light_drift", "light", light.light_drift, "relative rms", 0.01, 0.5, "slow walk", ("time",), (_S,)),
    Kind("vignetting", "light", light.vignetting, "loss at half a diagonal", 0.01, 0.9, "off-centre quartic",
         ("smooth",), (_S,)),
    Kind("lens_flare", "light", light.lens_flare, "share of light", 1e-3, 0.5, "ring and small ghost",
         ("smooth",), (_S,)),
    Kind("veiling_glare", "light", light.veiling_glare, "share of light", 0.01, 0.8, "exponential halo",
         ("smooth",), (_S,)),
    Kind("point_spread", "light", light.point_spread, "pixels", 0.13, 5, "exponential", ("pixel", "row",
         "column"), (_S,)),
    Kind("smear", "yield", charge.smear, "read time / integration", 0.003, 1, "one way", ("column",), (_S,),
         (_E,)),
    Kind("dark_current_nonuniformity", "yield", charge.dark_current_nonuniformity, "relative rms", 0.1, 1.5,
         "gamma", ("pixel",), (_E, _T)),
    Kind("hot_pixels", "yield", charge.hot_pixels, "share of pixels", 9e-4, 0.05, "pairs", ("pixel",), (_E,
         _T)),
    Kind("amplifier_glow", "yield", charge.amplifier_glow, "e-/s at the corner", 2, 1e4, "edge", ("smooth",),
         (_E,)),
    Kind("clock_induced_charge", "yield", charge.clock_induced_charge, "e-/frame", 0.5, 200, "by transfers",
         ("level", "pixel", "time"), ()),
    Kind("cosmic_rays", "charge", charge.cosmic_rays, "tracks/s", 0.5, 50, "worms", ("time", "pixel"), (_E,)),
    Kind("brighter_fatter", "charge", charge.brighter_fatter, "share at full well", 0.005, 0.1,
         "column-wise with tail", ("pixel", "level"), (_S,)),
    Kind("blooming", "charge", charge.blooming, "share of the excess", 0.01, 1, "one way mostly",
         ("column",), (_S,)),
    Kind("image_lag", "charge", charge.image_lag, "share left behind", 0.003, 0.5, "slow traps", ("time",),
         (_S,)),
    Kind("charge_transfer_inefficiency", "charge", charge.charge_transfer_inefficiency, "loss per transfer",
         2e-5, 0.01, "serial, traps", ("row", "column"), (_S,)),
    Kind("interpixel_crosstalk", "voltage", readout.interpixel_crosstalk, "share to each neighbour", 0.005,
         0.12, "longer arms", ("pixel",), (_S,)),
    Kind("dead_pixels", "voltage", readout.dead_pixels, "share of pixels", 1.2e-3, 0.05, "dark", ("pixel",),
         (), (_S,)),
    Kind("nonlinearity", "voltage", readout.nonlinearity, "sag at full well", 0.01, 0.5, "cubic with foot",
         ("level",), (_S,)),
    Kind("rts_noise", "voltage", readout.rts_noise, "share of pixels", 2e-3, 0.3, "three levels", ("time",
         "pixel")),
    Kind("fixed_pattern_structure", "voltage", readout.fixed_pattern_structure, "e-", 0.5, 500,
         "slope and sine", ("smooth", "column", "row")),
    Kind("row_parity", "voltage", readout.row_parity, "e-", 0.3, 200, "gain too", ("row",), (), (_S,)),
    Kind("row_noise", "voltage", readout.row_noise, "e- rms", 0.3, 200, "Laplace", ("row", "time")),
    Kind("column_noise", "voltage", readout.column_noise, "e- rms", 0.3, 200, "Laplace", ("column", "time")),
    Kind("flicker_noise", "voltage", readout.flicker_noise, "e- rms", 0.4, 200, "steeper", ("time", "row")),
    Kind("periodic_banding", "voltage", readout.periodic_banding, "e- amplitude", 0.3, 200, "third harmonic",
         ("row", "time")),
    Kind("black_level_drift", "voltage", readout.black_level_drift, "e- rms", 0.2, 200, "slow walk",
         ("time",)),
    Kind("tap_mismatch", "voltage", readout.tap_mismatch, "e-", 0.5, 100, "upper and lower", ("column",
         "row", "smooth"), (), (_S,)),
    Kind("bit_truncation", "code", readout.bit_truncation, "bits", 1, 5, "rounded", ("level",), (), (_S,)),
    Kind("missing_codes", "code", readout.missing_codes, "share of codes", 0.01, 0.5, "regular", ("level",),
         (), (_S,)),
)
# fmt: on

BY_NAME: dict[str, Kind] = {kind.name: kind for kind in KINDS}
PLACE: dict[str, int] = {kind.name: place for place, kind in enumerate(KINDS)}


def in_order(hidden: list[Hidden]) -> tuple[Hidden, ...]:
    """Sort effects into the order of physics, so that a pair does not depend on how it was drawn."""
    return tuple(sorted(hidden, key=lambda effect: PLACE.get(effect.name, len(PLACE))))
