"""From an archive to a checked dataset."""

import shutil
import zipfile

import pytest

from visaug.errors import InputError
from visaug_train.archive import main, prepare_archive


@pytest.fixture(scope="module")
def archive(rendered, tmp_path_factory):
    """The rendered dataset packed as a download would be, in a folder."""
    folder = tmp_path_factory.mktemp("packed")
    shutil.copytree(rendered, folder / "in" / "speedplusv2", ignore=shutil.ignore_patterns("images_linear"))
    return shutil.make_archive(str(folder / "speedplusv2"), "zip", folder / "in")


def test_one_command_makes_a_ready_dataset(archive, tmp_path, capsys):
    assert main([archive, "-o", str(tmp_path / "data"), "--size", "80x50"]) == 0
    printed = capsys.readouterr().out
    assert "synthetic/train: 8 images" in printed
    assert "sunlamp/test: 4 images" in printed
    assert (tmp_path / "data" / "camera.json").is_file()
    assert len(list((tmp_path / "data-80x50" / "labels" / "val").iterdir())) == 4
    assert not (tmp_path / "data.partial").exists()
    assert main([archive, "-o", str(tmp_path / "data"), "--size", "80x50"]) == 0


def test_tar_is_unpacked_too(rendered, tmp_path):
    packed = shutil.make_archive(str(tmp_path / "set"), "gztar", rendered)
    assert (prepare_archive(packed, tmp_path / "data") / "synthetic" / "train.json").is_file()


def test_interrupted_unpacking_goes_on(archive, tmp_path):
    def stop(_title, done, _total):
        if done == 15:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        prepare_archive(archive, tmp_path / "data", stop)
    assert not (tmp_path / "data").exists()
    made = {f: f.stat().st_mtime_ns for f in (tmp_path / "data.partial").rglob("*.png")}
    assert made
    prepare_archive(archive, tmp_path / "data")
    partial = tmp_path / "data.partial" / "speedplusv2"
    kept = [(tmp_path / "data" / f.relative_to(partial)).stat().st_mtime_ns == t for f, t in made.items()]
    assert all(kept)


def test_wrong_archives_end_with_one_line(archive, tmp_path, capsys):
    (tmp_path / "text.zip").write_text("no archive")
    assert main([str(tmp_path / "text.zip"), "-o", str(tmp_path / "a")]) == 2
    assert main([str(tmp_path / "none.zip"), "-o", str(tmp_path / "a")]) == 2
    assert main([archive, "-o", str(tmp_path / "a"), "--size", "big"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert all(line.startswith("prepare_speed: ") for line in lines)


def test_member_outside_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "evil.zip", "w") as packed:
        packed.writestr("../outside.txt", "x")
    with pytest.raises(InputError, match="outside"):
        prepare_archive(tmp_path / "evil.zip", tmp_path / "data")
    assert not (tmp_path / "outside.txt").exists()
