"""Predictions as other networks and competitions write them: names, units, orders, scales, several domains in a file."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from visaug.core.errors import InputError
from visaug_train.commands import evaluate_predictions
from visaug_train.geometry import Keypoints, Pinhole, project_targets
from visaug_train.metrics import Detections
from visaug_train.predictions import ImageNames, load_predictions, names_elsewhere, save_predictions
from visaug_train.readings import which_block
from visaug_train.speed import PoseSet, read_poses

TANGO = Keypoints.load()


def records(rendered, domain="lightbox", scale=(1, 1), noise_px=0.0, boxes=True, keypoints=TANGO):
    poses = read_poses(rendered, domain)
    targets = project_targets(poses.camera, keypoints, poses.quaternions, poses.translations)
    rng, made = np.random.default_rng(2), []
    for file, box, points in zip(poses.files, targets.boxes, targets.points):
        points = (points + rng.normal(0, noise_px, points.shape)) * scale
        low, high = box[:2] * scale, box[2:] * scale
        made.append(
            {
                "file_name": file.name,
                "category_id": 1,
                "score": 0.9,
                "keypoints": np.column_stack([points, np.ones(len(points))]).ravel().tolist(),
            }
            | ({"bbox": [*low, *(high - low)]} if boxes else {})
        )
    return made


def scored(rendered, tmp_path, content, domain="lightbox", **more):
    (tmp_path / "p.json").write_text(json.dumps(content))
    return evaluate_predictions(tmp_path / "p.json", rendered, domain, **more)[domain]


def test_records_without_a_box_have_keypoint_scores_and_no_box_scores(rendered, tmp_path):
    made = records(rendered, boxes=False)
    scores = scored(rendered, tmp_path, made)
    assert scores["keypoint_ap50_95"] == pytest.approx({"paper": 1, "coco": 1})
    assert scores["position_error"] < 1e-3
    assert (scores["iou"], scores["box_ap50_95"]) == (None, None)
    made[0]["bbox"] = [1, 2, 3, 4]  # one box of four says nothing of the network's boxes
    assert scored(rendered, tmp_path, made)["iou"] is None


@pytest.mark.parametrize(
    "write",
    [
        lambda name: f"lightbox\\images\\{name}",
        lambda name: f"C:\\speedplus\\lightbox\\images\\{name}",
        lambda name: f"/data/lightbox/images/{name}",
        lambda name: name.rsplit(".", 1)[0],
        lambda name: name.rsplit(".", 1)[0] + ".jpeg",
    ],
    ids=["windows", "drive", "posix", "stem", "other suffix"],
)
def test_names_with_folders_and_without_suffix(rendered, tmp_path, write):
    made = records(rendered)
    for record in made:
        record["image_id"] = write(record.pop("file_name"))
    assert scored(rendered, tmp_path, made)["iou"] == pytest.approx(1, abs=1e-3)


def test_records_of_another_domain_are_not_scored_as_this_ones(rendered, tmp_path):
    """Both domains have images of the same names; only the folder tells them apart."""
    both = []
    for domain in ("sunlamp", "lightbox"):
        for record in records(rendered, domain):
            both.append(record | {"file_name": f"{domain}/images/{record['file_name']}"})
    assert scored(rendered, tmp_path, both)["keypoint_ap50_95"]["coco"] == pytest.approx(1)
    with pytest.raises(InputError, match="names no image of lightbox/test"):
        scored(rendered, tmp_path, both[:4])


@pytest.mark.parametrize("copies", [(80, 50), (320, 200), (64, 64), (1, 1)])
def test_points_of_another_scale_are_recognised_and_said(rendered, tmp_path, copies):
    camera = read_poses(rendered, "lightbox").camera
    scale = np.array(copies) / (camera.width, camera.height)
    plain = scored(rendered, tmp_path, records(rendered, noise_px=1.0))
    scores = scored(rendered, tmp_path, records(rendered, scale=scale, noise_px=1.0))
    assert plain["notes"] == []
    (note,) = scores["notes"]
    assert ("shares of the image" if copies == (1, 1) else f"pixels of {copies[0]} x {copies[1]}") in note
    for key in ("iou", "position_error", "attitude_error_deg"):
        assert scores[key] == pytest.approx(plain[key], rel=1e-3)


def test_bad_points_stay_what_they_are(rendered, tmp_path):
    rng = np.random.default_rng(0)
    made = records(rendered)
    for record in made:
        points = np.reshape(record["keypoints"], (-1, 3))
        points[:, :2] = rng.uniform(0, 100, (11, 2))
        record["keypoints"] = points.ravel().tolist()
    scores = scored(rendered, tmp_path, made)
    assert scores["notes"] == []
    assert scores["oks"]["coco"] < 0.3


def own_model(tmp_path, **more):
    names = ["nose", "left", "right", "tail", "top"]
    content = {"points_m": {n: p.tolist() for n, p in zip(names, TANGO.points_m[[0, 4, 6, 8, 10]])}} | more
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return tmp_path / "own.yaml"


def test_keypoints_of_ones_own_with_their_sigmas(rendered, tmp_path):
    """COCO's OKS of points that are off by d is the mean of exp(-d^2 / (2 (2 sigma)^2 0.53 A))."""
    sigmas = {"nose": 0.02, "left": 0.05, "right": 0.05, "tail": 0.1, "top": 0.03}
    file = own_model(tmp_path, sigmas=sigmas, flip_pairs=[["left", "right"]])
    own = Keypoints.load(file)
    assert own.flip == (0, 2, 1, 3, 4)
    made, off = records(rendered, keypoints=own), 2.0
    for record in made:
        points = np.reshape(record["keypoints"], (-1, 3))
        points[:, 0] += off
        record["keypoints"] = points.ravel().tolist()
    poses = read_poses(rendered, "lightbox")
    targets = project_targets(poses.camera, own, poses.quaternions, poses.translations)
    expected = []
    for box, inside in zip(targets.boxes, targets.inside):
        area = 0.53 * np.prod(box[2:] - box[:2])
        each = np.exp(-(off**2) / (2 * (2 * np.array(list(sigmas.values()))) ** 2 * area))
        expected.append(each[inside].mean())
    scores = scored(rendered, tmp_path, made, keypoints=file)
    assert scores["oks"]["coco"] == pytest.approx(np.mean(expected), rel=1e-6)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"sigmas": [0.1, 0.1]}, "sigmas: expected 5 finite numbers"),
        ({"sigmas": [0.1, 0.1, 0, 0.1, 0.1]}, "sigmas: must be above 0"),
        ({"sigmas": {"nose": 0.1}}, "sigmas: expected 5"),
        ({"flip_pairs": [["left", "wing"]]}, "is no pair of points"),
        ({"flip_pairs": [[0, 1], [1, 2]]}, "is no pair of points"),
        ({"sigma": [0.1] * 5}, "sigma: is not a key of keypoints"),
    ],
)
def test_a_keypoint_file_is_checked(tmp_path, more, message):
    with pytest.raises(InputError, match=message):
        Keypoints.load(own_model(tmp_path, **more))


