"""The measured component of what is unexplained: its rule, its parts against what was put into the frames, and its files."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmark.camera import Hidden
from tests.diagnosis.small import SENSOR, frame_set
from visaug import Camera
from visaug.app.cli import main
from visaug.diagnosis import Diagnosis, Residue, empirical
from visaug.diagnosis.empirical import component, excess, file_beside
from visaug.diagnosis.fitting.errors import Errors
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.reference import make_reference
from visaug.diagnosis.laboratory import Laboratory
from visaug.statistics.places import Places

ROWS, COLUMNS = SENSOR.shape


def silent(*_: object) -> None:
    """No progress."""


def measured(camera: Camera, seed: int, *hidden: Hidden) -> dict[str, np.ndarray]:
    part = Laboratory(frame_set(seed, hidden), camera).parts[-1]
    return empirical._measured(camera, part, 0, silent)


def wave_of_rows(x, strength, moment):
    """A sine over the rows, 8 periods a frame, with a new phase in every frame."""
    phase = moment.now().uniform(0, 2 * np.pi)
    return x + strength * np.sqrt(2) * np.sin(2 * np.pi * 8 * np.arange(len(x)) / len(x) + phase)[:, None]


def slow_columns(x, strength, moment):
    """Offsets of columns whose power lies below an eighth of a cycle per column, new in every frame."""
    drawn = np.fft.rfft(moment.now().standard_normal(x.shape[1]))
    drawn[x.shape[1] // 8 :] = 0
    drawn[0] = 0
    return x + strength * 2 * np.fft.irfft(drawn, x.shape[1])


def checkers(x, strength, moment):
    y, column = np.ogrid[: x.shape[0], : x.shape[1]]
    return x + strength * np.where((y + column) % 2, 1.0, -1.0)


def more_with_light(x, strength, moment):
    """Noise of every pixel whose variance is a share `strength` of the signal."""
    return x + np.sqrt(strength * np.maximum(x, 0)) * moment.now().standard_normal(x.shape)


def voltage(change, strength) -> Hidden:
    return Hidden(change.__name__, "voltage", change, strength)


@pytest.mark.parametrize("shape", [1.0, 8.0, 2000.0])
def test_a_complete_camera_seldom_gets_a_part(shape):
    """The nominal rate is 1 %. Of 400 records at most 3 % is allowed, which right code exceeds with 3e-4; the seed is fixed."""
    rng = np.random.default_rng(17)
    mean = np.exp(np.linspace(0, 0.5, 48))
    parts = 0
    for _ in range(400):
        drawn = rng.gamma(shape, mean / shape, (empirical.SETS + 1, 48))
        parts += excess(drawn[0], drawn[1:], shape).value.any()
    assert parts <= 12


def test_single_lines_and_wide_bands_are_found_with_their_power():
    """Of 20 pairs: a line of 8 is known to 22 %, the mean excess over 63 bins of 0.5 beside 1 to 1.5 / sqrt(63 * 20) = 0.04."""
    rng = np.random.default_rng(3)
    truth = np.full(64, 1.5)
    truth[20] = 9.0
    own, sets = rng.gamma(20, truth / 20), rng.gamma(20, 1 / 20, (empirical.SETS, 64))
    found = excess(own, sets, 20.0)
    assert found.value[20] == pytest.approx(8, rel=5 * 0.25)
    rest = np.delete(found.value, 20)
    assert rest.mean() == pytest.approx(0.5, abs=5 * 0.05)
    np.testing.assert_allclose(found.share[20], found.value[20] / own[20], rtol=0.3)
    assert not excess(sets[0], sets[1:], 20.0).value.any()


def test_frames_of_the_camera_itself_give_no_part(stated):
    assert [measured(stated, seed) for seed in (1, 2)] == [{}, {}]


def test_a_wave_along_the_rows_is_a_line_of_their_spectrum(stated):
    """Variance 4 e-^2; of 13 differences the power of a sine with constant amplitude is known to about 30 %."""
    found = measured(stated, 3, voltage(wave_of_rows, 2.0))
    assert set(found) == {"row_power_e2"}
    power = found["row_power_e2"]
    assert power.shape == (ROWS,)
    assert power.mean() == pytest.approx(4.0, rel=0.6)
    assert set(np.flatnonzero(power)) == {8, ROWS - 8}


def test_slow_noise_of_columns_is_a_band_of_their_spectrum(stated):
    found = measured(stated, 4, voltage(slow_columns, 1.0))
    assert set(found) == {"column_power_e2"}
    power = found["column_power_e2"]
    edge = COLUMNS // 8  # in white numbers of variance 1 each frequency below has a power of 2^2
    assert power[1:edge].mean() == pytest.approx(4.0, rel=0.5)
    assert power[edge : -edge + 1].max() < 0.5
    np.testing.assert_array_equal(power[1:], power[1:][::-1])


def test_a_checkerboard_is_the_fixed_map(stated):
    """Its power is all in one frequency, where the noise of a mean of 8 frames is 5e-4 of it: an amplitude known to 1 %."""
    found = measured(stated, 5, voltage(checkers, 3.0))
    assert set(found) == {"map_e"}
    pattern = found["map_e"]
    signs = checkers(np.zeros(SENSOR.shape), 1.0, None)
    assert (pattern * signs).mean() == pytest.approx(3.0, rel=0.05)
    assert pattern.std() == pytest.approx(3.0, rel=0.05)


def blocks(x, strength, moment):
    """Offsets of 8 x 8 pixels, new in every frame, which no part describes."""
    drawn = moment.now().standard_normal([size // 8 for size in x.shape])
    return x + strength * np.kron(drawn, np.ones((8, 8)))


def test_noise_that_no_part_describes_is_no_fixed_map(stated):
    """The mean of 8 frames has an eighth of its variance."""
    assert "map_e" not in measured(stated, 8, voltage(blocks, 2.0))


def test_noise_that_grows_with_light_is_the_variance_curve(stated):
    """0.2 of the signal beside shot noise: variances of 5000 pixels and two frames, known to 2 % of the whole at each level."""
    found = measured(stated, 6, voltage(more_with_light, 0.2))
    assert set(found) == {"level_e", "variance_e2"}
    level, variance = found["level_e"], found["variance_e2"]
    assert level[-1] > 4000
    bright = level > 100
    np.testing.assert_allclose(
        variance[bright], 0.2 * level[bright], atol=5 * 0.03 * 1.2 * level[bright].max()
    )
    assert variance[~bright].max(initial=0) < 1.0


@pytest.fixture(scope="module")
def with_checkers(stated):
    """The component of a checkerboard, with errors relative to the stated camera as it is."""
    lab = Laboratory(frame_set(7, [voltage(checkers, 3.0)]), stated)
    first = make_reference(lab, stated, (), 24, silent)
    plain = Fitted.unfitted(lab, first)
    errors = Errors(lab, first, plain)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(empirical, "SETS_OF_ERROR", 24)
        return component(stated, errors, errors.told(plain), silent)


def test_the_error_on_hold_out_frames_falls(with_checkers):
    assert with_checkers.parts == ("fixed map",)
    assert with_checkers.error_before.value == pytest.approx(1.0)
    assert with_checkers.error_after.high < 0.1
    assert with_checkers.helps


def test_camera_and_file_are_written_beside_each_other(with_checkers, tmp_path):
    part = with_checkers.saved(tmp_path / "deep" / "better.yaml")
    assert part.file == file_beside(tmp_path / "deep" / "better.yaml")
    assert sorted(f.name for f in (tmp_path / "deep").iterdir()) == ["better.yaml", "better_unexplained.npz"]
    (tmp_path / "deep").rename(tmp_path / "moved")
    again = Camera.load(tmp_path / "moved" / "better.yaml")
    assert again.effect_names == ["unexplained"]
    np.testing.assert_array_equal(again.maps["unexplained.map_e"].numpy(), with_checkers.arrays["map_e"])
    assert part.to_json()["parts"] == ["fixed map"]


def test_what_does_not_lower_the_error_is_not_written(with_checkers, tmp_path):
    worse = replace(with_checkers, error_after=replace(with_checkers.error_after, value=1.2))
    for one in (worse, replace(with_checkers, arrays={})):
        assert one.saved(tmp_path / "camera.yaml").file is None
    assert not list(tmp_path.iterdir())


def test_a_component_of_before_is_measured_anew(with_checkers, stated, tmp_path):
    """Of the camera with the component its own frames leave the same component, not twice of it."""
    with_checkers.saved(tmp_path / "better.yaml")
    better = Camera.load(tmp_path / "better.yaml")
    lab = Laboratory(frame_set(7, [voltage(checkers, 3.0)]), better)
    first = make_reference(lab, better, (), 8, silent)
    again = component(better, Errors(lab, first, Fitted.unfitted(lab, first)), None, silent)
    np.testing.assert_allclose(again.arrays["map_e"], with_checkers.arrays["map_e"], atol=0.05)
    assert again.camera.effect_names == ["unexplained"]


@pytest.fixture
def unexplained(with_checkers, stated, monkeypatch, tmp_path):
    """A diagnosis that named nothing, in the place of `visaug.diagnose`, and the words of a command in an own folder."""
    residue = Residue("The frames differ from pixel to pixel.", ("pixel",), (), ())
    one = with_checkers.error_before
    found = Diagnosis(
        stated,
        (),
        one,
        0.001,
        0.001,
        False,
        False,
        Places(),
        (),
        (),
        {},
        (),
        residue,
        None,
        (),
        errors=object(),
    )
    monkeypatch.chdir(tmp_path)
    stated.save("camera.yaml")
    frame_set(7).save("frames")
    monkeypatch.setattr("visaug.diagnosis.result.component", lambda *_: with_checkers)
    monkeypatch.setattr("visaug.diagnose", lambda *_, **__: found)
    return found, ["diagnose", "frames", "--camera", "camera.yaml"]


def refused(words: list[str], capsys) -> str:
    with pytest.raises(SystemExit) as left:
        main(words)
    assert left.value.code == 2
    return capsys.readouterr().err


def test_the_command_writes_and_tells_it(unexplained, with_checkers, tmp_path, capsys):
    _, words = unexplained
    main([*words, "-o", "better.yaml", "--unexplained", "--json", "r.json"])
    told = capsys.readouterr().out
    assert "Empirical component (fixed map): error on hold-out frames" in told
    assert "wrote better_unexplained.npz" in told
    assert Camera.load("better.yaml").effect_names == ["unexplained"]
    part = json.loads((tmp_path / "r.json").read_text())["unexplained"]["component"]
    assert part["parts"] == ["fixed map"]
    assert part["file"] == "better_unexplained.npz"
    assert part["error_after"] == with_checkers.error_after.value
    main([*words, "-o", "plain.yaml", "--json", "plain.json"])
    assert "component" not in json.loads((tmp_path / "plain.json").read_text())["unexplained"]
    assert Camera.load("plain.yaml").effect_names == []
    assert "mpirical" not in capsys.readouterr().out


def test_files_of_others_stay(unexplained, tmp_path, capsys):
    _, words = unexplained
    (tmp_path / "better_unexplained.npz").write_text("mine")
    told = refused([*words, "-o", "better.yaml", "--unexplained"], capsys)
    assert "better_unexplained.npz: already exists; expected another name, or --force to overwrite it" in told
    assert (tmp_path / "better_unexplained.npz").read_text() == "mine"
    assert not (tmp_path / "better.yaml").exists()
    assert "--unexplained: there is no camera; expected -o beside it" in refused(
        [*words, "--unexplained"], capsys
    )
    main([*words, "-o", "better.yaml", "--unexplained", "--force"])
    assert Camera.load("better.yaml").effect_names == ["unexplained"]


def test_one_line_says_why_nothing_is_written(
    unexplained, with_checkers, stated, tmp_path, monkeypatch, capsys
):
    found, words = unexplained
    for part, line in (
        (replace(with_checkers, arrays={}, camera=stated, error_after=None), "no part is significant"),
        (
            replace(with_checkers, error_after=with_checkers.error_before),
            "does not lower the error and is not written",
        ),
    ):
        monkeypatch.setattr("visaug.diagnosis.result.component", lambda *_, part=part: part)
        main([*words, "-o", "better.yaml", "--unexplained", "--force"])
        assert line in capsys.readouterr().out
        assert Camera.load("better.yaml").effect_names == []
    monkeypatch.setattr(
        "visaug.diagnose", lambda *_, **__: replace(found, unexplained=None, p_value_after=0.5)
    )
    main([*words, "-o", "better.yaml", "--unexplained", "--force"])
    assert "Nothing is left unexplained: no component is written." in capsys.readouterr().out
    assert not (tmp_path / "better_unexplained.npz").exists()
