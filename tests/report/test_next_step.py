"""The next command names the files at hand, quoted so that a shell takes them as they are."""

import dataclasses
import shlex

import numpy as np
import pytest
from click.testing import CliRunner

import visaug
from tests.report.test_pages import CAMERA, DIAGNOSIS, NOTHING
from visaug.app.cli.root import program
from visaug.frames import FrameRecord, FrameSet
from visaug.pictures.comparison import PictureComparison
from visaug.report.next_step import (
    Inputs,
    after_characterization,
    after_comparison,
    after_diagnosis,
    after_pictures,
    picture_inputs,
)
from visaug.statistics.places import Places


@pytest.fixture
def inputs(tmp_path):
    """A camera file and a frame set in a folder whose name a shell would take apart."""
    place = tmp_path / "my $(frames); here"
    camera = visaug.Camera.load(CAMERA)
    records = [FrameRecord(i, f"{i}.npy", "bias") for i in range(2)]
    FrameSet.from_arrays(records, np.full((2, 32, 40), 100, np.uint16), bit_depth=12).save(place)
    camera.save(place / "camera.yaml")
    return Inputs.of(visaug.Camera.load(place / "camera.yaml"), FrameSet.load(place, bit_depth=12))


def test_a_command_is_one_that_the_program_takes(inputs):
    """Each line is parsed by the command that it names; only IMAGES is left to the reader."""
    step = after_comparison(DIAGNOSIS, inputs)
    words = shlex.split(step.command)
    assert words[:3] == ["visaug", "diagnose", inputs.frames]
    assert words[words.index("--camera") + 1] == inputs.camera
    assert words[words.index("--bit-depth") + 1] == "12"
    for said in (
        step,
        after_comparison(NOTHING, inputs),
        after_diagnosis(DIAGNOSIS, inputs),
        after_diagnosis({**DIAGNOSIS, "accepted": []}, inputs),
        after_characterization(inputs),
        after_pictures(DIAGNOSIS, inputs),
        after_pictures(NOTHING, inputs),
    ):
        assert "FRAMES" not in said.command
        assert "CAMERA" not in said.command
        for line in said.command.splitlines():
            command, *arguments = shlex.split(line)[1:]
            context = program.commands[command].make_context(command, arguments, resilient_parsing=True)
            assert not context.args


def test_what_follows_from_an_answer():
    inputs = Inputs("f", "c.yaml")
    assert after_comparison(NOTHING, inputs).command == "visaug augment IMAGES -o noisy/ --camera c.yaml"
    assert after_diagnosis(DIAGNOSIS, inputs).command == "visaug diagnose f --camera c.yaml -o better.yaml"
    written = Inputs("f", "c.yaml", better="b.yaml")
    assert after_diagnosis(DIAGNOSIS, written).command == "visaug augment IMAGES -o noisy/ --camera b.yaml"
    mended = {**NOTHING, "camera_file": [{"key": "black_level_dn", "mistake": "black_level"}]}
    assert after_diagnosis(mended, written).command == "visaug augment IMAGES -o noisy/ --camera b.yaml"
    assert after_diagnosis(mended, inputs).command == "visaug diagnose f --camera c.yaml -o better.yaml"
    nothing_of_the_catalogue = {**DIAGNOSIS, "accepted": []}
    first, second = after_diagnosis(nothing_of_the_catalogue, written).command.splitlines()
    assert first == "visaug effects new my_effect"
    assert second == "visaug diagnose f --camera c.yaml --effects my_effect.py"
    farther = {**DIAGNOSIS, "error": {**DIAGNOSIS["error"], "after": 4.1, "interval_after": [3.8, 4.4]}}
    for doubtful in (farther, {**DIAGNOSIS, "outside": 0.6}):
        assert after_diagnosis(doubtful, written).command.startswith("visaug effects new my_effect\n")
    assert after_characterization(written).command == "visaug compare f --camera b.yaml"
    assert "augment" in after_characterization(written, of_pictures=True).command
    unwritten = after_characterization(inputs, on_camera=True).command
    assert unwritten == "visaug characterize f --camera c.yaml -o camera.yaml"
    assert after_pictures(NOTHING, Inputs("f")).command == ""


def test_frames_that_do_not_tell_the_gain_give_no_command_that_fails(tmp_path):
    """Two bias frames: the gain is unknown, so `-o camera.yaml` would be refused; a camera that has the gain helps."""
    noise = np.random.default_rng(1).normal(100, 3, (2, 32, 40))
    records = [FrameRecord(i, f"{i}.npy", "bias") for i in range(2)]
    FrameSet.from_arrays(records, np.rint(noise).astype(np.uint16), bit_depth=12).save(tmp_path)
    visaug.Camera.load(CAMERA).save(tmp_path / "known.yaml")
    alone = CliRunner().invoke(program, ["characterize", str(tmp_path)])
    assert alone.exit_code == 0
    assert alone.output.splitlines()[-1].strip() == "visaug plan"
    report = tmp_path / "r.html"
    known = ["characterize", str(tmp_path), "--camera", str(tmp_path / "known.yaml"), "--report", str(report)]
    helped = CliRunner().invoke(program, known)
    last = shlex.split(helped.output.splitlines()[-1])
    assert last[:3] == ["visaug", "characterize", str(tmp_path)]
    assert last[last.index("--camera") + 1] == str(tmp_path / "known.yaml")
    assert "Next: write the camera file." in report.read_text()


def test_images_that_are_to_look_like_pictures_keep_their_black_level():
    """As `compare --camera --target` does, which found no difference; the linear law is not left to each file's kind."""
    inputs = Inputs("f", "c.yaml", better="b.yaml", pictured=True)
    for step in (
        after_characterization(inputs, of_pictures=True),
        after_comparison(NOTHING, inputs),
        after_diagnosis(DIAGNOSIS, inputs),
        after_pictures(NOTHING, inputs),
    ):
        assert step.command.endswith(".yaml --transfer linear --black-level keep")
    records = [FrameRecord(0, "0.png", "image")]
    taken = FrameSet.from_arrays(records, [np.zeros((8, 8), np.uint8)])
    assert Inputs.of(None, taken).pictured
    found = PictureComparison(
        1.0, (), Places(()), {}, (), (5, 5), taken, visaug.Camera.load("sony_imx174"), "srgb"
    )
    command = after_pictures(NOTHING, dataclasses.replace(picture_inputs(found), effects=())).command
    assert command == (
        "visaug augment IMAGES -o noisy/ --camera sony_imx174 --transfer srgb --black-level keep"
    )


def test_the_options_of_pictures_are_those_of_the_next_command_too():
    inputs = Inputs("f", "c.yaml", transfer="srgb", options=("--scenes", "s"))
    assert after_comparison(NOTHING, inputs).command.endswith("--camera c.yaml --transfer srgb")
    again = after_diagnosis(DIAGNOSIS, inputs).command
    assert again == "visaug diagnose f --camera c.yaml --transfer srgb --scenes s -o better.yaml"


def test_objects_that_no_file_holds_have_no_file():
    camera = visaug.Camera.load("sony_imx174")
    assert camera.loaded_from == "sony_imx174"
    assert camera.replace({"read_noise.sigma_e": 3.0}).loaded_from is None
    assert visaug.Camera.load(CAMERA).loaded_from is None


def test_own_effects_are_passed_on(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(program, ["effects", "new", "my_lines"]).exit_code == 0
    with visaug.effects.registered(alone=True):
        visaug.effects.load_file("my_lines.py")
        command = Inputs.of(None, None).augmenting("c.yaml")
    assert command.endswith("--effects my_lines.py")
