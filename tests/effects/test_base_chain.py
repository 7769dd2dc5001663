"""The base chain against the EMVA 1288 linear model, and the paper's reading against its own law.

Means and variances are compared within 5 standard errors, estimated from image to image, on fixed seeds: for
some 400 comparisons a correct program would fail one of them, once and for all, with probability 2e-4.
"""

import math

import pytest
import torch
from scipy import stats

from visaug.augment.exposure import image_to_photons
from visaug.camera import Camera
from visaug.core.sampling import Stream

FRAMES, SIDE = 40, 80
GAINS = [0.19, 1.0, 3.1]  # e-/DN; noise spans a DN or more, so that rounding adds 1/12 DN^2


def camera(**given) -> Camera:
    content = {
        "resolution": [SIDE, SIDE],
        "gain_e_per_dn": 1.0,
        "black_level_dn": 200,
        "read_noise": {"sigma_e": 3.3},
    }
    return Camera.load({**content, **given})


def expose(one: Camera, photons, frames=FRAMES, cameras=None, side=SIDE, **values) -> torch.Tensor:
    window = (range(side), range(side))
    stream = Stream(range(1, frames + 1), cameras or [5] * frames, 1, window)
    light = torch.as_tensor(photons, dtype=torch.float32).expand(frames, 1, side, side)
    return one.expose(light, stream, values).double()


def check(samples: torch.Tensor, expected: float, slack: float = 0.0):
    """The mean of (B, ...) samples is `expected`, within 5 standard errors."""
    each = samples.reshape(len(samples), -1).mean(1)
    error = each.std() / len(each) ** 0.5
    assert abs(each.mean() - expected) < 5 * error + slack, (float(each.mean()), expected, float(error))
    return float(error)


def check_law(dn: torch.Tensor, mean: float, variance: float, precision: float = 0.01):
    """Mean and variance, the latter known to `precision` or better, so that agreement says something."""
    check(dn, mean, slack=1e-6 * mean)
    error = check((dn - mean) ** 2, variance)
    assert error < precision * variance


@pytest.mark.parametrize("gain", GAINS)
@pytest.mark.parametrize("efficiency", [0.35, 0.9])
@pytest.mark.parametrize("temperature", [10.0, 35.0])
def test_photon_transfer_sweep(gain, efficiency, temperature):
    """mu_y = K (eta mu_p + mu_d) + black level; sigma_y^2 = K^2 (sigma_read^2 + eta mu_p + mu_d) + 1/12."""
    a, b, exposure = 1.5, 0.08, 0.5
    one = camera(
        gain_e_per_dn=gain, quantum_efficiency=efficiency, temperature_c=temperature, exposure_s=exposure,
        dark_current={"a_e_per_s": a, "b_per_c": b},
    )  # fmt: skip
    dark = exposure * a * math.exp(b * temperature)
    for photons in (0.0, 3.0, 40.0, 800.0, 9000.0):
        electrons = efficiency * photons + dark
        check_law(
            expose(one, photons),
            mean=electrons / gain + 200,
            variance=(3.3**2 + electrons) / gain**2 + 1 / 12,
        )


def test_spatial_nonuniformity():
    """EMVA 1288: s_y^2 = K^2 (s_dsnu^2 + s_prnu^2 (eta mu_p)^2), over cameras; temporal noise on top."""
    prnu = {"column": 0.004, "row": 0.002, "pixel": 0.008}
    dsnu = {"column_e": 1.4, "row_e": 0.6, "pixel_e": 2.2}
    one = camera(prnu=prnu, dsnu=dsnu, quantum_efficiency=0.6)
    for photons in (0.0, 2000.0, 20000.0):
        electrons = 0.6 * photons
        spatial = sum(s**2 for s in dsnu.values()) + electrons**2 * sum(s**2 for s in prnu.values())
        variance = 3.3**2 + electrons + spatial + 1 / 12
        dn = expose(one, photons, frames=300, cameras=list(range(300)), side=40)
        check_law(dn, mean=electrons + 200, variance=variance, precision=0.03)


