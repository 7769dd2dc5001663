"""How commands end: errors of the operating system in one line with status 2, SIGTERM as Ctrl-C, nothing half-written."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image

from visaug.app.cli import main

CAMERA = "{resolution: [48, 64], bit_depth: 12, gain_e_per_dn: 2.0, read_noise: {sigma_e: 4.0}}"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "camera.yaml").write_text(CAMERA)
    (tmp_path / "plan.csv").write_text(
        "sequence,file,kind\n" + "".join(f"{i},b{i}.tif,bias\n" for i in range(40))
    )
    (tmp_path / "photos").mkdir()
    pixels = np.random.default_rng(2).integers(0, 255, (96, 128, 3)).astype(np.uint8)
    for i in range(6):
        Image.fromarray(pixels).save(tmp_path / "photos" / f"{i}.png")
    return tmp_path


def augment(output, camera="camera.yaml"):
    return ["augment", "photos", "-o", str(output), "--camera", str(camera)]


def simulate(output, camera="camera.yaml"):
    return ["simulate", "plan.csv", "-o", str(output), "--camera", str(camera)]


def one_line(capsys, words):
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("visaug: ")]
    assert len(said) == 1
    return said[0]


@pytest.mark.parametrize("command", [augment, simulate])
def test_places_that_cannot_be_written(folder, capsys, command):
    (folder / "file").touch()
    (folder / "loop").symlink_to(folder / "loop")
    for place in ("file", "file/below", "loop", "loop/below", "x" * 300):
        one_line(capsys, command(place))
    for camera in ("x" * 300, "loop", "file", "photos"):
        one_line(capsys, command("out", camera))
    assert sorted(path.name for path in folder.iterdir() if path.name != "out") == [
        "camera.yaml",
        "file",
        "loop",
        "photos",
        "plan.csv",
    ]
    assert not list(folder.rglob("*.png.*"))


@pytest.fixture
def tiny_disk(tmp_path):
    """A file system of 64 KiB; needs the right to mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", place], capture_output=True, check=False
    ).returncode:
        pytest.skip("cannot mount a file system")
    yield place
    subprocess.run(["umount", place], check=True)


@pytest.mark.skipif(sys.platform != "linux", reason="mounts a tmpfs")
@pytest.mark.parametrize("command", [augment, simulate])
def test_a_full_disk_is_told_and_holds_nothing_half_written(folder, tiny_disk, capsys, command):
    assert "No space left" in one_line(capsys, command(tiny_disk / "out"))
    assert not list(tiny_disk.rglob(".visaug-half-*"))
    for file in tiny_disk.rglob("*.png"):  # those that found room are whole
        assert np.asarray(Image.open(file)).shape == (96, 128, 3)


def test_a_terminated_command_says_so_and_cleans_up(folder):
    words = [sys.executable, "-c", WAITS, *augment("out")]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while not list(folder.rglob(".visaug-half-*")) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 143
    assert "visaug: terminated; run the same command again to resume" in said
    assert not list(folder.rglob(".visaug-half-*"))


WAITS = """
import sys, time
import visaug.augment.files as files
real = files.write_picture
files.write_picture = lambda *a: (real(*a), time.sleep(100))
from visaug.app.cli import main
main(sys.argv[1:])
"""


def test_a_name_that_the_terminal_cannot_show_is_escaped(folder):
    """An encoding of the terminal without replacements, as most locales have it."""
    names = ["-m", "visaug", *augment(os.fsdecode(b"caf\xe9"))]
    env = {**os.environ, "PYTHONIOENCODING": "utf-8:strict"}
    done = subprocess.run([sys.executable, *names], env=env, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert b"caf\\udce9" in done.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="has other pipes")
@pytest.mark.parametrize("words", [["effects"], ["cameras", "sony_imx174"], ["augment", "--help"]])
def test_a_reader_that_leaves_is_no_failure(words):
    """As `head` does. One pipe without a reader stands for it."""
    reading, writing = os.pipe()
    os.close(reading)
    program = [sys.executable, "-m", "visaug", *words]
    done = subprocess.run(program, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(sys.platform == "win32", reason="has no sh")
def test_a_closed_output_is_no_failure():
    """A shell closes it by `>&-`."""
    told = subprocess.run(["sh", "-c", f"'{sys.executable}' -m visaug effects >&-"], check=False)
    assert told.returncode == 0
