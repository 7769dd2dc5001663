"""An effect whose parameter has the value that makes another effect of it."""

import torch

from visaug import effects
from visaug.effects import catalogue


def test_what_an_effect_becomes_is_in_the_catalogue_and_within_bounds():
    found = {
        (name, key): parameter.becomes
        for name, effect in catalogue().items()
        for key, parameter in effect.parameters.items()
        if parameter.becomes is not None
    }
    assert {name for name, _ in found} == {"dark_current_rts", "dual_gain", "lens_flare"}
    for (name, key), (value, other) in found.items():
        parameter = catalogue()[name].parameters[key]
        assert parameter.low <= value <= parameter.high
        assert parameter.default != value
        assert other in catalogue()
        assert other != name


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


def test_a_dual_gain_without_noise_of_its_own_is_a_curve():
    """Each level has one value: with noise in the second channel it has many."""
    levels = torch.linspace(0, 4000, 1600).view(1, 1, 40, 40)
    curve = effects.DualGain(noise_e=0.0, gain=0.05, seam_e=2000.0)(levels, seed=1)
    torch.testing.assert_close(curve, effects.DualGain(noise_e=0.0, gain=0.05, seam_e=2000.0)(levels, seed=2))
    assert (curve.flatten().diff() > 0).all()
    noisy = effects.DualGain(noise_e=10.0, gain=0.05, seam_e=2000.0)
    assert not torch.equal(noisy(levels, seed=1), noisy(levels, seed=2))
