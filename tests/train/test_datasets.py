"""Readers of pose data, on small made data in the layouts as published; projections by OpenCV."""

import dataclasses
import json
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from visaug.core.errors import InputError
from visaug_train.archive import prepare_archive, prepare_dataset
from visaug_train.checks import check_target
from visaug_train.commands import evaluate_predictions
from visaug_train.convert import convert, label_lines
from visaug_train.datasets import domains, keypoints_of, read_poses
from visaug_train.geometry import Keypoints

K = np.array([[300.0, 0, 80], [0, 310.0, 50], [0, 0, 1]])
SIZE = (160, 100)
BOX_MM = {
    "min_x": -300.0,
    "min_y": -200.0,
    "min_z": -400.0,
    "size_x": 600.0,
    "size_y": 400.0,
    "size_z": 800.0,
}
TRUTH = [(Rotation.random(random_state=i), np.array([0.1 * i - 0.2, 0.05 * i, 6.0 + i])) for i in range(8)]


def picture(file: Path, size: tuple[int, int] = SIZE) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(file), np.full((size[1], size[0]), 90, np.uint8))


def write(file: Path, content: object) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(content if isinstance(content, str) else json.dumps(content))


def projected(points_m: np.ndarray, turn: Rotation, shift: np.ndarray, matrix: np.ndarray = K) -> np.ndarray:
    return cv2.projectPoints(points_m, turn.as_rotvec(), shift, matrix, np.zeros(5))[0][:, 0]


def result(name: str, points: np.ndarray) -> dict:
    low, high = points.min(axis=0), points.max(axis=0)
    triples = np.column_stack([points, np.ones(len(points))])
    return {
        "file_name": name,
        "bbox": [*low, *(high - low)],
        "keypoints": triples.ravel().tolist(),
        "score": 0.9,
    }


