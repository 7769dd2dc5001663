"""From an archive to a checked dataset."""

import json
import shutil
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from visaug.app.cli import main
from visaug.core.errors import InputError
from visaug_train.archive import prepare_archive
from visaug_train.geometry import Keypoints
from visaug_train.speed import read_poses


@pytest.fixture(scope="module")
def archive(rendered, tmp_path_factory):
    """The rendered dataset packed as a download would be, in a folder."""
    folder = tmp_path_factory.mktemp("packed")
    shutil.copytree(rendered, folder / "in" / "speedplusv2", ignore=shutil.ignore_patterns("images_linear"))
    return shutil.make_archive(str(folder / "speedplusv2"), "zip", folder / "in")


def prepare(*words: object) -> int:
    """The status of `visaug prepare`."""
    try:
        main(["prepare", *map(str, words)])
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def test_one_command_makes_a_ready_dataset(archive, tmp_path, capsys):
    assert prepare(archive, "-o", tmp_path / "data", "--size", "80x50") == 0
    printed = capsys.readouterr().out
    assert "synthetic/train: 8 images" in printed
    assert "sunlamp/test: 4 images" in printed
    assert (tmp_path / "data" / "camera.json").is_file()
    assert len(list((tmp_path / "data-80x50" / "labels" / "val").iterdir())) == 4
    assert not (tmp_path / "data.partial").exists()
    assert prepare(archive, "-o", tmp_path / "data", "--size", "80x50") == 0


def test_a_folder_is_checked_where_it_lies_and_needs_no_output(rendered, tmp_path, capsys):
    root = tmp_path / "in" / "speedplus"
    shutil.copytree(rendered, root, ignore=shutil.ignore_patterns("images_linear"))
    before = sorted(root.rglob("*"))
    assert prepare(tmp_path / "in") == 0
    assert f"ready: {root}" in capsys.readouterr().out
    assert prepare(root, "-o", root) == 0
    for output in (tmp_path / "new", tmp_path):
        assert prepare(root, "-o", output) == 2
        error = capsys.readouterr().err
        assert f"-o: has no use: {root} is a folder" in error
        assert error.count("\n") == 1
    assert prepare(tmp_path / "in", "--coco", "--size", "80x50") == 0
    assert (tmp_path / "in" / "speedplus-coco" / "synthetic-train.json").is_file()
    assert (tmp_path / "in" / "speedplus-80x50" / "labels" / "val").is_dir()
    assert prepare(root, "-o", tmp_path / "new", "--coco") == 0
    assert (tmp_path / "new-coco" / "synthetic-train.json").is_file()
    assert not (tmp_path / "new").exists()
    assert sorted(root.rglob("*")) == before


def test_an_archive_needs_an_output(archive, tmp_path, capsys):
    assert prepare(archive) == 2
    assert "-o: is missing" in capsys.readouterr().err
    assert prepare(tmp_path / "none.zip") == 2
    assert "none.zip: no such file" in capsys.readouterr().err


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
    assert prepare(tmp_path / "text.zip", "-o", tmp_path / "a") == 2
    assert prepare(tmp_path / "none.zip", "-o", tmp_path / "a") == 2
    assert prepare(archive, "-o", tmp_path / "a", "--size", "big") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert all(line.startswith("visaug: ") for line in lines)


def test_member_outside_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "evil.zip", "w") as packed:
        packed.writestr("set/camera.json", "{}")
        packed.writestr("../outside.txt", "x")
    with pytest.raises(InputError, match=r"holds \.\./outside\.txt"):
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
    assert prepare(tmp_path / "a.zip", "-o", tmp_path / "data") == 2


def test_a_file_in_the_way_is_one_line(archive, tmp_path, capsys):
    (tmp_path / "data.partial").touch()
    assert prepare(archive, "-o", tmp_path / "data") == 2
    assert "Traceback" not in capsys.readouterr().err


def test_an_archive_must_be_what_the_destination_was_made_of(archive, rendered, tmp_path):
    data = prepare_archive(archive, tmp_path / "data")
    with pytest.raises(InputError, match="no such file"):
        prepare_archive(tmp_path / "none.zip", data)
    other = tmp_path / "other.zip"
    with zipfile.ZipFile(archive) as source, zipfile.ZipFile(other, "w") as packed:
        for info in source.infolist():
            packed.writestr(info, source.read(info))
        packed.writestr("speedplusv2/lightbox/images/one_more.png", b"x")
    with pytest.raises(InputError, match=r"is not what .*other\.zip holds: one_more\.png is missing"):
        prepare_archive(other, data)
    assert prepare_archive(archive, data) == data


def test_an_archive_of_something_else_is_refused_before_it_is_unpacked(tmp_path):
    with zipfile.ZipFile(tmp_path / "photos.zip", "w") as packed:
        packed.writestr("photos/1.jpg", "x")
    with pytest.raises(InputError, match="no SPEED or SPEED\\+ layout"):
        prepare_archive(tmp_path / "photos.zip", tmp_path / "data")
    assert not (tmp_path / "data.partial").exists()


def test_sets_without_labels_serve_for_submissions(rendered, tmp_path, capsys):
    """SPEED+ as it was before 2023: the laboratory's lists name the images alone."""
    shutil.copytree(rendered, tmp_path / "old")
    listing = tmp_path / "old" / "lightbox" / "test.json"
    records = json.loads(listing.read_text())
    listing.write_text(json.dumps([{"filename": record["filename"]} for record in records]))
    assert prepare(tmp_path / "old", "-o", tmp_path / "old") == 0
    printed = capsys.readouterr().out
    assert "lightbox/test: 4 images, no labels" in printed
    assert "speedplusv2" in printed
    with pytest.raises(InputError, match=r"lightbox/test\.json: the images have no poses"):
        read_poses(tmp_path / "old", "lightbox")
    assert not read_poses(tmp_path / "old", "lightbox", labels=False).labelled


def test_coco_annotations_are_read_by_pycocotools_and_hold_the_projected_points(rendered, tmp_path):
    coco = pytest.importorskip("pycocotools.coco")
    data = shutil.copytree(rendered, tmp_path / "data")
    assert prepare(data, "-o", data, "--coco") == 0
    read = coco.COCO(str(tmp_path / "data-coco" / "lightbox-test.json"))
    poses, tango = read_poses(data, "lightbox"), Keypoints.load()
    assert read.cats[1]["keypoints"] == list(tango.names)
    for i, file in enumerate(poses.files):
        assert data / read.imgs[i + 1]["file_name"] == file
        (found,) = read.imgToAnns[i + 1]
        x, y, z, w = np.roll(poses.quaternions[i], -1)
        turn = Rotation.from_quat([x, y, z, w]).as_rotvec()
        camera = poses.camera
        true = cv2.projectPoints(
            tango.points_m, turn, poses.translations[i], camera.matrix, camera.distortion
        )[0][:, 0]
        points = np.reshape(found["keypoints"], (-1, 3))
        inside = ((true >= 0) & (true <= [camera.width, camera.height])).all(axis=1)
        assert (points[:, 2] == np.where(inside, 2, 0)).all()
        np.testing.assert_allclose(points[inside, :2], true[inside], atol=2e-3)
        assert found["num_keypoints"] == inside.sum()
        low = np.clip(true.min(axis=0), 0, None)
        np.testing.assert_allclose(found["bbox"][:2], low, atol=2e-3)
