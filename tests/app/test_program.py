"""The program: help with an example for every command, status 2 and one line for a user's mistake."""

import json
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

import visaug
from visaug.app.cli import main
from visaug.app.cli.root import program
from visaug.effects.testing import LAWS

COMMANDS = sorted(program.commands)
CAMERA = {
    "name": "plain",
    "resolution": [24, 32],
    "bit_depth": 12,
    "gain_e_per_dn": 2.0,
    "quantum_efficiency": 0.5,
    "black_level_dn": 30,
    "read_noise": {"sigma_e": 5.0},
}
PLAN = (
    "sequence,file,kind,exposure_s,temperature_c,gain_db,photons,clean\n"
    "0,b0.tif,bias,0,,0,,\n1,b1.tif,bias,0,,0,,\n2,f/f0.png,flat,0.01,,0,2000,\n3,f/f1.png,flat,0.01,,0,2000,\n"
)


@pytest.fixture
def program_run(capsys, monkeypatch, tmp_path):
    """Runs the program in this process, in an empty folder: (status, output, errors)."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump(CAMERA))
    (tmp_path / "plan.csv").write_text(PLAN)

    def run(*words: str | Path) -> tuple[int, str, str]:
        try:
            main([str(word) for word in words])
            status = 0
        except SystemExit as end:
            status = int(end.code or 0)
        said = capsys.readouterr()
        return status, said.out, said.err

    return run


def test_the_commands_are_there():
    assert {"augment", "simulate", "plan", "characterize", "compare", "diagnose", "lab", "demo"} <= set(
        COMMANDS
    )
    assert {"effects", "cameras", "train", "ablate", "evaluate"} <= set(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_an_example_and_a_seed(name, program_run):
    status, out, _ = program_run(name, "--help")
    assert status == 0
    assert f"  visaug {name}" in out.split("Example:")[1]
    assert "--seed" in out


def test_python_m_is_the_program():
    run = subprocess.run(
        [sys.executable, "-m", "visaug", "--version"], capture_output=True, text=True, check=True
    )
    assert run.stdout.startswith("visaug, version")


def test_a_library_that_logs_adds_no_line(tmp_path):
    """tifffile logs beside the error that it raises. In a process of its own, where no test has set up logging."""
    (tmp_path / "cut.tif").write_bytes(b"II*\0\xff\xff\xff\x7f")
    words = [sys.executable, "-m", "visaug", "frames", str(tmp_path)]
    result = subprocess.run(words, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert "cut.tif" in result.stderr


MISTAKES = [
    (["augment", "nowhere.png", "-o", "out", "--camera", "camera.yaml"], "nowhere.png"),
    (["augment", "camera.yaml", "-o", "out", "--camera", "camera.yaml"], "camera.yaml"),
    (["augment", ".", "-o", "out", "--camera", "no_such_camera"], "no_such_camera"),
    (["augment", ".", "-o", "out"], "--camera"),
    (["augment", ".", "-o", "out", "--camera", "camera.yaml", "--seed", "-1"], "--seed"),
    (["augment", ".", "-o", "out", "--camera", "camera.yaml", "--seed", "a"], "'a' is not a whole number"),
    (["augment", "a.png", "-o", "noisy.png", "--camera", "camera.yaml"], "a folder for the copies"),
    (["simulate", "nowhere.csv", "--camera", "camera.yaml", "-o", "out"], "nowhere.csv"),
    (["simulate", "plan.csv", "--camera", "bad.yaml", "-o", "out"], "bad.yaml"),
    (["simulate", "plan.csv", "--camera", "unknown.yaml", "-o", "out"], "read_noise.sigma"),
    (["simulate", "plan.csv", "--camera", "negative.yaml", "-o", "out"], "gain_e_per_dn"),
    (["compare", "nowhere", "--camera", "camera.yaml"], "nowhere"),
    (["characterize", "nowhere"], "nowhere"),
    (["diagnose", "nowhere", "--camera", "camera.yaml"], "nowhere"),
    (["lab", "nowhere", "--camera", "camera.yaml"], "nowhere"),
    (["diagnose", ".", "--camera", "camera.yaml", "--without", "row_nois"], "row_noise"),
    (["effects", "row_nois"], "row_noise"),
    (["effects", "--search", "xyzzy"], "--search: no effect is described by 'xyzzy'"),
    (["effects", "row_noise", "--search", "banding"], "--search"),
    (["effects", "new", "Not-A-Name"], "Not-A-Name"),
    (["effects", "new", "row_noise"], "row_noise"),
    (["effects", "new"], "NAME"),
    (["evaluate"], "--predictions"),
    (["evaluate", "--predictions", "p.json"], "--data"),
    (["train", "nowhere.yaml"], "nowhere.yaml"),
    (["ablate", "nowhere.yaml"], "nowhere.yaml"),
    (["frobnicate"], "frobnicate"),
    (["simulate", "gif.csv", "--camera", "camera.yaml", "-o", "out"], "'a.gif' cannot be written"),
    (["plan", "--exposure", "1e-300"], "exposure_s"),
    (["plan", "--exposure", "0"], "exposure_s"),
    (["plan", "-o", "camera.yaml/plan.csv"], "camera.yaml: is a file"),
    (["plan", "--camera", "camera.yaml", "--for", " , "], "--for"),
    (["compare", ".", "--camera", "camera.yaml", "--json", "."], ".: is a folder"),
    (["diagnose", ".", "--camera", "camera.yaml", "-o", "camera.yaml/better.yaml"], "camera.yaml: is a file"),
    (["effects", "check", "camera.yaml"], "camera.yaml: is no Python file"),
    (["preview", ".", "--camera", "camera.yaml", "-o", "sheet.png"], ".: is a folder"),
    (["frames", ".", "--exposure", "1e-300"], "exposure_s"),
    (["frames", ".", "--temperature", "nan"], "temperature_c"),
    (["plan", "--gains-db", "none"], "--gains-db: 'none' is not a list of numbers"),
    (["plan", "-o", "-"], "-o: '-' is not a name"),
    (["characterize", ".", "--report", "-"], "--report: '-' is not a name"),
    (["preview", "a.png", "--camera", "camera.yaml", "-o", "s.png", "--seed", "9" * 30], "--seed"),
    (["simulate", "plan.csv", "--camera", "camera.yaml", "-o", ".", "--force"], "holds no frame set"),
    (["effects", "new", "my_effect", "-o", "mine.txt"], "mine.txt: is no name of a Python file"),
    (["effects", "row_noise", "-o", "mine.py"], "--output: goes with `new`"),
    (["demo", "-o", "camera.yaml"], "camera.yaml: is a file"),
    (["augment", "", "-o", "out", "--camera", "camera.yaml"], "'IN...': the name is empty"),
    (["augment", ".", "-o", "", "--camera", "camera.yaml"], "'--output': the name is empty"),
    (["characterize", ""], "'FRAMES': the name is empty"),
    (["characterize", ".", "--json", ""], "'--json': the name is empty"),
    (["compare", ".", "--camera", ""], "no such camera"),
    (["characterize", ".", "--camera", ""], "no such camera"),
    (["plan", "--camera", ""], "no such camera"),
    (["plan", "--exposure", "10ms"], "'10ms' is not a number"),
    (["plan", "--repeats", "2.5"], "'2.5' is not a whole number"),
    (["diagnose", ".", "--camera", "camera.yaml", "--without", "row_nois"], "--without: 'row_nois' is not"),
]


@pytest.mark.parametrize(
    ("words", "named"), MISTAKES, ids=lambda v: "-".join(v)[:40] if isinstance(v, list) else None
)
def test_a_mistake_is_one_line_and_status_2(words, named, program_run, tmp_path):
    (tmp_path / "bad.yaml").write_text("a: [1, 2\nb: }")
    (tmp_path / "unknown.yaml").write_text(yaml.safe_dump({**CAMERA, "read_noise": {"sigma": 1}}))
    (tmp_path / "negative.yaml").write_text(yaml.safe_dump({**CAMERA, "gain_e_per_dn": -1}))
    (tmp_path / "gif.csv").write_text("sequence,file,kind\n0,a.gif,bias\n")
    before = sorted(tmp_path.rglob("*"))
    status, _, err = program_run(*words)
    assert status == 2, err
    assert named in err
    assert "Traceback" not in err
    lines = [line for line in err.splitlines() if line.strip() and not line.startswith(("Usage:", "Try "))]
    assert len(lines) == 1, err
    assert sorted(tmp_path.rglob("*")) == before


def test_simulate_writes_what_the_plan_names(program_run, tmp_path):
    status, out, err = program_run(
        "simulate", "plan.csv", "--camera", "camera.yaml", "-o", "frames", "--seed", "1"
    )
    assert status == 0, err
    assert "4 frames" in out
    flats = [
        cv2.imread(str(tmp_path / "frames" / f"f/f{i}.png"), cv2.IMREAD_UNCHANGED).astype(float)
        for i in range(2)
    ]
    assert flats[0].shape == (24, 32)
    # 2000 photons x 0.5 / 2 e-/DN + 30 DN; within five standard errors of the mean of 1536 pixels
    assert abs(np.mean(flats) - 530) < 5 * (1000 / 4 / 1536) ** 0.5
    assert yaml.safe_load((tmp_path / "frames" / "camera.yaml").read_text())["gain_e_per_dn"] == 2.0
    assert (tmp_path / "frames" / "frames.csv").exists()
    again, _, err = program_run("simulate", "frames", "--camera", "camera.yaml", "-o", "again", "--seed", "1")
    assert again == 0, err
    first, second = ((tmp_path / name / "f/f0.png").read_bytes() for name in ("frames", "again"))
    assert first == second


def test_the_plan_that_is_written_can_be_simulated(program_run, tmp_path):
    assert program_run("plan", "-o", "mine.csv")[0] == 0
    status, _, err = program_run("simulate", "mine.csv", "--camera", "camera.yaml", "-o", "frames")
    assert status == 0, err
    frames = visaug.FrameSet.load(tmp_path / "frames")
    scenes = [i for i, record in enumerate(frames.records) if record.kind == "scene"]
    assert scenes
    clean = frames.clean(scenes[0])
    assert clean.shape == (24, 32)
    # the spot is beyond saturation, the rest below it
    measured = frames.read(scenes[0])
    assert measured[clean == clean.max()].min() == 4095
    assert (measured == 4095).mean() < 0.05


def test_same_seed_same_frames_other_seed_others(program_run, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        program_run("simulate", "plan.csv", "--camera", "camera.yaml", "-o", name, "--seed", seed)
    a, b, c = ((tmp_path / name / "f/f0.png").read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_augment(program_run, tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((9, 11), 9000, np.uint16))
    status, out, err = program_run("augment", "a.png", "-o", "out", "--camera", "camera.yaml")
    assert status == 0, err
    assert "1 picture" in out
    noisy = cv2.imread(str(tmp_path / "out/a.png"), cv2.IMREAD_UNCHANGED)
    assert noisy.dtype == np.uint16
    assert "monochrome" not in out
    assert len(np.unique(noisy)) > 5


def test_the_laws_of_an_own_effect_are_checked(program_run, tmp_path):
    program_run("effects", "new", "lanes")
    status, out, err = program_run("effects", "check", "lanes.py")
    assert status == 0, err
    assert out.count("kept") == len(LAWS)
    text = (tmp_path / "lanes.py").read_text()
    (tmp_path / "lanes.py").write_text(text.replace("p.sigma_e *", "(p.sigma_e + 1) *"))
    status, out, err = program_run("effects", "check", "lanes.py")
    assert status == 2
    assert "sigma_e = 0" in out
    assert err.count("\n") == 1


def test_new_effect_runs_as_it_is(program_run, tmp_path):
    status, _, err = program_run("effects", "new", "stripes")
    assert status == 0, err
    status, _, err = program_run("effects", "new", "stripes")
    assert status == 2
    assert "stripes.py" in err
    status, out, err = program_run("effects", "stripes", "--effects", "stripes.py")
    assert status == 0, err
    assert "sigma_e" in out
    # In a process of its own, as a user would: the camera names the effect, the file brings it.
    code = (
        "import numpy as np, visaug\nfrom visaug.effects import load_file\nload_file('stripes.py')\n"
        f"camera = visaug.Camera.load({CAMERA!r}).with_effect('stripes', sigma_e=40.0)\n"
        "frames = visaug.simulate(camera, visaug.FrameSet.load('plan.csv'), seed=1)\n"
        "rows = frames.read(0).mean(axis=1); print(rows.std())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ},
    )
    # 24 rows of standard deviation 40 e- / 2 e-/DN = 20 DN; a right effect falls outside once in 1e5 seeds
    assert 8 < float(run.stdout) < 34


@pytest.mark.parametrize(
    ("words", "found", "other"),
    [
        ("banding", {"periodic_banding", "lamp_flicker"}, {"smear"}),
        ("EMI", {"slanted_interference", "periodic_banding"}, {"dust"}),  # no part of another word
        ("ghosting", {"lens_flare", "image_lag"}, {"row_noise"}),
        ("smear", {"smear", "charge_transfer_inefficiency", "parasitic_light"}, {"row_noise"}),
        ("prnu", {"prnu"}, {"row_noise"}),
        ("fixed pattern noise", {"prnu", "dsnu", "row_parity"}, {"row_noise"}),  # all words, in any case
        ("flicker", {"lamp_flicker", "flicker_noise", "light_drift"}, {"dust"}),
    ],
)
def test_effects_are_found_by_the_words_of_the_field(program_run, words, found, other):
    status, out, _ = program_run("effects", "--search", words)
    names = {line.split()[0] for line in out.splitlines() if line.strip()}
    assert status == 0
    assert found <= names
    assert not other & names


def test_several_files_after_one_option(program_run):
    for name in ("one", "two"):
        program_run("effects", "new", name)
    for first in (["--effects", "one.py"], ["--effects=one.py"]):
        status, out, err = program_run("effects", *first, "two.py")
        assert status == 0, err
        assert "one" in out.split()
        assert "two" in out.split()


def test_lists(program_run):
    status, out, _ = program_run("effects")
    assert status == 0
    assert "row_noise" in out
    places = [
        out.index(f"\n{stage}: ")
        for stage in ("optics", "generation", "charge", "readout", "digital", "picture")
    ]
    assert places == sorted(places)
    assert places[3] < out.index(" row_noise ") < places[4]
    status, out, _ = program_run("cameras")
    assert status == 0
    status, out, _ = program_run("plan", "-o", "mine.csv")
    assert status == 0
    assert "bias" in out
    assert Path("mine.csv").read_text().startswith("sequence,file,kind")


def test_own_effects_are_loaded_by_every_command_that_reads_a_camera(program_run, tmp_path):
    status, _, err = program_run("effects", "new", "step_of_mine", "-o", "own.py")
    assert status == 0, err
    own = {**CAMERA, "effects": [{"name": "step_of_mine"}]}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(own))
    for name in (
        "simulate",
        "plan",
        "characterize",
        "compare",
        "diagnose",
        "lab",
        "train",
        "ablate",
        "evaluate",
        "cameras",
    ):
        assert "--effects" in program_run(name, "--help")[1], name
    refused, _, err = program_run("simulate", "plan.csv", "--camera", "own.yaml", "-o", "out")
    assert refused == 2
    assert "--effects FILE.py" in err
    assert "visaug.effects.load_file" in err
    status, _, err = program_run(
        "simulate", "plan.csv", "--camera", "own.yaml", "--effects", "own.py", "-o", "out"
    )
    assert status == 0, err


def test_nothing_edited_is_overwritten_without_force(program_run, tmp_path):
    for name, words in (
        ("frames.csv", ["plan"]),
        ("frames.csv", ["frames", "shots"]),
        ("camera.yaml", ["characterize", "shots"]),
        ("camera.yaml", ["diagnose", "shots", "--camera", "camera.yaml"]),
    ):
        (tmp_path / name).write_text("mine")
        status, _, err = program_run(*words, "-o", name)
        assert status == 2, err
        assert f"{name}: already exists; expected another name, or --force to overwrite it" in err
        assert (tmp_path / name).read_text() == "mine"
    assert program_run("plan", "-o", "frames.csv", "--force")[0] == 0
    assert (tmp_path / "frames.csv").read_text().startswith("sequence,file,kind")


def test_simulating_into_a_full_folder_names_the_option_that_there_is(program_run, tmp_path):
    words = ("simulate", "plan.csv", "--camera", "camera.yaml", "-o", "out")
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump(CAMERA))
    assert program_run(*words)[0] == 0
    status, _, err = program_run(*words)
    assert status == 2
    assert "--force" in err
    assert program_run(*words, "--force")[0] == 0


def test_frames_of_a_folder_as_a_table(program_run, tmp_path):
    import tifffile

    for name in ("bias/1.tif", "bias/2.tif", "darks/1s_20C_1.tif", "flat/1.tif"):
        (tmp_path / "shots" / name).parent.mkdir(parents=True, exist_ok=True)
        tifffile.imwrite(tmp_path / "shots" / name, np.full((6, 8), 90, np.uint16), photometric="minisblack")
    status, out, err = program_run("frames", "shots", "-o", "shots/frames.csv")
    assert status == 0, err
    assert "the exposure of flat/1.tif is not known" in out
    assert "not complete" in out
    words = ("frames", "shots", "-o", "shots/frames.csv", "--exposure", "0.1", "--bit-depth", "12", "--force")
    status, out, err = program_run(*words)
    assert status == 0, err
    assert "not complete" not in out
    frames = visaug.FrameSet.load(tmp_path / "shots")
    assert [r.exposure_s for r in frames.records] == [0.0, 0.0, 1.0, 0.1]
    assert frames.bit_depth == 12


def test_laboratory_frames_without_kinds_are_told_how_to_get_them(program_run, tmp_path):
    """Names that tell no kind: the frames are pictures to the program, which says so and names the command for a table."""
    (tmp_path / "shots").mkdir()
    noise = np.random.default_rng(0).normal(100, 3, (6, 32, 40))
    for number, frame in enumerate(noise):
        cv2.imwrite(str(tmp_path / "shots" / f"img{number}.png"), np.rint(frame).astype(np.uint16))
    status, _, err = program_run("characterize", "shots", "--bit-depth", "12")
    assert status == 0
    assert "if they are: visaug frames shots -o shots/frames.csv" in err
    assert "if they are" not in program_run("characterize", "shots", "--bit-depth", "12", "-q")[2]


def test_a_plan_for_a_camera_and_by_hand(program_run, tmp_path):
    hot = {**CAMERA, "dark_current": {"a_e_per_s": 5.0, "b_per_c": 0.0}, "exposure_s": 0.02}
    (tmp_path / "hot.yaml").write_text(yaml.safe_dump(hot))
    words = ("plan", "--camera", "hot.yaml", "--levels", "0.1,0.5", "--repeats", "2", "-o", "p.csv")
    status, _, err = program_run(*words)
    assert status == 0, err
    plan = visaug.frames.read_table(tmp_path / "p.csv")
    # Read noise of 5 e- against 5 e-/s: the dark shot noise equals it at 25 / 5 s.
    darks = {r.exposure_s for r in plan if r.kind == "dark" and r.exposure_s > 0.1}
    assert darks == {1.2, 5.0, 20.0}
    assert {r.temperature_c for r in plan} == {20.0}
    assert {r.gain_db for r in plan} == {0.0}
    # (4095 - 30) DN of 2 e-/DN at half an electron a photon
    saturation = 4065 * 2.0 / 0.5
    assert {r.photons for r in plan if r.kind == "flat" and r.exposure_s == 0.02} == {
        round(0.1 * saturation),
        round(0.5 * saturation),
    }
    status, _, err = program_run("plan", "--temperatures", "none", "--gains-db", "0;3", "-o", "q.csv")
    assert status == 2
    assert "--gains-db" in err


def test_scripts_can_read_the_answer_of_compare(program_run, tmp_path):
    status, _, _ = program_run("simulate", "plan.csv", "--camera", "camera.yaml", "-o", "frames")
    assert status == 0
    status, out, err = program_run("compare", "frames", "--camera", "camera.yaml", "--json", "-", "--quiet")
    assert (status, err) == (0, "")
    assert json.loads(out)["fits"]["adequate_before"]
    noisy = {**CAMERA, "read_noise": {"sigma_e": 60.0}}
    (tmp_path / "noisy.yaml").write_text(yaml.safe_dump(noisy))
    status, out, _ = program_run("compare", "frames", "--camera", "noisy.yaml", "--fail-on-misfit")
    assert status == 3
    assert "does not hold" in out.splitlines()[-1]


def test_augment_says_what_it_assumed_skipped_and_could_not_use(program_run, tmp_path):
    (tmp_path / "in").mkdir()
    cv2.imwrite(str(tmp_path / "in" / "a.png"), np.full((8, 8, 3), 90, np.uint8))
    cv2.imwrite(str(tmp_path / "in" / "b.tif"), np.full((8, 8), 9000, np.uint16))
    (tmp_path / "in" / "c.jpg").write_bytes(b"no picture")
    (tmp_path / "in" / "d.mov").write_bytes(b"")
    status, out, _ = program_run(
        "augment", "in", "-o", "out", "--camera", "camera.yaml", "--camera", "sony_imx174", "--gain-db", "0:6",
        "--exposure", "0.5", "--strength", "2", "--copies", "2", "--p", "1",
    )  # fmt: skip
    assert status == 1
    assert "wrote 4 pictures" in out
    assert "transfer function: linear for 2 (16-bit), sRGB for 2 (8-bit colour)" in out
    assert "skipped 1 file: 1 .mov" in out
    assert "monochrome, the same noise in the three channels of colour pictures: " in out
    assert "c.jpg" in out.split("could not be used")[1]
    assert sorted(path.name for path in (tmp_path / "out").glob("[!.]*")) == [
        "a_1.png",
        "a_2.png",
        "b_1.tif",
        "b_2.tif",
    ]
    status, _, errors = program_run("augment", "in/c.jpg", "-o", "out2", "--camera", "camera.yaml")
    assert status == 2
    assert "c.jpg" in errors
    status, _, errors = program_run(
        "augment", "in", "-o", "out3", "--camera", "camera.yaml", "--gain-db", "6:x"
    )
    assert status == 2
    assert "6:x" in errors


def test_preview_is_a_sheet_with_the_crop_pixel_by_pixel(program_run, tmp_path):
    image = np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), image)
    status, out, _ = program_run(
        "preview", "a.png", "--camera", "camera.yaml", "-o", "sheet.png", "--gain-db", "12"
    )
    assert status == 0
    assert "sRGB (8-bit colour)" in out
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    windows = np.lib.stride_tricks.sliding_window_view(sheet[..., 1], (40, 60))
    assert (windows == image[..., 1]).all((2, 3)).sum() == 1  # the picture as given, once
    assert program_run("preview", "a.png", "--camera", "camera.yaml", "-o", "sheet.jpg")[0] == 2
    assert program_run("preview", "no.png", "--camera", "camera.yaml", "-o", "sheet.png")[0] == 2


def test_a_camera_is_printed_as_its_file(program_run):
    status, out, _ = program_run("cameras", "sony_imx174")
    assert status == 0
    assert out == visaug.camera.shipped()["sony_imx174"].read_text()
    assert program_run("cameras", "camera.yaml")[1] == Path("camera.yaml").read_text()
    assert program_run("cameras", "no_such_camera")[0] == 2


def test_severity_needs_the_network(program_run):
    """Predictions in a file cannot be made again under noise, and curves without a camera mean nothing."""
    given = ("evaluate", "--predictions", "p.json", "--data", ".", "--domain", "x")
    status, _, err = program_run(*given, "--severity", "camera.yaml")
    assert status == 2
    assert "--severity" in err
    status, _, err = program_run("evaluate", "config.yaml", "--curve", "gain_db")
    assert status == 2
    assert "--curve" in err


def test_severity_is_told_after_the_bar(program_run, monkeypatch):
    """On a terminal a bar that is still there is drawn over what is said meanwhile."""
    events = []

    @contextmanager
    def bars(*_, **__):
        yield lambda *_: None
        events.append("bar ends")

    monkeypatch.setattr("visaug.app.cli.learn.progress_bars", bars)
    monkeypatch.setattr("visaug_train.commands.severity_curves", lambda *_: "curves: severity.csv")
    monkeypatch.setattr("click.echo", lambda text, **_: events.append(text))
    program_run("evaluate", "config.yaml", "--arm", "vis", "--severity", "camera.yaml")
    assert events == ["bar ends", "curves: severity.csv"]