def corners_m() -> np.ndarray:
    low = np.array([BOX_MM[f"min_{a}"] for a in "xyz"])
    size = np.array([BOX_MM[f"size_{a}"] for a in "xyz"])
    return np.array([low + size * (x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]) / 1000


def make_bop(root: Path) -> None:
    """Two scenes of two images for train, one of each for val and test; file names repeat over the scenes."""
    write(root / "models" / "models_info.json", {"3": {"diameter": 1077.0, **BOX_MM}})
    at = iter(TRUTH)
    for scene in ("train_pbr/000000", "train_pbr/000001", "val_pbr/000000", "test/000000"):
        cameras, truths = {}, {}
        for number in range(2):
            turn, shift = next(at)
            picture(root / scene / "rgb" / f"{number:06d}.png")
            cameras[str(number)] = {"cam_K": K.ravel().tolist(), "depth_scale": 1.0}
            pose = {
                "obj_id": 3,
                "cam_R_m2c": turn.as_matrix().ravel().tolist(),
                "cam_t_m2c": (1000 * shift).tolist(),
            }
            truths[str(number)] = [pose]
        write(root / scene / "scene_camera.json", cameras)
        write(root / scene / "scene_gt.json", truths)


def test_bop_poses_and_corners(tmp_path: Path) -> None:
    """Millimetres, row-wise rotations and the corners' order: projections agree with OpenCV's of the same numbers."""
    make_bop(tmp_path)
    assert domains(tmp_path) == {"bop": ("test",), "pbr": ("train", "validation")}
    poses = read_poses(tmp_path, "pbr", "train")
    keypoints = keypoints_of("tango", poses)
    np.testing.assert_allclose(keypoints.points_m, corners_m())
    expected = [projected(corners_m(), *pose) for pose in TRUTH[:4]]
    np.testing.assert_allclose(poses.targets(keypoints).points, expected, atol=1e-6)
    assert poses.ids[3] == "000001/rgb/000001.png"


def test_bop_training_labels_are_one_a_scene(tmp_path: Path) -> None:
    """Images of the same name in two scenes stay two."""
    make_bop(tmp_path / "data")
    poses = read_poses(tmp_path / "data", "pbr", "train")
    convert({"train": poses}, keypoints_of("tango", poses), tmp_path / "labels")
    files = {file.stem for file in (tmp_path / "labels" / "labels" / "train").iterdir()}
    images = {file.stem for file in (tmp_path / "labels" / "images" / "train").iterdir()}
    assert len(files) == 4
    assert files == images


def test_predictions_are_scored_on_bop(tmp_path: Path) -> None:
    """Exact points give AP 1 and no pose error; the same file with the two scenes exchanged does not."""
    make_bop(tmp_path)
    names = [f"{s:06d}/rgb/{n:06d}.png" for s in range(2) for n in range(2)]
    for order, good in (([0, 1, 2, 3], True), ([2, 3, 0, 1], False)):
        records = [result(n, projected(corners_m(), *TRUTH[o])) for n, o in zip(names, order)]
        write(tmp_path / "p.json", records)
        scores = evaluate_predictions(tmp_path / "p.json", tmp_path, "pbr", split="train")["pbr"]
        assert (scores["keypoint_ap50_95"]["coco"] > 0.999) == good
        assert (scores["attitude_error_deg"] < 0.01) == good


def test_bop_of_two_cameras_or_targets_is_refused(tmp_path: Path) -> None:
    make_bop(tmp_path)
    truths = json.loads((tmp_path / "test/000000/scene_gt.json").read_text())
    write(tmp_path / "test/000000/scene_gt.json", {**truths, "1": truths["1"] * 2})
    with pytest.raises(InputError, match="one target"):
        read_poses(tmp_path, "bop")
    cameras = json.loads((tmp_path / "val_pbr/000000/scene_camera.json").read_text())
    cameras["1"]["cam_K"][0] = 500.0
    write(tmp_path / "val_pbr/000000/scene_camera.json", cameras)
    with pytest.raises(InputError, match="one camera"):
        read_poses(tmp_path, "pbr", "validation")


def make_coco(root: Path, layout: str) -> np.ndarray:
    """Three images of four points, of which the last has no target; returns the points of the first two."""
    points = np.array(
        [[[20, 30], [60, 30], [60, 70], [20, 70]], [[90, 10], [140, 20], [130, 80], [95, 90]]], float
    )
    for split, folder in (("train2017", "train2017"), ("val2017", "val2017")):
        if layout == "images":
            folder, split = "images", split.removesuffix("2017")
        for number in range(3):
            picture(root / folder / f"{split}_{number}.jpg")
        annotations = [
            {
                "id": i + 1,
                "image_id": 10 + i,
                "category_id": 7,
                "iscrowd": 0,
                "bbox": [*p.min(axis=0), *np.ptp(p, axis=0)],
                "area": float(np.prod(np.ptp(p, axis=0))),
                "num_keypoints": 4 - i,
                "keypoints": np.column_stack([p, [2, 2, 1, 2 - 2 * i]]).ravel().tolist(),
            }
            for i, p in enumerate(points)
        ]
        images = [
            {"id": 10 + i, "file_name": f"{split}_{i}.jpg", "width": SIZE[0], "height": SIZE[1]}
            for i in range(3)
        ]
        category = {
            "id": 7,
            "name": "probe",
            "keypoints": list("abcd"),
            "flip_idx": [1, 0, 3, 2],
            "skeleton": [],
        }
        stem = f"person_keypoints_{split}" if layout == "published" else split
        content = {"images": images, "annotations": annotations, "categories": [category]}
        write(root / "annotations" / f"{stem}.json", content)
    return points


@pytest.mark.parametrize("layout", ["published", "images"])
def test_coco_labels_and_scores(tmp_path: Path, layout: str) -> None:
    """Number, names and flip pairs of the points come from the annotations; there are no pose errors."""
    points = make_coco(tmp_path, layout)
    domain, split = ("person_keypoints", "2017") if layout == "published" else ("coco", "")
    assert domains(tmp_path) == {domain: ("train", "validation")}
    poses = read_poses(tmp_path, domain, "train")
    keypoints = keypoints_of("tango", poses)
    assert keypoints.names == tuple("abcd")
    assert keypoints.flip == (1, 0, 3, 2)
    targets = poses.targets(keypoints)
    assert targets.seen.tolist() == [True, True, False]
    assert targets.inside[:2].tolist() == [[True] * 4, [True, True, True, False]]
    records = [result(f"val{split}_{i}.jpg", p) for i, p in enumerate(points)]
    write(tmp_path / "p.txt", records)
    scores = evaluate_predictions(tmp_path / "p.txt", tmp_path, domain, split="validation")[domain]
    assert scores["keypoint_ap50_95"]["coco"] == pytest.approx(1)
    assert scores["box_ap50_95"] == pytest.approx(1)
    assert scores["attitude_error_deg"] is None
    convert({"train": poses}, keypoints, tmp_path / "labels")
    row = np.loadtxt(tmp_path / f"labels/labels/train/train{split}_0.txt")
    np.testing.assert_allclose(row[1:5], [40 / 160, 50 / 100, 40 / 160, 40 / 100])
    np.testing.assert_allclose(row[5:].reshape(4, 3)[:, :2] * SIZE, points[0], atol=1e-3)


def test_coco_of_two_targets_or_sizes_is_refused(tmp_path: Path) -> None:
    make_coco(tmp_path, "images")
    file = tmp_path / "annotations" / "train.json"
    content = json.loads(file.read_text())
    write(file, {**content, "annotations": content["annotations"] + content["annotations"][:1]})
    with pytest.raises(InputError, match="second target"):
        read_poses(tmp_path, "coco", "train")
    content["images"][0]["width"] = 99
    write(file, content)
    with pytest.raises(InputError, match="sizes"):
        read_poses(tmp_path, "coco", "train")


def test_prepare_unpacks_bop(tmp_path: Path) -> None:
    """From the archive to labels in one call; the layout may lie in a folder."""
    make_bop(tmp_path / "probe_bop")
    with tarfile.open(tmp_path / "probe.tar.gz", "w:gz") as archive:
        archive.add(tmp_path / "probe_bop", "probe_bop")
    said = prepare_dataset(tmp_path / "probe.tar.gz", tmp_path / "ready", size="80x50", coco=True)
    assert "pbr/train: 4 images" in said
    assert len(list((tmp_path / "ready-80x50/labels/train").iterdir())) == 4
    assert (tmp_path / "ready-coco/pbr-train.json").is_file()
    assert prepare_archive(tmp_path / "probe_bop", tmp_path / "probe_bop") == tmp_path / "probe_bop"


POINTS_M = np.array([[0.3, 0.2, 0.1], [-0.3, 0.2, 0.0], [0.3, -0.2, 0.0], [0.0, 0.1, -0.4]])


def points_file(folder: Path) -> Path:
    write(folder / "points.yaml", f"points_m: {POINTS_M.tolist()}")
    return folder / "points.yaml"


def scalar_first(turn: Rotation) -> list[float]:
    x, y, z, w = turn.as_quat()
    return [float(w), float(x), float(y), float(z)]


def camera_json(size: tuple[int, int] = SIZE) -> dict:
    return {"Nu": size[0], "Nv": size[1], "cameraMatrix": K.tolist(), "distCoeffs": [0] * 5}


def speed_record(name: str, turn: Rotation, shift: np.ndarray) -> dict:
    return {"filename": name, "q_vbs2tango_true": scalar_first(turn), "r_Vo2To_vbs_true": shift.tolist()}


def check_scores(
    root: Path, domain: str, split: str, tmp_path: Path, matrix: np.ndarray, truths: list
) -> None:
    """Predictions projected by OpenCV from the truth that was written have no error."""
    poses = read_poses(root, domain, split)
    records = [result(n, projected(POINTS_M, *t, matrix)) for n, t in zip(poses.ids, truths, strict=True)]
    write(tmp_path / "p.json", records)
    scores = evaluate_predictions(tmp_path / "p.json", root, domain, points_file(tmp_path), split)[domain]
    assert scores["keypoint_ap50_95"]["coco"] == pytest.approx(1)
    assert scores["position_error"] < 1e-4
    assert scores["attitude_error_deg"] < 0.02


def test_shirt(tmp_path: Path) -> None:
    """Both domains of a trajectory have its poses; Tango's keypoints need not be given."""
    root = tmp_path / "shirtv1"
    write(root / "camera.json", camera_json())
    for trajectory in ("roe1", "roe2"):
        names = [f"img{i:06d}.jpg" for i in range(3)]
        truths = TRUTH[:3] if trajectory == "roe1" else TRUTH[3:6]
        records = [speed_record(n, *t) for n, t in zip(names, truths)]
        write(root / trajectory / f"{trajectory}.json", records)
        write(root / trajectory / "metadata.json", {"pSim": {}})
        for source in ("synthetic", "lightbox"):
            for name in names:
                picture(root / trajectory / source / "images" / name)
    assert set(domains(root)) == {f"roe{i}_{s}" for i in (1, 2) for s in ("synthetic", "lightbox")}
    check_scores(root, "roe2_lightbox", "test", tmp_path, K, TRUTH[3:6])
    assert len(keypoints_of("tango", read_poses(root, "roe1_synthetic"))) == 11
    assert "ready" in prepare_dataset(root, root)


def test_spe3r(tmp_path: Path) -> None:
    """The authors' split of the images, and no keypoints of Tango by mistake."""
    root = tmp_path / "spe3r"
    write(root / "camera.json", camera_json())
    write(root / "splits.csv", "aqua,train\nsmart_1,test\n")
    numbers = (1, 400, 401, 501, 901, 1000)
    for name in ("aqua", "smart_1"):
        records = [speed_record(f"img{n:06d}", *t) for n, t in zip(numbers, TRUTH)]
        write(root / name / "labels.json", records)
        for number in numbers:
            picture(root / name / "images" / f"img{number:06d}.jpg")
    assert domains(root) == {"aqua": ("train", "validation"), "smart_1": ("test",)}
    check_scores(root, "aqua", "validation", tmp_path, K, [TRUTH[2], TRUTH[4], TRUTH[5]])
    assert len(read_poses(root, "smart_1")) == 6
    with pytest.raises(InputError, match="aqua and brings no keypoints"):
        keypoints_of("tango", read_poses(root, "aqua", "train"))


def test_spark_2022(tmp_path: Path) -> None:
    """The quaternion's scalar is the last column, and images lie in folders of sequences."""
    root = tmp_path / "Data"
    matrix = np.array(
        [[1744.92206139719, 0, 737.272795902663], [0, 1746.58640701753, 528.471960188736], [0, 0, 1]]
    )
    for word, truths in (("train", TRUTH[:2]), ("val", TRUTH[2:4])):
        lines = ["sequence,filename,Tx,Ty,Tz,Qx,Qy,Qz,Qw"]
        for i, (turn, shift) in enumerate(truths):
            lines.append(
                ",".join(["GT001", f"img{i}_GT001.png", *map(repr, map(float, [*shift, *turn.as_quat()]))])
            )
            picture(root / word / "images" / "GT001" / f"img{i}_GT001.png", (1440, 1080))
        write(root / word / f"{word}.csv", "\n".join(lines))
    assert domains(root) == {"spark": ("train", "validation")}
    check_scores(root, "spark", "validation", tmp_path, matrix, TRUTH[2:4])
    write(root / "val" / "val.csv", lines[0] + "\nGT001,img0_GT001.png,0,0,x,0,0,0,1\n")
    with pytest.raises(InputError, match="line 2, Tz"):
        read_poses(root, "spark", "validation")


@pytest.mark.parametrize("nested", [False, True])
def test_spacesense(tmp_path: Path, nested: bool) -> None:
    """AirSim's axes (forward, right, down) become OpenCV's: a target ahead and to the right is at larger columns."""
    root = tmp_path / "raw"
    folder = root / "ACE" / "ACE" if nested else root / "ACE"
    turn, head = Rotation.random(random_state=3), "target_spacecraft_in_camera_"
    names = [*(f"{head}pos_{a}(m)" for a in "xyz"), *(f"{head}quat_{a}" for a in "wxyz")]
    row = [8.0, 0.5, 0.25, *scalar_first(turn)]
    for sequence in ("approach_front", "orbit_xy"):
        write(
            folder / sequence / "pose_ground_truth.csv",
            f"timestamp,{','.join(names)}\n2026,{str(row)[1:-1]}\n",
        )
        picture(folder / sequence / "image" / "2026.png", (128, 128))
    assert domains(root) == {"ACE": ("validation",)}
    poses = read_poses(root, "ACE")
    assert poses.ids == ("approach_front/image/2026.png", "orbit_xy/image/2026.png")
    ahead, right, down = (turn.apply(POINTS_M) + np.array([8.0, 0.5, 0.25])).T
    focal_px = 64 / np.tan(np.radians(25))
    expected = np.column_stack([64 + focal_px * right / ahead, 64 + focal_px * down / ahead])
    keypoints = keypoints_of(points_file(tmp_path), poses)
    np.testing.assert_allclose(poses.targets(keypoints).points, [expected] * 2, atol=1e-6)


def test_the_reader_of_the_page_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example of docs/datasets.md, as it stands there."""
    from visaug_train import datasets

    monkeypatch.setattr(datasets, "READERS", list(datasets.READERS))
    page = (Path(__file__).parents[2] / "docs" / "datasets.md").read_text()
    exec(page.partition("```python\n")[2].partition("```")[0], {})
    turn, shift = TRUTH[1]
    row = ",".join(["a.png", *map(str, scalar_first(turn)), *map(str, shift)])
    write(tmp_path / "poses.csv", f"file,w,x,y,z,rx,ry,rz\n{row}\n")
    picture(tmp_path / "images" / "a.png")
    assert domains(tmp_path) == {"mine": ("test",)}
    np.testing.assert_allclose(read_poses(tmp_path, "mine").translations, [shift])


def make_shirt(root: Path) -> None:
    """Two trajectories of six images whose names are the same."""
    write(root / "camera.json", camera_json())
    for number, trajectory in enumerate(("roe1", "roe2")):
        names = [f"img{i:06d}.jpg" for i in range(3)]
        truths = TRUTH[3 * number : 3 * number + 3]
        write(root / trajectory / f"{trajectory}.json", [speed_record(n, *t) for n, t in zip(names, truths)])
        for name in names:
            picture(root / trajectory / "lightbox" / "images" / name)


@pytest.mark.parametrize(
    "form", ["{t}/lightbox/images/", "/data/roe2/shirt/{t}/lightbox/images/", "{t}_lightbox/"]
)
def test_a_trajectory_is_told_by_its_folders(tmp_path: Path, form: str) -> None:
    """Exact points of both trajectories score 1 on each, and those of the other one alone are refused."""
    root, tango = tmp_path / "shirt", Keypoints.load()
    make_shirt(root)
    records = {}
    for number, trajectory in enumerate(("roe1", "roe2")):
        points = [projected(tango.points_m, *t) for t in TRUTH[3 * number : 3 * number + 3]]
        names = [f"{form.format(t=trajectory)}img{i:06d}.jpg" for i in range(3)]
        records[trajectory] = [result(*each) for each in zip(names, points)]
    write(tmp_path / "p.json", records["roe1"] + records["roe2"])
    for domain in ("roe1_lightbox", "roe2_lightbox"):
        scores = evaluate_predictions(tmp_path / "p.json", root, domain)[domain]
        assert scores["attitude_error_deg"] < 0.01
    write(tmp_path / "p.json", records["roe2"])
    with pytest.raises(InputError, match="names no image of roe1_lightbox"):
        evaluate_predictions(tmp_path / "p.json", root, "roe1_lightbox")


def test_a_bop_split_is_told_by_its_folder(tmp_path: Path) -> None:
    """`val_pbr` and `test` hold scenes and images of the same names; both are of other objects' poses."""
    make_bop(tmp_path)
    names = [f"000000/rgb/{n:06d}.png" for n in range(2)]
    sets = {"val_pbr": TRUTH[4:6], "test": TRUTH[6:8], "train_pbr": TRUTH[:2]}
    records = [
        result(f"{folder}/{name}", projected(corners_m(), *pose))
        for folder, poses in sets.items()
        for name, pose in zip(names, poses)
    ]
    write(tmp_path / "p.json", records)
    for domain, split in (("pbr", "validation"), ("bop", "test")):
        scores = evaluate_predictions(tmp_path / "p.json", tmp_path, domain, split=split)[domain]
        assert scores["attitude_error_deg"] < 0.01


def test_each_set_has_the_points_of_its_own_object(tmp_path: Path) -> None:
    """Object 1 has half the size of object 3: the box of its annotation is half as wide."""
    make_bop(tmp_path / "data")
    models = {"3": BOX_MM, "1": {key: value / 2 for key, value in BOX_MM.items()}}
    write(tmp_path / "data/models/models_info.json", models)
    file = tmp_path / "data/test/000000/scene_gt.json"
    write(file, {key: [each[0] | {"obj_id": 1}] for key, each in json.loads(file.read_text()).items()})
    prepare_dataset(tmp_path / "data", coco=True)
    for name, object_id in (("bop-test", 1), ("pbr-train", 3)):
        made = json.loads((tmp_path / f"data-coco/{name}.json").read_text())
        assert made["categories"][0]["name"] == f"obj_{object_id:06d}"
    half = projected(corners_m() / 2, *TRUTH[6])
    made = json.loads((tmp_path / "data-coco/bop-test.json").read_text())["annotations"][0]
    np.testing.assert_allclose(np.reshape(made["keypoints"], (-1, 3))[:, :2], half, atol=0.01)


def test_a_network_is_not_scored_on_another_spacecraft(tmp_path: Path) -> None:
    make_bop(tmp_path)
    trained, other = read_poses(tmp_path, "pbr", "train"), read_poses(tmp_path, "bop")
    points = keypoints_of("tango", trained)
    check_target("tango", points, trained, other)
    assert other.keypoints is not None
    smaller = dataclasses.replace(other.keypoints, name="obj_000001", points_m=other.keypoints.points_m / 2)
    with pytest.raises(InputError, match="shows obj_000001, whose points are not those of obj_000003"):
        check_target("tango", points, trained, dataclasses.replace(other, keypoints=smaller))
    with pytest.raises(InputError, match="shows obj_000003, whose points are not those of tango"):
        check_target("tango", Keypoints.load(), dataclasses.replace(trained, spacecraft="tango"), other)
    check_target("own.yaml", Keypoints.load(), trained, other)


def test_copies_for_training_need_a_train_split(tmp_path: Path) -> None:
    make_shirt(tmp_path / "shirt")
    with pytest.raises(InputError, match=r"--size: .* has no labelled train split"):
        prepare_dataset(tmp_path / "shirt", size="80x50")
    for size in ("99999999x5", "5x0", "65536x5", "x", "9" * 5000 + "x5"):
        with pytest.raises(InputError, match="is not a size"):
            prepare_dataset(tmp_path / "shirt", size=size)


def test_domains_that_are_not_converted_are_said(tmp_path: Path) -> None:
    root = tmp_path / "spe3r"
    write(root / "camera.json", camera_json())
    write(root / "splits.csv", "aqua,train\nbqua,train\n")
    for name in ("aqua", "bqua"):
        write(root / name / "labels.json", [speed_record(f"img{n:06d}", *TRUTH[n % 8]) for n in (1, 401)])
        for number in (1, 401):
            picture(root / name / "images" / f"img{number:06d}.jpg")
    said = prepare_dataset(root, size="80x50", keypoints=str(points_file(tmp_path)))
    assert "note: --size converts the first domain with a train split, aqua; not bqua" in said


def changed(file: Path, part: str, **values: object) -> None:
    """Changes the first entry of a part of a COCO file."""
    content = json.loads(file.read_text())
    content[part][0] |= values
    write(file, content)


def test_coco_annotations_are_cut_at_the_border(tmp_path: Path) -> None:
    """A point and a box outside give labels that ultralytics takes: shares from 0 to 1, no visibility outside."""
    make_coco(tmp_path, "images")
    points = [[165, 30, 1], [60, 30, 2], [60, 70, 2], [20, -3, 2]]
    changed(
        tmp_path / "annotations/train.json",
        "annotations",
        bbox=[20, -3, 145, 73],
        keypoints=np.ravel(points).tolist(),
    )
    poses = read_poses(tmp_path, "coco", "train")
    line, *_ = label_lines(poses, keypoints_of("tango", poses))
    numbers = np.array(line.split(), float)
    np.testing.assert_allclose(numbers[1:5], [90 / 160, 35 / 100, 140 / 160, 70 / 100], atol=1e-6)
    assert numbers[5:].reshape(4, 3)[:, 2].tolist() == [0, 2, 2, 0]
    assert (numbers >= 0).all()
    assert (numbers[1:] <= 2).all()


def test_coco_without_annotations_has_no_labels(tmp_path: Path) -> None:
    make_coco(tmp_path, "images")
    file = tmp_path / "annotations/val.json"
    write(file, json.loads(file.read_text()) | {"annotations": []})
    with pytest.raises(InputError, match="no labels"):
        read_poses(tmp_path, "coco", "validation")
    write(tmp_path / "p.txt", [result("val_0.jpg", np.array([[2, 3], [40, 3], [40, 30], [2, 30.0]]))])
    for more, message in (({}, "nothing to score"), ({"poses_csv": tmp_path / "s.csv"}, "no pose follows")):
        with pytest.raises(InputError, match=message):
            evaluate_predictions(tmp_path / "p.txt", tmp_path, "coco", split="validation", **more)


@pytest.mark.parametrize(
    ("part", "values", "message"),
    [
        ("annotations", {"bbox": [1, 1, -5, 4]}, "annotations.0.bbox: a width or height is negative"),
        ("annotations", {"image_id": [10]}, "annotations.0.image_id: names no image"),
        ("images", {"id": [10]}, "images.0: is malformed"),
        ("categories", {"flip_idx": [1, "a", 0, 2]}, "flip_idx: is no order"),
        ("categories", {"flip_idx": [1, 0, 2, True]}, "flip_idx: is no order"),
    ],
)
def test_malformed_coco_is_one_line(tmp_path: Path, part: str, values: dict, message: str) -> None:
    make_coco(tmp_path, "images")
    changed(tmp_path / "annotations/train.json", part, **values)
    with pytest.raises(InputError, match=message):
        read_poses(tmp_path, "coco", "train")


@pytest.mark.parametrize("key", ["a", "-1", "\u00b2", "1.5"])
def test_a_bop_key_that_is_no_number_is_one_line(tmp_path: Path, key: str) -> None:
    make_bop(tmp_path)
    file = tmp_path / "test/000000/scene_camera.json"
    write(file, {key: json.loads(file.read_text())["0"]})
    with pytest.raises(InputError, match="is no image's number"):
        read_poses(tmp_path, "bop")


@pytest.mark.parametrize("number", [[1], None, "x", 1.5, {}])
def test_a_bop_object_that_is_no_number_is_one_line(tmp_path: Path, number: object) -> None:
    make_bop(tmp_path)
    file = tmp_path / "test/000000/scene_gt.json"
    write(file, {key: [each[0] | {"obj_id": number}] for key, each in json.loads(file.read_text()).items()})
    with pytest.raises(InputError, match=r"0\.obj_id: is no object's number"):
        read_poses(tmp_path, "bop")


def test_malformed_spe3r_is_one_line(tmp_path: Path) -> None:
    write(tmp_path / "camera.json", camera_json())
    write(tmp_path / "splits.csv", "aqua,train\n")
    write(tmp_path / "aqua/labels.json", [speed_record("frame_a", *TRUTH[0])])
    picture(tmp_path / "aqua/images/frame_a.jpg")
    with pytest.raises(InputError, match=r"frame_a\.jpg has no number"):
        read_poses(tmp_path, "aqua", "train")
    (tmp_path / "splits.csv").write_bytes(b"aqu\xe9,train\n")
    with pytest.raises(InputError, match=r"splits\.csv: is no CSV text"):
        domains(tmp_path)
