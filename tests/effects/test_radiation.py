"""Damage of a dose against a simulation in NumPy of sites that leak, and against the universal damage factor.

Statistical tests allow 5 standard errors on a fixed seed.
"""

import numpy as np
import pytest
import torch

import visaug
from visaug.core.errors import InputError
from visaug.effects import radiation

CAMERA = {"resolution": [40, 50], "gain_e_per_dn": 1.0, "bit_depth": 12}
PIXEL_UM, DEPLETED_UM = 5.0, 2.0


def damaged(dose, **given):
    return radiation.entries(dose / 4, 4.0, pixel_um=PIXEL_UM, depleted_um=DEPLETED_UM, **given)


def entry(found, name):
    return next(dict(e) for e in found["effects"] if e["name"] == name)


def test_leakage_is_the_universal_damage_factor():
    """1.9e5 carriers/(cm^3 s) per MeV/g at 300 K; by 0.63 eV it doubles within 8 degrees."""
    assert radiation.leakage_e_per_s_um3(26.85) == pytest.approx(1.9e5 * 1e-12 * 1e6)
    assert radiation.leakage_e_per_s_um3(24.0) / radiation.leakage_e_per_s_um3(16.0) == pytest.approx(
        2.0, rel=0.03
    )


@pytest.mark.parametrize("dose", [20.0, 150.0])
def test_hot_pixels_are_those_with_a_site(dose):
    """Poisson numbers of exponential sites: their share, mean and, for few sites, standard deviation."""
    rng = np.random.default_rng(3)
    number = rng.poisson(PIXEL_UM**2 * DEPLETED_UM * dose / 50_000, 400_000)
    leak = rng.gamma(np.maximum(number, 1e-9), radiation.leakage_e_per_s_um3(20.0) * 50_000) * (number > 0)
    hot = entry(damaged(dose), "hot_pixels")
    assert hot["density"] == pytest.approx((number > 0).mean(), rel=5 / np.sqrt((number > 0).sum()))
    effect = visaug.effects.HotPixels(**{key: value for key, value in hot.items() if key != "name"})
    made = effect(torch.zeros(600, 700), exposure_s=1.0, temperature_c=20.0).double().numpy()
    error = leak.std() * np.sqrt(1 / leak.size + 1 / made.size)
    assert made.mean() == pytest.approx(leak.mean(), abs=5 * error)
    assert made.std() == pytest.approx(leak.std(), rel=0.1)


def test_a_large_dose_raises_the_dark_current():
    rng = np.random.default_rng(4)
    dose = 20_000.0
    number = rng.poisson(PIXEL_UM**2 * DEPLETED_UM * dose / 50_000, 200_000)
    leak = rng.gamma(np.maximum(number, 1e-9), radiation.leakage_e_per_s_um3(20.0) * 50_000)
    found = damaged(dose)
    assert found["dark_current_e_per_s"] == pytest.approx(
        leak.mean(), rel=5 * leak.std() / leak.mean() / np.sqrt(leak.size)
    )
    assert entry(found, "dark_current_nonuniformity")["spread"] == pytest.approx(
        leak.std() / leak.mean(), rel=0.03
    )


def test_one_dose_sets_all_and_a_camera_takes_them():
    found = damaged(100.0, tracks_per_cm2_s=4.0, transfer_loss_per_tev_g=1e-6)
    assert entry(found, "cosmic_rays")["rate_per_mpx_s"] == pytest.approx(
        4.0 * 0.25
    )  # 10^6 pixels of 5 um are 0.25 cm^2
    assert entry(found, "charge_transfer_inefficiency")["share_per_transfer"] == pytest.approx(1e-4)
    camera = visaug.Camera.load({**CAMERA, "effects": found["effects"]})
    names = {"hot_pixels", "dark_current_rts", "cosmic_rays", "charge_transfer_inefficiency"}
    assert set(camera.effect_names) == names
    assert damaged(0.0) == {"dark_current_e_per_s": 0.0, "effects": []}


@pytest.mark.parametrize(("given", "field"), [({"years": -1.0}, "years"), ({"pixel_um": 0.0}, "pixel_um")])
def test_mistakes_are_named(given, field):
    usual = {"dose_tev_per_g_year": 10.0, "years": 2.0, "pixel_um": 5.0, "depleted_um": 2.0}
    with pytest.raises(InputError, match=field):
        radiation.entries(**{**usual, **given})
    with pytest.raises(InputError, match="share_per_transfer"):
        radiation.entries(**usual, transfer_loss_per_tev_g=1.0)