def exact(rendered, domain):
    poses = read_poses(rendered, domain)
    return [file.name for file in poses.files], np.column_stack([poses.quaternions, poses.translations])


def score_csv(rendered, tmp_path, rows, domain="lightbox"):
    lines = [",".join([name, *(f"{v:.9g}" for v in values)]) for name, values in rows]
    (tmp_path / "p.csv").write_text("\n".join(lines) + "\n")
    return evaluate_predictions(tmp_path / "p.csv", rendered, domain)[domain]


@pytest.mark.parametrize(("factor", "unit"), [(1.0, None), (100.0, "centimetres"), (1000.0, "millimetres")])
@pytest.mark.parametrize("last", [False, True])
def test_units_and_the_order_of_quaternions_are_recognised_and_said(rendered, tmp_path, factor, unit, last):
    names, values = exact(rendered, "lightbox")
    q = np.roll(values[:, :4], -1, axis=1) if last else values[:, :4]
    scores = score_csv(rendered, tmp_path, zip(names, np.column_stack([q, factor * values[:, 4:]])))
    assert scores["attitude_error_deg"] < 1e-3
    assert scores["position_error"] < 1e-6
    assert any("scalar last" in note for note in scores["notes"]) == last
    assert len(scores["notes"]) == last + (unit is not None)
    assert unit is None or any(unit in note for note in scores["notes"])