def test_fixed_pattern_is_fixed():
    """Two stacks of one camera show the same pattern: their covariance is the pattern's variance."""
    one = camera(dsnu={"pixel_e": 4.0}, read_noise={"sigma_e": 2.0})
    dn = expose(one, 0.0, frames=100).squeeze(1)
    first, second = dn[:50].mean(0), dn[50:].mean(0)
    covariance = (first - first.mean()) * (second - second.mean())
    check(covariance, 16.0)
    dn = expose(one, 0.0, frames=2, cameras=[1, 2]).squeeze(1)
    correlation = torch.corrcoef(dn.flatten(1))[0, 1]
    assert abs(correlation) < 5 / SIDE


@pytest.mark.parametrize("gain", [0.19, 3.1])
@pytest.mark.parametrize("efficiency", [0.35, 0.9])
def test_paper_reading_has_its_own_law(gain, efficiency):
    """Photons are counted before the quantum efficiency, electrons rounded, and DN get uniform noise:

    sigma_y^2 = K^2 (sigma_read^2 + eta^2 mu_p + mu_d + 1/12) + 1/12 + 1/12.
    """
    dark = {"a_e_per_s": 30.0, "b_per_c": 0.0}
    one = camera(
        reading="paper", gain_e_per_dn=gain, quantum_efficiency=efficiency, dark_current=dark, exposure_s=0.5
    )
    for photons in (0.0, 40.0, 800.0, 9000.0):
        check_law(
            expose(one, photons),
            mean=(efficiency * photons + 15) / gain + 200,
            variance=(3.3**2 + efficiency**2 * photons + 15 + 1 / 12) / gain**2 + 1 / 6,
        )


@pytest.mark.parametrize(("reading", "slope"), [("physical", 1.0), ("paper", 0.4)])
def test_photon_transfer_slope_tells_the_readings_apart(reading, slope):
    """Variance over mean in electrons is 1 in nature; in the paper's reading it is the quantum efficiency."""
    one = camera(reading=reading, quantum_efficiency=0.4, gain_e_per_dn=0.5)
    low, high = (expose(one, photons) for photons in (1000.0, 21000.0))
    rise = (high.var((1, 2, 3)) - low.var((1, 2, 3))) * 0.25
    check(rise / ((high.mean() - low.mean()) * 0.5), slope)


@pytest.mark.parametrize("reading", ["physical", "paper"])
def test_gain_and_quantum_efficiency_leave_an_image_as_it_was(reading):
    """Law of eq. 7: photons are the image times G / QE, so its mean comes back whatever G, dB and QE are."""
    image = torch.linspace(0.05, 0.6, SIDE).expand(1, 1, SIDE, SIDE)
    for gain, gain_db, efficiency in [
        (0.05, 0.0, 1.0),
        (0.19, 0.0, 0.3),
        (0.19, 12.0, 0.61),
        (2.0, 6.0, 0.9),
    ]:
        one = camera(
            reading=reading, gain_e_per_dn=gain, quantum_efficiency=efficiency, black_level_dn=0, bit_depth=16
        ).replace({"gain_db": gain_db})
        photons = image_to_photons(image, 65535, torch.tensor(one.gain_at(gain_db)), torch.tensor(efficiency))
        difference = expose(one, photons) - 65535 * image
        check(difference, 0.0, slack=1e-6 * 65535)
        check(difference * (image - image.mean()), 0.0, slack=1e-6 * 65535)  # and at both ends of it


def test_gain_in_decibel():
    """20 dB more are a tenth of the electrons per DN; the black level stays where it is."""
    one = camera(gain_e_per_dn=2.0, quantum_efficiency=0.5)
    assert one.gain_at(20.0) == pytest.approx(0.2)
    for gain_db in (0.0, 6.0, 20.0):
        gain = 2.0 / 10 ** (gain_db / 20)
        check_law(expose(one, 0.0, gain_db=gain_db), 200, (3.3 / gain) ** 2 + 1 / 12)
        check_law(expose(one, 600.0, gain_db=gain_db), 200 + 300 / gain, (3.3**2 + 300) / gain**2 + 1 / 12)


def test_dark_current_grows_with_time_and_temperature():
    datasheet = {"reference_e_per_s": 20.0, "reference_temperature_c": 25.0, "doubling_c": 7.0}
    one = camera(dark_current=datasheet)
    for exposure, temperature in [(0.01, 25.0), (1.0, 25.0), (4.0, 25.0), (1.0, 32.0), (1.0, 11.0)]:
        electrons = exposure * 20 * 2 ** ((temperature - 25) / 7)
        dn = expose(one, 0.0, exposure_s=exposure, temperature_c=temperature)
        check_law(dn, 200 + electrons, 3.3**2 + electrons + 1 / 12)


