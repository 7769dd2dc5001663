"""What radiation does to a sensor: entries of a camera file from one dose and one mission age.

Particles displace atoms of the silicon. The displacement damage dose (TeV/g) sums the non-ionising energy loss of all
particles; to first order the damage is proportional to it. A radiation study of an orbit gives it for a shielding and a time.
Annealing is not included, and neither is ionisation, whose damage depends on the process of the manufacturer.

Each damaged site in the depleted silicon leaks; their number in a pixel is Poisson, and the leakage of a site is exponential
(C. Virmontois et al., IEEE Trans. Nuclear Science 59 (2012) 927). Below `MOST_SITES` sites a pixel that is a share of hot
pixels; above it, a higher dark current with a wide nonuniformity of the same mean and variance, beside which the dark current
of the new camera is assumed to be small.
"""

import math
from typing import Any

from visaug.core.constants import BOLTZMANN_EV_PER_K, ZERO_C_K
from visaug.core.errors import InputError
from visaug.effects.catalogue import catalogue
from visaug.effects.charge.dark_electrons import REFERENCE_C

# Universal damage factor: J. R. Srour and D. H. Lo, IEEE Trans. Nuclear Science 47 (2000) 2451: 1.9e5 carriers/(cm^3 s) per MeV/g
# at 300 K, that is 0.19 e-/s for each um^3 and TeV/g; activation energy 0.63 eV.
LEAKAGE_300_K_E_PER_S = 0.19
ACTIVATION_EV = 0.63
MOST_SITES = 0.2  # of a pixel, on average: above it most leaking pixels have several


def entries(
    dose_tev_per_g_year: float,
    years: float,
    *,
    pixel_um: float,
    depleted_um: float,
    rts_share: float = 0.1,
    tracks_per_cm2_s: float = 0.0,
    transfer_loss_per_tev_g: float = 0.0,
) -> dict[str, Any]:
    """What radiation adds to a camera.

    Args:
        dose_tev_per_g_year: displacement damage dose behind the shielding in a year, TeV/g.
        years: age of the mission.
        pixel_um: pitch of the pixels.
        depleted_um: depth of the depleted silicon that a pixel collects leakage from.
        rts_share: of the damaged pixels, those whose leakage jumps between two levels; assumed.
        tracks_per_cm2_s: flux of particles through the sensor, for tracks in single frames.
        transfer_loss_per_tev_g: of a CCD, the charge-transfer inefficiency that a TeV/g adds, measured at its temperature and
            clocking; 0: no transfer.

    Returns:
        `dark_current_e_per_s`: to be added to the dark current at 20 C; and `effects`: entries for the `effects` of a camera.yaml.

    Raises:
        InputError: a number out of range, or a dose for which an effect leaves its range.

    Examples:
        >>> from visaug.effects import radiation
        >>> found = radiation.entries(50.0, 5.0, pixel_um=5.5, depleted_um=1.0)
        >>> [entry["name"] for entry in found["effects"]]
        ['hot_pixels', 'dark_current_rts']
    """
    given = {"dose_tev_per_g_year": dose_tev_per_g_year, "years": years, "rts_share": rts_share}
    given |= {"tracks_per_cm2_s": tracks_per_cm2_s, "transfer_loss_per_tev_g": transfer_loss_per_tev_g}
    for key, value in (*given.items(), ("pixel_um", pixel_um), ("depleted_um", depleted_um)):
        least = 0.0 if key in given else 1e-3
        if not math.isfinite(value) or value < least:
            expected = f"a number of at least {least:g}"
            raise InputError(f"{value!r} is out of range", field=key, expected=expected)
    dose = dose_tev_per_g_year * years
    volume_um3 = pixel_um**2 * depleted_um
    sites_per_um3 = 1 / 50_000  # for each TeV/g; Virmontois et al. (2012)
    sites = sites_per_um3 * volume_um3 * dose  # in a pixel, on average
    site_e_per_s = leakage_e_per_s_um3(REFERENCE_C) / sites_per_um3
    b_per_c = ACTIVATION_EV / (BOLTZMANN_EV_PER_K * (REFERENCE_C + ZERO_C_K) ** 2)
    effects: list[dict[str, Any]] = []
    added = 0.0
    damaged = -math.expm1(-sites)
    if 0 < sites <= MOST_SITES:
        rate = sites * site_e_per_s / damaged
        damage = {"density": damaged, "rate_e_per_s": rate, "b_per_c": b_per_c, "tail": 1.0}
        effects.append({"name": "hot_pixels", **damage})
    elif sites:
        added = sites * site_e_per_s
        # variance 2 rate^2 for each site: of a Poisson sum of exponential numbers
        spread = math.sqrt(2 / sites)
        effects.append({"name": "dark_current_nonuniformity", "spread": spread})
    if sites and rts_share:
        jumping = min(rts_share * damaged, 1.0)
        effects.append({"name": "dark_current_rts", "density": jumping, "amplitude_e_per_s": site_e_per_s})
    electrons_per_um = 80.0  # of a minimum ionising particle in silicon, as in cosmic_rays
    if tracks_per_cm2_s:
        rate = tracks_per_cm2_s * (pixel_um * 1e-4) ** 2 * 1e6  # cm^2 of 10^6 pixels
        charge = electrons_per_um * pixel_um
        effects.append({"name": "cosmic_rays", "rate_per_mpx_s": rate, "charge_e_per_px": charge})
    if transfer_loss_per_tev_g:
        loss = transfer_loss_per_tev_g * dose
        effects.append({"name": "charge_transfer_inefficiency", "share_per_transfer": loss})
    for entry in effects:
        # checks the range
        catalogue()[entry["name"]](**{key: value for key, value in entry.items() if key != "name"})
    return {"dark_current_e_per_s": added, "effects": effects}


def leakage_e_per_s_um3(celsius: float) -> float:
    """Mean leakage of a um^3 of depleted silicon after 1 TeV/g, e-/s."""
    inverse = 1 / (celsius + ZERO_C_K) - 1 / 300.0
    return LEAKAGE_300_K_E_PER_S * math.exp(-ACTIVATION_EV / BOLTZMANN_EV_PER_K * inverse)
