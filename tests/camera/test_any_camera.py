"""Every camera that the rules of camera.yaml allow gives finite values in range, whatever the light, heat and time.

The laws have no such limits, so a value out of range or a warning of NumPy is a fault of the arithmetic.
"""

import math
import os
import warnings

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from visaug import Camera, FrameSet, VISNoise
from visaug.camera.simulation import exposures
from visaug.camera.spec import CameraSpec
from visaug.core.errors import InputError
from visaug.core.sampling import Stream
from visaug.effects import catalogue
from visaug.frames import FrameRecord

EXAMPLES = int(os.environ.get("VISAUG_EXAMPLES", "60"))
ROWS, COLUMNS = 4, 5
OF_FILES = "unexplained"  # which no camera has without a measured file
FURTHER = sorted(name for name, e in catalogue().items() if not e.base and name != OF_FILES)


def within(low: float, high: float) -> st.SearchStrategy[float]:
    """Both ends often, and numbers of every size between."""
    size = (
        st.floats(max(math.log10(max(low, high * 1e-12)), -30), math.log10(high))
        if high > 0
        else st.just(0.0)
    )
    between = st.floats(low, high) if low < 0 else size.map(lambda x: min(max(10**x, low), high))
    return st.sampled_from([low, high]) | between


def bounds(part: type, key: str) -> tuple[float, float]:
    """The least and the largest number that a camera file may have there."""
    limits = {
        name: m for m in part.model_fields[key].metadata for name in ("ge", "gt", "le") if hasattr(m, name)
    }
    low = limits.get("ge", limits.get("gt"))
    return float(getattr(low, "ge", getattr(low, "gt", 0.0))), float(limits["le"].le)


@st.composite
def contents(draw, effects: bool = True) -> dict:
    """What a camera file may hold."""
    bits = draw(st.sampled_from([1, 8, 12, 16]))
    made = {
        "resolution": [ROWS, COLUMNS],
        "bit_depth": bits,
        "reading": draw(st.sampled_from(["physical", "physical", "paper"])),
        "gain_e_per_dn": draw(within(*bounds(CameraSpec, "gain_e_per_dn"))),
        "black_level_dn": draw(st.sampled_from([0.0, 0.5, 0.99])) * (2**bits - 1),
        "exposure_s": draw(st.sampled_from([1e-6, 1.0, 3600.0, 1e5])),
    }
    for key in ("quantum_efficiency", "gain_db", "temperature_c"):
        if draw(st.booleans()):
            made[key] = draw(within(*bounds(CameraSpec, key)))
    if draw(st.booleans()):
        made["full_well_e"] = draw(within(1.0, 1e9))
    for part in ("read_noise", "dark_current", "prnu", "dsnu"):
        fields = CameraSpec.model_fields[part].annotation
        numbers = [key for key, field in fields.model_fields.items() if field.annotation is float]
        for key in draw(st.lists(st.sampled_from(numbers), unique=True)):
            made.setdefault(part, {})[key] = draw(within(*bounds(fields, key)))
    if draw(st.booleans()):
        made.setdefault("read_noise", {})["meaning"] = "scale"
    made["effects"] = [
        draw(effect(name)) for name in draw(st.lists(st.sampled_from(FURTHER), unique=True, max_size=3))
    ]
    return made


@st.composite
def effect(draw, name: str) -> dict:
    made = {"name": name}
    for key, parameter in catalogue()[name].parameters.items():
        if parameter.options:
            made[key] = draw(st.sampled_from(parameter.options))
        elif draw(st.booleans()):
            value = draw(within(parameter.low, parameter.high))
            made[key] = round(value) if parameter.integer else value
    return made


HOT = {
    "resolution": [ROWS, COLUMNS], "bit_depth": 12, "gain_e_per_dn": 1.0, "exposure_s": 1e5, "temperature_c": 150.0,
    "dark_current": {"a_e_per_s": 1e7, "b_per_c": 0.5}, "prnu": {"pixel": 0.05}, "read_noise": {"sigma_e": 3.0},
}  # fmt: skip
COARSE = {
    "resolution": [ROWS, COLUMNS],
    "bit_depth": 16,
    "gain_e_per_dn": 1e6,
    "gain_db": 120.0,
    "prnu": {"pixel": 0.05},
}
every = settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.fixture(autouse=True)
def no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