def test_dark_current_of_one_activation_energy():
    """Arrhenius' law, exp(-E / k T_K): the energy follows from the doubling at 25 C, E = k T_K^2 ln 2 / 7 C."""
    datasheet = {"reference_e_per_s": 20.0, "reference_temperature_c": 25.0, "doubling_c": 7.0}
    one = camera(dark_current={**datasheet, "law": "arrhenius"})
    assert one.to_dict()["dark_current"]["law"] == "arrhenius"
    for temperature, exposure in [(25.0, 1.0), (50.0, 0.1), (-10.0, 40.0), (-40.0, 300.0)]:
        kelvin = temperature + 273.15
        electrons = exposure * 20 * math.exp(298.15**2 * math.log(2) / 7 * (1 / 298.15 - 1 / kelvin))
        dn = expose(one, 0.0, exposure_s=exposure, temperature_c=temperature)
        check_law(dn, 200 + electrons, 3.3**2 + electrons + 1 / 12)


def test_full_well_clips_charge_before_the_readout():
    """A full pixel has no shot noise left, and the whole read noise; its level is the full well's."""
    one = camera(full_well_e=5000, gain_e_per_dn=0.5, quantum_efficiency=0.5)
    check_law(expose(one, 30000.0), 5000 / 0.5 + 200, (3.3 / 0.5) ** 2 + 1 / 12)
    check_law(expose(one, 5000.0), 2500 / 0.5 + 200, (3.3**2 + 2500) / 0.25 + 1 / 12)


def test_full_well_at_the_mean_is_half_a_bell():
    """E[min(N, w)] = w - sigma / sqrt(2 pi) for a Gaussian about w; Poisson of mean 2500 is close to one."""
    one = camera(full_well_e=2500, gain_e_per_dn=0.5)
    expected = 2500 - math.sqrt(2500 / (2 * math.pi))
    dn = expose(one, 2500.0)
    check((dn - 200) * 0.5, expected, slack=0.17)  # the skew of a Poisson count moves it by up to 1/6


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_converter_clips_and_gives_whole_numbers(bits):
    top = 2**bits - 1
    one = camera(bit_depth=bits, black_level_dn=20, gain_e_per_dn=0.8)
    assert (expose(one, 1e6, frames=2) == top).all()
    dn = expose(one, 0.4 * top, frames=2)
    assert torch.equal(dn, dn.round())
    assert dn.min() >= 0
    assert dn.max() <= top
    assert dn.std() > 3


def test_without_a_black_level_half_of_a_bias_frame_is_zero():
    """The share of zeros is the noise's probability below half a DN."""
    one = camera(black_level_dn=0, gain_e_per_dn=0.5, read_noise={"sigma_e": 3.3, "shape": -0.23})
    law = stats.tukeylambda(-0.23, scale=3.3 / 0.5 / stats.tukeylambda.std(-0.23))
    zeros = expose(one, 0.0) == 0
    check(zeros.double(), law.cdf(0.5))


def test_read_noise_has_its_shape_and_deviation():
    """Normalised: sigma is the standard deviation. As a scale: the quantile function's own scale."""
    for shape in (-0.23, 0.14, 0.5):
        for meaning, scale in (("standard_deviation", 3.3 / stats.tukeylambda.std(shape)), ("scale", 3.3)):
            noise = {"sigma_e": 3.3, "shape": shape, "meaning": meaning}
            one = camera(read_noise=noise, gain_e_per_dn=0.01, black_level_dn=20000)
            electrons = (expose(one, 0.0, frames=10) - 20000) * 0.01  # rounding is 0.003 e-
            law = stats.tukeylambda(shape, scale=scale)
            assert stats.kstest(electrons.flatten().numpy(), law.cdf).pvalue > 1e-4


def test_adding_an_effect_changes_no_other():
    """Row noise on top of a noisy frame is row noise alone: one offset a row, to rounding."""
    one = camera(gain_e_per_dn=0.01, black_level_dn=20000, dsnu={"pixel_e": 1.0})
    difference = expose(one.with_effect("row_noise", sigma_e=2.0), 30.0) - expose(one, 30.0)
    assert (difference - difference.mean(-1, keepdim=True)).abs().max() <= 1
    check(difference.mean(-1) ** 2 * 1e-4, 4.0)


