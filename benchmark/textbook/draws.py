"""The numbers of every effect, drawn within about a factor of two. Their meaning stands at the effects.

Electrons go by the camera's read noise, rates by its longest dark exposure. The order of the draws is part of what a seed means.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .cameras import Camera


class Die:
    """Draws for one camera."""

    def __init__(self, camera: Camera, rng: np.random.Generator):
        self.camera, self.rng = camera, rng
        self.read_e, self.longest_s = camera.read_e, max(camera.dark_s)

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def about(self) -> float:
        """A factor near one."""
        return self.between(0.7, 1.4)

    def whole(self, low: int, end: int) -> int:
        return int(self.rng.integers(low, end))

    def pick(self, *options: Any) -> Any:
        return options[int(self.rng.integers(len(options)))]

    def sign(self) -> int:
        return self.pick(-1, 1)


def vignetting(d: Die) -> dict[str, Any]:
    loss, law = d.between(0.10, 0.20), d.pick("cos4", "poly")
    return {"corner_loss": loss, "law": law, "centre": [d.between(-0.06, 0.06), d.between(-0.06, 0.06)]}


def point_spread(d: Die) -> dict[str, Any]:
    return {"law": d.pick("moffat", "defocus"), "size_px": d.between(0.8, 1.5)}


def veiling_glare(d: Die) -> dict[str, Any]:
    share, scale = d.between(0.03, 0.08), d.between(18, 45)
    return {"share": share, "scale_px": scale, "law": d.pick("exponential", "lorentz")}


def lens_flare(d: Die) -> dict[str, Any]:
    ghosts = []
    for i in range(3):
        share = d.between(0.003, 0.008)
        m = d.sign() * d.between(0.6, 1.2) if i else -d.between(0.7, 1.1)
        ghosts.append({"share": share, "m": m, "radius": d.between(4, 11)})
    return {"ghosts": ghosts, "halo_share": d.between(0.006, 0.014), "halo_px": d.between(8, 16)}


def dark_current_nonuniformity(d: Die) -> dict[str, Any]:
    return {"sigma_ln": d.between(0.35, 0.7)}


def hot_pixels(d: Die) -> dict[str, Any]:
    fraction, median = d.between(0.001, 0.005), 15 * d.read_e / d.longest_s * d.about()
    width, ratio = d.between(0.7, 1.1), d.between(0.55, 0.85)
    return {"fraction": fraction, "median_e_per_s": median, "sigma_ln": width, "b_ratio": ratio}


def dead_pixels(d: Die) -> dict[str, Any]:
    fraction, low = d.between(0.0005, 0.003), d.between(0.4, 0.7)
    return {"fraction": fraction, "share_low": low, "share_high": d.between(0.1, 0.25)}


def rts_noise(d: Die) -> dict[str, Any]:
    fraction = d.between(0.0035, 0.007)
    return {"fraction": fraction, "amp_min_e": 3 * d.read_e, "amp_exp_e": 4 * d.read_e * d.about()}


def amplifier_glow(d: Die) -> dict[str, Any]:
    return {
        "peak_e_per_s": d.between(25, 60) * (d.read_e / 3) / d.longest_s,
        "where": d.pick("tl", "tr", "bl", "br", "left", "right", "top"),
        "length_px": d.between(0.12, 0.28) * d.camera.columns,
        "pos": d.between(0.3, 0.7),
    }


def cosmic_rays(d: Die) -> dict[str, Any]:
    return {"per_second": d.between(3, 6) / d.longest_s, "readout_s": 0.05 * d.longest_s}


def image_lag(d: Die) -> dict[str, Any]:
    return {
        "share": d.between(0.007, 0.014),
        "slow": d.between(0.15, 0.3),
        "release_fast": d.between(0.8, 0.95),
        "release_slow": d.between(0.15, 0.3),
    }


def interpixel_crosstalk(d: Die) -> dict[str, Any]:
    return {"h": d.between(0.007, 0.014), "v": d.between(0.006, 0.012), "d": d.between(0.0006, 0.0016)}


def brighter_fatter(d: Die) -> dict[str, Any]:
    return {"variance_loss_at_80pct": d.between(0.06, 0.12), "v_over_h": d.between(1.0, 1.6)}


def blooming(d: Die) -> dict[str, Any]:
    return {"drained": d.between(0.15, 0.5), "up": d.between(0.4, 0.6)}


def smear(d: Die) -> dict[str, Any]:
    return {"transfer_over_exposure": d.between(0.003, 0.007)}


def nonlinearity(d: Die) -> dict[str, Any]:
    return {"loss_at_full_well": d.between(0.012, 0.03), "power": d.between(0.8, 2.0)}


def charge_transfer_inefficiency(d: Die) -> dict[str, Any]:
    return {
        "cti": d.between(3e-5, 1e-4),
        "toward": d.pick("first row", "last row"),
        "fast_share": d.between(0.6, 0.8),
        "tau_fast": d.between(0.6, 1.2),
        "tau_slow": d.between(4, 9),
        "beta": d.between(0.8, 0.95),
    }


def clock_induced_charge(d: Die) -> dict[str, Any]:
    return {"mean_e": 0.25 * d.read_e * d.about()}


def row_noise(d: Die) -> dict[str, Any]:
    return {"sigma_e": d.read_e * d.between(0.25, 0.5)}


def column_noise(d: Die) -> dict[str, Any]:
    return {"sigma_e": d.read_e * d.between(0.25, 0.5)}


def flicker_noise(d: Die) -> dict[str, Any]:
    sigma, exponent = d.read_e * d.between(0.5, 0.9), d.between(0.9, 1.2)
    return {"sigma_e": sigma, "exponent": exponent, "blanking_px": d.whole(8, 40)}


def periodic_banding(d: Die) -> dict[str, Any]:
    return {"amplitude_e": d.read_e * d.between(0.3, 0.6), "period_rows": d.between(5, 45)}


def tap_mismatch(d: Die) -> dict[str, Any]:
    axis, gain, sign = d.pick("left/right", "top/bottom"), d.sign() * d.between(0.004, 0.01), d.sign()
    offset = sign * max(d.between(2, 4), 0.6 * d.read_e / d.camera.e_per_dn * d.about())
    return {"axis": axis, "gain": gain, "offset_dn": offset}


def row_parity(d: Die) -> dict[str, Any]:
    return {"offset_e": d.sign() * d.read_e * d.between(0.4, 0.8), "gain": d.sign() * d.between(0.001, 0.003)}


def black_level_drift(d: Die) -> dict[str, Any]:
    sigma = max(0.25 * d.read_e, 0.4 * d.camera.e_per_dn) * d.between(0.8, 1.6)
    return {"sigma_e": sigma, "tau_frames": d.between(1, 8), "warm_up": d.pick(0.0, 1.5)}


def light_drift(d: Die) -> dict[str, Any]:
    return {"sigma": d.between(0.005, 0.01), "tau_frames": d.between(1, 8)}


def bit_truncation(d: Die) -> dict[str, Any]:
    return {"bits": d.pick(1, 2) if d.camera.e_per_dn < d.read_e / 3 else 1}


def missing_codes(d: Die) -> dict[str, Any]:
    law, fraction = d.pick("scatter", "sar"), d.between(0.025, 0.045)
    return {"law": law, "fraction": fraction, "key": d.whole(0, 1 << 30)}


def fixed_pattern_structure(d: Die) -> dict[str, Any]:
    read_e = d.read_e
    kinds = d.pick(["bands"], ["slope"], ["period"], ["bands", "period"], ["slope", "period"])
    numbers: dict[str, Any] = {"kinds": kinds, "axis": d.pick("column", "row")}
    if "bands" in kinds:
        count = d.whole(2, 4)
        numbers["bands"] = [
            [d.between(0.1, 0.9), d.sign() * read_e * d.between(0.7, 1.5)] for _ in range(count)
        ]
    if "slope" in kinds:
        numbers["slope_e"] = [d.sign() * read_e * d.between(1, 2), read_e * d.between(-0.7, 0.7)]
    if "period" in kinds:
        numbers["period_px"] = d.between(5, 35)
        numbers["amplitude_e"] = read_e * d.between(0.5, 1.0)
        numbers["phase"] = d.between(0, 6.28)
    return numbers


def video_echo(d: Die) -> dict[str, Any]:
    return {"share": d.sign() * d.between(0.005, 0.01), "delay_px": d.whole(5, 26)}


def row_droop(d: Die) -> dict[str, Any]:
    return {"k": d.between(0.005, 0.012), "recover_rows": d.between(1, 4)}


def adc_step(d: Die) -> dict[str, Any]:
    top = 2**d.camera.bits - 1
    code = int(top * d.pick(0.25, 0.375, 0.5)) + 1
    return {"code": code, "step_dn": d.sign() * max(2, 0.002 * top * d.about())}


def dust(d: Die) -> dict[str, Any]:
    return {"n": d.whole(4, 9), "depth": d.between(0.025, 0.06)}


def moving_fringes(d: Die) -> dict[str, Any]:
    return {
        "contrast": d.between(0.008, 0.018),
        "period_px": d.between(12, 40),
        "angle": d.between(0, 3.14),
        "drift_rad_per_frame": d.between(0.3, 1.2),
        "bend": d.between(0.1, 0.4),
    }


def pickup_stripes(d: Die) -> dict[str, Any]:
    return {
        "amplitude_e": d.read_e * d.between(0.4, 0.8),
        "period_px": d.between(17, 60),
        "damping_frames": d.between(0.4, 1.5),
        "blanking_px": d.whole(8, 40),
    }


# the order is what a random pair is drawn from
_CATALOGUED = (
    vignetting, point_spread, veiling_glare, lens_flare, dark_current_nonuniformity, hot_pixels, dead_pixels, rts_noise,
    amplifier_glow, cosmic_rays, image_lag, interpixel_crosstalk, brighter_fatter, blooming, smear, nonlinearity,
    charge_transfer_inefficiency, clock_induced_charge, row_noise, column_noise, flicker_noise, periodic_banding,
    tap_mismatch, row_parity, black_level_drift, light_drift, bit_truncation, missing_codes, fixed_pattern_structure,
)  # fmt: skip
_UNKNOWN = (video_echo, row_droop, adc_step, dust, moving_fringes, pickup_stripes)
Draw = Callable[[Die], dict[str, Any]]
CATALOGUED: dict[str, Draw] = {draw.__name__: draw for draw in _CATALOGUED}
UNKNOWN: dict[str, Draw] = {f"own_{draw.__name__}": draw for draw in _UNKNOWN}


def numbers_of(name: str, camera: Camera, rng: np.random.Generator) -> dict[str, Any]:
    """Draw the numbers of one effect."""
    return (CATALOGUED | UNKNOWN)[name](Die(camera, rng))