@every
@given(
    contents(),
    st.sampled_from([0.0, 1.0, 1e4, 1e8, 1e12]),
    st.sampled_from([-60.0, 20.0, 150.0]),
    within(-100, 120),
)
@example(HOT, 1e12, 150.0, 0.0)
@example({**HOT, "effects": [{"name": "brighter_fatter"}]}, 1e12, 150.0, 0.0)
def test_simulated_frames(content, photons, temperature_c, gain_db):
    camera = Camera.load(content)
    at = {"exposure_s": content["exposure_s"], "temperature_c": temperature_c, "gain_db": gain_db}
    plan = [
        FrameRecord(0, "b", "bias"),
        FrameRecord(1, "d", "dark", **at),
        FrameRecord(2, "f", "flat", photons=photons, **at),
    ]
    unread = FrameSet.from_arrays(plan, np.zeros((3, ROWS, COLUMNS), np.uint16), bit_depth=camera.bit_depth)
    for _, dn in exposures(camera, unread, seed=1):
        assert torch.isfinite(dn).all()
        assert dn.min() >= 0
        assert dn.max() <= 2**camera.bit_depth - 1
        assert (dn == dn.round()).all()


@every
@given(
    contents(),
    st.sampled_from([torch.float16, torch.bfloat16, torch.float32, torch.float64]),
    st.sampled_from([0.0, 1e-4, 0.5, 1.5]),
    st.booleans(),
    st.fixed_dictionaries(
        {},
        optional={
            "exposure": within(1e-6, 1.0),
            "strength": within(1e-3, 100.0),
            "gain_db": within(-60.0, 120.0),
            "full_scale_photons": within(1e-3, 1e12),
            "fixed_pattern": st.sampled_from(["image", "camera"]),
            "black_level": st.sampled_from(["subtract", "keep"]),
            "transfer": st.sampled_from(["linear", "srgb"]),
            "mono": st.booleans(),
        },
    ),
)
@example(HOT, torch.float32, 0.5, True, {})
@example(COARSE, torch.float32, 1.0, True, {"gain_db": -60.0})
def test_images(content, dtype, level, fast, options):
    noise = VISNoise(Camera.load(content), fast=fast, seed=1, **options)
    images = torch.linspace(0, 1, 2 * 3 * ROWS * COLUMNS).view(2, 3, ROWS, COLUMNS).mul(level).to(dtype)
    noisy = noise(images)
    assert noisy.dtype == dtype
    assert torch.isfinite(noisy).all()
    assert noisy.min() >= 0
    assert noisy.max() <= 1


@pytest.mark.parametrize("reading", ["physical", "paper"])
@pytest.mark.parametrize("fast", [True, False])
def test_more_electrons_than_any_number_holds_are_white(fast, reading):
    """The mean is 4e44 electrons for a converter of 4095: not black, as it is where a whole number runs over."""
    noise = VISNoise(Camera.load({**HOT, "reading": reading}), fast=fast, seed=1)
    assert (noise(torch.full((1, 1, 4, 5), 0.3)) == 1).all()


@pytest.mark.parametrize("device_path", [True, False])
def test_a_count_grows_with_its_mean_up_to_the_largest(device_path):
    """Means of 1e18 and more are beyond whole numbers of 64 bits; 1e-9 is a standard deviation at 1e18."""
    means = torch.logspace(1, 20, 20).view(1, 1, 1, -1)
    stream = Stream([7], [7], 1, (range(1), range(20)))
    if device_path:
        stream._native = lambda: False
    count = stream.poisson(means)
    assert (count.diff() > 0).all()
    assert torch.allclose(count[..., -4:], means[..., -4:], rtol=1e-6)


def test_a_picture_that_holds_no_number_keeps_it_in_its_place():
    """As SensorNoise documents: a NaN stays at its pixel, and nowhere else."""
    images = torch.full((1, 1, 6, 7), 0.5)
    images[0, 0, 2, 3] = torch.nan
    for fast in (True, False):
        noisy = VISNoise(Camera.load({"resolution": [6, 7], "gain_e_per_dn": 1.0}), fast=fast, seed=1)(images)
        assert torch.equal(noisy.isnan(), images.isnan())
    with pytest.raises(InputError):
        VISNoise("sony_imx174")(torch.full((1, 1, 6, 7), torch.inf))
