"""Flats of unknown photons: every camera is simulated with the light that gives their measured level."""

import numpy as np
import pytest
import yaml

from benchmark.camera import Hidden, take
from benchmark.sets import camera_yaml
from benchmark.small import PLAN, SENSOR
from visaug import Camera, FrameSet, compare
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.unknown_light import SAME, UnmeasuredLight, photons_of
from visaug.frames import FrameRecord

CAMERA = Camera.load(
    {
        "resolution": [32, 40],
        "bit_depth": 12,
        "quantum_efficiency": 0.5,
        "gain_e_per_dn": 2.0,
        "gain_db": 6.0,
        "black_level_dn": 100.0,
        "dark_current": {"a_e_per_s": 30.0, "b_per_c": 0.07},
        "temperature_c": 20.0,
    }
)
LEVELS = tuple(UnmeasuredLight(dn, (0,), (0,), 0.5, 10.0, 0.0) for dn in (300.0, 1100.0))


def test_photons_of_a_plain_camera_are_those_of_its_level_without_dark_current():
    e_per_dn = 2.0 * 10 ** (6 / 20)
    dark_e = 30.0 * np.exp(0.07 * 10.0) * 0.5
    expected = [((dn - 100) * e_per_dn - dark_e) / 0.5 for dn in (300.0, 1100.0)]
    assert photons_of(CAMERA, LEVELS, lambda *_: np.full(2, np.nan)) == pytest.approx(expected)
    below = [LEVELS[0]._replace(dn=90.0)]
    assert photons_of(CAMERA, below, lambda *_: np.zeros(1)) == [0.0]


@pytest.mark.parametrize(
    ("name", "response", "light"),
    [
        ("vignetting", lambda dn: 0.9 * dn, 1 / 0.9),
        ("amplifier_glow", lambda dn: dn + 20.0, None),
        ("nonlinearity", lambda dn: dn - 5e-5 * dn**2, None),
        ("row_noise", lambda dn: dn * (1 + 0.9 * SAME), 1.0),
    ],
)
def test_further_effects_change_the_light_until_the_level_is_that_of_the_plain_camera(name, response, light):
    """The mean of a camera as a function: 0.1 % of the light is left of a bend of 5 %, and what noise makes is left as it is."""
    plain = photons_of(CAMERA, LEVELS, lambda *_: np.zeros(2))
    gain, dark = CAMERA.gain_at(0.0), LEVELS[0].dark_dn(CAMERA)

    def simulated(camera, photons):
        dn = 0.5 * np.array(photons) / gain
        return dark + (response(dn) if camera.effect_names else dn)

    found = photons_of(CAMERA.with_effect(name), LEVELS, simulated)
    if light is not None:
        assert found == pytest.approx(light * np.array(plain))
    if name != "row_noise":
        levels = simulated(CAMERA.with_effect(name), found)
        assert levels - dark == pytest.approx(np.array([300.0, 1100.0]) - dark, rel=1e-3)


@pytest.fixture(scope="module")
def frames() -> FrameSet:
    """By the benchmark's camera, which shares no code with the package."""
    records = [FrameRecord(i, f"{i}.npy", s.kind, s.seconds, s.celsius, 0.0) for i, s in enumerate(PLAN)]
    return FrameSet.from_arrays(records, list(take(SENSOR, PLAN, {}, 7, [])), bit_depth=SENSOR.bits)


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c,
        lambda c: c.replace({"gain_e_per_dn": 0.8 * SENSOR.e_per_dn}),
        lambda c: c.replace(
            {"quantum_efficiency": 0.5 * SENSOR.efficiency, "black_level_dn": SENSOR.pedestal_dn - 5}
        ),
        lambda c: c.with_effect("vignetting", corner_loss=0.3),
        lambda c: c.with_effect("image_lag", share=0.05),
        lambda c: c.with_effect("amplifier_glow"),
    ],
    ids=["right", "gain", "efficiency", "vignetting", "image_lag", "amplifier_glow"],
)
def test_a_simulated_flat_of_unknown_photons_has_the_measured_level(frames, change):
    """Within 0.4 % of the light: the noise of the mean of a flat, PRNU of rows and columns among it, is a tenth of that."""
    camera = Camera.load(yaml.safe_load(camera_yaml(SENSOR)))
    (part,) = Laboratory(frames, camera).parts
    flats = [i for i, r in enumerate(part.frames.records) if r.kind == "flat"]
    conditions = {}
    for i in flats:
        conditions.setdefault(part.frames.records[i].photons, []).append(i)
    assert len(conditions) == len({s.photons for s in PLAN if s.kind == "flat"})
    one = change(camera)
    taken = part.take(one, 5)
    for same in conditions.values():
        made, measured = (
            np.mean([of.read(i).mean(dtype=float) for i in same]) for of in (taken, part.frames)
        )
        assert made - measured == pytest.approx(0, abs=0.2 + 0.004 * float(measured - SENSOR.pedestal_dn))


def test_a_lens_that_loses_light_is_no_difference_in_the_level_of_flats_of_unknown_photons(frames):
    """The right camera holds, and one without the effect does not."""
    rows, columns = frames.shape(0)
    y, x = np.mgrid[:rows, :columns]
    r2 = ((y + 0.5 - rows / 2) ** 2 + (x + 0.5 - columns / 2) ** 2) * 4 / (rows**2 + columns**2)
    plain = Camera.load(yaml.safe_load(camera_yaml(SENSOR)))
    shade = Hidden("shade", "light", lambda light, strength, _: light * (1 - strength * r2), 0.2)
    taken = take(SENSOR, PLAN, {}, 7, [shade])
    dim = FrameSet.from_arrays(frames.records, list(taken), bit_depth=SENSOR.bits)
    assert compare(plain.with_effect("vignetting", corner_loss=0.2), dim).adequate
    assert not compare(plain, dim).adequate