GRADIENT = {
    "quantum_efficiency": 0.6, "gain_e_per_dn": 0.7, "gain_db": 2.0, "black_level_dn": 150.0,
    "full_well_e": 1400.0,
    "exposure_s": 0.4, "temperature_c": 22.0, "read_noise.sigma_e": 8.0, "read_noise.shape": -0.2,
    "dark_current.a_e_per_s": 30.0, "dark_current.b_per_c": 0.07, "prnu.column": 0.02, "prnu.row": 0.01,
    "prnu.pixel": 0.03, "dsnu.column_e": 4.0, "dsnu.row_e": 3.0, "dsnu.pixel_e": 6.0,
}  # fmt: skip


# Their gradient is far below the spread of this sum; the test after next holds it to account.
FAINT = ("read_noise.", "dsnu.", "prnu.row")


@pytest.mark.parametrize("path", [*GRADIENT, "photons", "image"])
@pytest.mark.parametrize("reading", ["physical", "paper"])
def test_gradient_through_the_chain(path, reading):
    """Of the expected image, a weighted mean of it and of its square, against differences of 4 %.

    `photons` scales all light; `image` tilts it, so that every pixel's share counts.
    """
    frames, side = 30, 60
    one = camera(resolution=[side, side], reading=reading)
    stream = Stream(range(frames), range(frames), 1, (range(side), range(side)))
    light = torch.linspace(200, 2600, side).expand(frames, 1, side, side)
    tilt = torch.linspace(-1, 1, side)
    start = {**GRADIENT, "photons": 1.0, "image": 0.2}[path]

    def loss(value):
        values = {**GRADIENT, path: value}
        photons = light * values.pop("photons", 1.0) * (1 + values.pop("image", 0.2) * tilt)
        dn = one.expose(photons, stream, values).double() / 1000
        return (dn * torch.linspace(0.5, 1.5, side) + dn**2).mean((1, 2, 3))

    value = torch.full((frames, 1, 1, 1), start, requires_grad=True)
    (slope,) = torch.autograd.grad(loss(value).sum(), value)
    step = 0.04 * start
    with torch.no_grad():
        difference = (loss(value + step) - loss(value - step)) / (2 * step)
    gap = slope.flatten() - difference
    error = gap.std() / frames**0.5
    assert abs(gap.mean()) < 5 * error + 0.01 * abs(difference.mean())
    if not path.startswith(FAINT):
        assert error < 0.1 * abs(difference.mean())  # else agreement would say little


@pytest.mark.parametrize(
    "path", [path for path in GRADIENT if path.startswith(("read_noise.", "dsnu.", "prnu."))]
)
@pytest.mark.parametrize("reading", ["physical", "paper"])
def test_gradient_of_the_scatter(path, reading):
    """Of the mean square of pixels, rows or columns about their level (for the shape: of the fourth power).

    With common random numbers noise is a number times its sigma, so the two sides differ by rounding alone.
    """
    frames, side, start = 20, 40, GRADIENT[path]
    fraction = path.startswith("prnu.")
    one = camera(resolution=[side, side], reading=reading, gain_e_per_dn=0.1, black_level_dn=5000)
    stream = Stream(range(frames), range(frames), 1, (range(side), range(side)))
    light = torch.full((frames, 1, side, side), 3000.0 if fraction else 0.0)

    def loss(value):
        values = {"read_noise.sigma_e": 8.0, path: value}
        electrons = (one.expose(light, stream, values).double() - 5000) * 0.1 - light.double()
        lines = {"row": -1, "column": -2}.get(path.split(".")[1].removesuffix("_e"))
        scatter = electrons if lines is None else electrons.mean(lines, keepdim=True)
        return (scatter ** (4 if path == "read_noise.shape" else 2)).mean((1, 2, 3))

    value = torch.full((frames, 1, 1, 1), start, requires_grad=True)
    (slope,) = torch.autograd.grad(loss(value).sum(), value)
    step = 0.02 * abs(start)
    with torch.no_grad():
        difference = (loss(value + step) - loss(value - step)) / (2 * step)
    gap = slope.flatten() - difference
    assert abs(gap.mean()) < 5 * gap.std() / frames**0.5 + 0.01 * abs(difference.mean())
    assert gap.std() / frames**0.5 < 0.1 * abs(difference.mean())  # else agreement would say little