def test_wrong_poses_stay_wrong(rendered, tmp_path):
    names, values = exact(rendered, "lightbox")
    wrong = np.column_stack([np.tile([0.5, 0.5, 0.5, 0.5], (4, 1)), values[:, 4:] * 1.5])
    scores = score_csv(rendered, tmp_path, zip(names, wrong))
    assert scores["position_error"] == pytest.approx(0.5)
    assert scores["notes"] == []


@pytest.mark.parametrize("order", [("lightbox", "sunlamp"), ("sunlamp", "lightbox")])
def test_a_submission_of_both_domains_scores_each(rendered, tmp_path, order):
    """Its names come twice, and four images do not tell the blocks apart (1 in 16 by chance), but their folders do."""
    rows = [row for domain in order for row in zip(*exact(rendered, domain))]
    with pytest.raises(InputError, match="comes twice"):
        score_csv(rendered, tmp_path, rows)
    named = [(f"{d}/{name}", values) for d in order for name, values in zip(*exact(rendered, d))]
    for domain in order:
        assert score_csv(rendered, tmp_path, named, domain)["attitude_error_deg"] < 1e-3


def test_the_block_of_a_domain_is_told_by_its_images_and_by_its_fit(rendered, tmp_path):
    poses = read_poses(rendered, "lightbox")
    many = poses.select(np.tile(np.arange(len(poses)), 3))
    own = np.column_stack([many.quaternions, many.translations])
    other = np.roll(own, 1, axis=0)
    assert which_block([other, own], [0, 0], many) == 1
    assert which_block([own, other], [0, 0], many) == 0
    assert which_block([own, own], [0, 0], many) is None
    assert which_block([other, own], [0, 5], many) == 0  # the second goes on with names of another domain
    gap = own.copy()
    gap[2] = np.nan
    assert which_block([gap, other], [0, 0], many) == 1


def test_names_of_other_lists_are_known(rendered):
    poses = read_poses(rendered, "synthetic", "train")
    elsewhere = names_elsewhere(rendered, poses)
    assert {"synthetic/validation", "synthetic/test", "lightbox/test", "sunlamp/test"} == elsewhere.keys()
    names = ImageNames(poses, elsewhere)
    other = read_poses(rendered, "synthetic", "validation").files[0].name
    assert names.find(other, poses.files[0], "x") is None
    with pytest.raises(InputError, match="no image of synthetic/train"):
        names.find("nowhere.png", poses.files[0], "x")


def test_a_wild_pose_costs_no_more_than_silence_and_is_seen_in_the_answered_score(rendered, tmp_path):
    names, values = exact(rendered, "lightbox")
    wild = values.copy()
    wild[0, 4:] *= 50
    answered = score_csv(rendered, tmp_path, zip(names, wild))
    silent = score_csv(rendered, tmp_path, list(zip(names, values))[1:])
    assert answered["spec_score"] == pytest.approx(1 / 4, abs=1e-6)
    assert silent["spec_score"] == pytest.approx((1 + np.pi) / 4, abs=1e-6)
    assert answered["answered"]["spec_score"] == pytest.approx(49 / 4, rel=1e-6)
    assert silent["answered"]["spec_score"] == pytest.approx(0, abs=1e-6)
    assert (answered["poses_found"], silent["poses_found"]) == (1, 0.75)


