"""From an archive to a checked dataset."""

import shutil
import zipfile
from pathlib import Path

import pytest

from visaug.core.errors import InputError
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


def damaged_gzip(content):
    content[len(content) // 2 : len(content) // 2 + 50] = bytes(50)


def wrong_sum(content):
    content[-6] ^= 1  # in the checksum at the end


def cut(content):
    del content[-3000:]


@pytest.mark.parametrize("damage", [damaged_gzip, wrong_sum, cut])
def test_a_damaged_tar_is_refused(rendered, tmp_path, damage):
    packed = Path(shutil.make_archive(str(tmp_path / "set"), "gztar", rendered))
    content = bytearray(packed.read_bytes())
    damage(content)
    packed.write_bytes(content)
    with pytest.raises(InputError, match="damaged"):
        prepare_archive(packed, tmp_path / "data")
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(("at", "value"), [((6, 8), 1), ((8, 10), 99)], ids=["encrypted", "unknown method"])
def test_a_zip_that_cannot_be_unpacked_is_refused(archive, tmp_path, at, value):
    content = bytearray(Path(archive).read_bytes())
    with zipfile.ZipFile(archive) as opened:
        member = next(info for info in opened.infolist() if info.filename.endswith(".png"))
    directory = content.index(b"PK\x01\x02")
    while content[directory + 46 : directory + 46 + len(member.filename)] != member.filename.encode():
        directory = content.index(b"PK\x01\x02", directory + 4)
    content[member.header_offset + at[0]] = content[directory + at[1]] = value
    (tmp_path / "a.zip").write_bytes(content)
    assert main([str(tmp_path / "a.zip"), "-o", str(tmp_path / "data")]) == 2


def test_a_file_in_the_way_is_one_line(archive, tmp_path, capsys):
    (tmp_path / "data.partial").touch()
    assert main([archive, "-o", str(tmp_path / "data")]) == 2
    assert "Traceback" not in capsys.readouterr().err
