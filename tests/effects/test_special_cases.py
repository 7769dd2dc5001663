"""An effect whose parameter has the value that makes another effect of it."""

import torch

from visaug import effects
from visaug.effects import catalogue
from visaug.effects.parameter import check_value


def test_special_cases_are_in_the_catalogue_and_within_bounds():
    found = {name: effect for name, effect in catalogue().items() if effect.special_cases}
    assert set(found) == {"column_parity", "dark_current_rts", "lens_flare"}
    for name, effect in found.items():
        for case, other in effect.special_cases:
            assert other in catalogue()
            assert other != name
            for key, value in case.items():
                check_value(effect.parameters[key], value, key)
            assert any(effect.parameters[key].default != value for key, value in case.items())


def test_a_flare_without_ghosts_is_a_veiling_glare():
    light = torch.rand(1, 1, 40, 48, generator=torch.Generator().manual_seed(1)) * 1000
    flare = effects.LensFlare(ghost_share=0.0, halo_share=0.05, halo_width_px=12.0)
    veil = effects.VeilingGlare(share=0.05, width_px=12.0)
    torch.testing.assert_close(flare(light), veil(light))
    ghosts = effects.LensFlare(ghost_share=0.01, halo_share=0.05, halo_width_px=12.0)
    assert (ghosts(light) - veil(light)).abs().max() > 1


def test_defects_that_stay_in_the_upper_level_are_hot_pixels():
    """Of the same density, mean rate and law of the rates: the first two moments agree."""
    dark, conditions = torch.zeros(1, 1, 400, 400), {"exposure_s": 1.0, "temperature_c": 20.0}
    rts = effects.DarkCurrentRTS(density=0.05, amplitude_e_per_s=1000.0, duty=1.0, b_per_c=0.06)
    hot = effects.HotPixels(density=0.05, rate_e_per_s=1000.0, b_per_c=0.06, tail=1.0)
    one, other = (effect(dark, seed=3, **conditions).flatten() for effect in (rts, hot))
    # 8000 pixels of an exponential law: the mean has a relative error of 1.1 %, the mean square of 2.5 %; four of each
    for power, relative in ((1, 0.045 * 2**0.5), (2, 0.1 * 2**0.5)):
        first, second = one.pow(power).mean(), other.pow(power).mean()
        assert abs(first / second - 1) < relative


def test_two_blocks_of_columns_are_two_taps():
    """One step in the middle of a frame whose columns have two levels."""
    dark = torch.zeros(1, 1, 8, 32)
    blocks = effects.ColumnParity(offset_e=1.5, gain=0.0, channels=2, layout="blocks")(dark, seed=4)
    taps = [effects.TapMismatch(offset_e=offset, gain=0.0)(dark) for offset in (3.0, -3.0)]
    assert any(torch.allclose(blocks, one) for one in taps)
    more = effects.ColumnParity(offset_e=1.5, gain=0.0, channels=4, layout="blocks")(dark, seed=4)
    assert len(more.unique()) == 4