def test_images_without_labels_give_a_submission(rendered, tmp_path):
    made = records(rendered)
    data = shutil.copytree(rendered, tmp_path / "data")
    listing = data / "lightbox" / "test.json"
    listing.write_text(json.dumps([{"filename": r["filename"]} for r in json.loads(listing.read_text())]))
    with pytest.raises(InputError, match="no labels, so there is nothing to score"):
        scored(data, tmp_path, made)
    said = scored(data, tmp_path, made[1:], poses_csv=tmp_path / "sub.csv")
    assert said["poses_found"] == 0.75
    lines = (tmp_path / "sub.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == [r["file_name"] for r in made]
    _, values = exact(rendered, "lightbox")
    found = np.array([line.split(",")[1:] for line in lines], float)
    np.testing.assert_allclose(found[1:, 4:], values[1:, 4:], rtol=1e-3)
    np.testing.assert_allclose(found[0], [1, 0, 0, 0, *np.median(found[1:, 4:], axis=0)], rtol=1e-6)
    again = evaluate_predictions(tmp_path / "sub.csv", rendered, "lightbox")["lightbox"]
    assert again["poses_found"] == 1


def of_two_domains(count):
    """A set of `count` images, the names of which another domain has too, and a record of each of both."""
    root, names = Path("plus"), [f"img{i:06d}.jpg" for i in range(count)]
    files = {d: [root / d / "images" / name for name in names] for d in ("lightbox", "sunlamp")}
    unknown = np.full((count, 7), np.nan)
    camera = Pinhole(160, 100, np.eye(3), np.zeros(5))
    poses = PoseSet("lightbox/test", camera, tuple(files["lightbox"]), unknown[:, :4], unknown[:, 4:])
    made = [{"file_name": name, "keypoints": [5, 5, 1] * 11, "score": 0.9} for name in names]
    return made, poses, ImageNames(poses, {"sunlamp/test": files["sunlamp"]}, root)


def loaded(tmp_path, content, poses, names):
    (tmp_path / "p.json").write_text(json.dumps(content))
    notes = []
    return load_predictions(tmp_path / "p.json", poses, 11, names=names, say=notes.append), notes


def test_a_list_that_starts_over_is_of_several_domains(tmp_path):
    made, poses, names = of_two_domains(12)
    with pytest.raises(InputError, match="record 12: the names start over, as those of lightbox, sunlamp do"):
        loaded(tmp_path, made + made, poses, names)
    named = [r | {"file_name": f"{d}/{r['file_name']}"} for d in ("lightbox", "sunlamp") for r in made]
    found, notes = loaded(tmp_path, named, poses, names)
    assert ({len(each) for each in found}, notes) == ({1}, [])


@pytest.mark.parametrize("order", ["by image", "by score"])
def test_several_detections_of_an_image_are_taken_and_said_where_they_may_be_of_two_domains(tmp_path, order):
    made, poses, names = of_two_domains(12)
    twice = [record for record in made for _ in range(2)]
    if order == "by score":
        twice = [twice[i] for i in np.random.default_rng(0).permutation(len(twice))]
    found, (note,) = loaded(tmp_path, twice, poses, names)
    assert {len(each) for each in found} == {2}
    assert (
        "12 images have several records, all taken for detections in lightbox; sunlamp has the same names"
        in note
    )
    assert loaded(tmp_path, twice, poses, ImageNames(poses))[1] == []


def test_names_of_another_part_of_the_domain_are_counted(rendered, tmp_path):
    """SPEED's one list is split by the seed, that of --seed as that of a config."""
    root = tmp_path / "speed"
    source = read_poses(rendered, "synthetic", "train")
    (root / "images").mkdir(parents=True)
    shutil.copytree(source.files[0].parent, root / "images" / "train")
    shutil.copy(rendered / "camera.json", root)
    shutil.copy(rendered / "synthetic" / "train.json", root)
    own = read_poses(root, "speed", "test", seed=1)
    targets = own.targets(TANGO)
    save_predictions(
        tmp_path / "p.json",
        own,
        [
            Detections(box[None], points[None], np.ones((1, 11)), np.ones(1))
            for box, points in zip(targets.boxes, targets.points)
        ],
    )
    scores = evaluate_predictions(tmp_path / "p.json", root, "speed", seed=1)["speed"]
    assert (scores["poses_found"], scores["notes"]) == (1, [])
    other = set(own.ids) - set(read_poses(root, "speed", "test", seed=0).ids)
    assert other
    notes = evaluate_predictions(tmp_path / "p.json", root, "speed")["speed"]["notes"]
    assert f"other images of speed than those of speed/test were passed over: {len(other)}" in notes[0]
