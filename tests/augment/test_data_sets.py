"""Data sets as renderers write them: images get noise, labels and files of others stay."""

import cv2
import numpy as np
import pytest
from PIL import Image

from visaug import Camera, InputError
from visaug.augment.files import augment_files
from visaug.augment.image_io import Picture, read_picture
from visaug.augment.jobs import matches
from visaug.augment.label_images import why_labels, words_of
from visaug.effects.catalogue import load_file

CAMERA = Camera.load(
    {"resolution": [48, 64], "bit_depth": 12, "gain_e_per_dn": 0.2, "read_noise": {"sigma_e": 20.0}}
)


def shaded(channels: int = 3, dtype=np.uint8) -> np.ndarray:
    """A smooth picture, of more than 32 colours and without noise."""
    rows, columns = np.mgrid[0:48, 0:64]
    top = np.iinfo(dtype).max
    plane = (0.2 + 0.3 * rows / 48 + 0.3 * columns / 64) * top
    return plane.astype(dtype) if channels == 1 else np.stack([plane] * channels, -1).astype(dtype)


def mask() -> np.ndarray:
    made = np.zeros((48, 64), np.uint8)
    made[10:30, 10:30] = 255
    return made


def write(path, values) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npy":
        np.save(path, values)
    else:
        assert cv2.imwrite(str(path), values)


@pytest.fixture
def bop(tmp_path):
    """BlenderProc's layout: two scenes with files of equal names."""
    root = tmp_path / "bop"
    for scene in ("000000", "000001"):
        write(root / scene / "rgb" / "000000.png", shaded())
        write(root / scene / "depth" / "000000.png", np.full((48, 64), 8000, np.uint16))
        write(root / scene / "mask_visib" / "000000_000000.png", mask())
        (root / scene / "scene_gt.json").write_text("{}")
    return root


def unchanged(before, after) -> set[str]:
    """Files below `before` that `after` has with the same bytes."""
    return {
        path.relative_to(before).as_posix()
        for path in before.rglob("*")
        if path.is_file()
        and (after / path.relative_to(before)).is_file()
        and (after / path.relative_to(before)).read_bytes() == path.read_bytes()
    }


def test_labels_of_a_whole_tree_stay_and_images_get_noise(bop, tmp_path):
    done = augment_files([bop], tmp_path / "out", CAMERA)
    same = unchanged(bop, tmp_path / "out")
    assert {name for name in same if "rgb" in name} == set()
    assert len([name for name in same if name.endswith(".png")]) == 4
    assert done.like_labels == {"named depth": 2, "named mask": 2}
    assert not (tmp_path / "out" / "000000" / "scene_gt.json").exists()
    again = augment_files([bop], tmp_path / "out", CAMERA)
    assert (again.written, again.kept) == (0, 6)
    augment_files([bop], tmp_path / "out", CAMERA, force=True)
    assert unchanged(bop, tmp_path / "out") == set()


def test_chosen_images_get_noise_and_all_else_goes_along(bop, tmp_path):
    done = augment_files([bop], tmp_path / "out", CAMERA, include=["rgb/*.png"], labels=True)
    every = {path.relative_to(bop).as_posix() for path in bop.rglob("*") if path.is_file()}
    assert unchanged(bop, tmp_path / "out") == {name for name in every if "/rgb/" not in name}
    assert (done.written, done.carried, done.like_labels) == (2, 6, {})
    only = augment_files([bop], tmp_path / "images", CAMERA, exclude=["depth", "*mask*"])
    assert (only.written, only.excluded) == (2, 4)
    with pytest.raises(InputError, match="matches no file"):
        augment_files([bop], tmp_path / "none", CAMERA, include=["rbg/*"])


def test_inputs_with_equal_names_are_kept_apart_by_their_folders(bop, tmp_path):
    done = augment_files(sorted(bop.glob("*/rgb")), tmp_path / "out", CAMERA)
    assert done.written == 2
    made = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.png")}
    assert made == {"000000/rgb/000000.png", "000001/rgb/000000.png"}


@pytest.mark.parametrize(
    ("name", "pattern", "yes"),
    [
        ("000000/rgb/1.png", "rgb/*.png", True),
        ("rgb/1.png", "rgb/*.png", True),
        ("a/xrgb/1.png", "rgb/*.png", False),
        ("a/mask_visib/1.png", "*mask*", True),
        ("a/masks/b/1.png", "masks", True),
        ("a/masks/b/1.png", "masks/", True),
        ("a/1.png", "*.jpg", False),
    ],
)
def test_patterns(name, pattern, yes):
    assert matches(name, pattern) is yes


def test_a_replicator_folder(tmp_path):
    """BasicWriter: RGBA, colours of classes, metres, and arrays that are no images."""
    root = tmp_path / "replicator"
    write(root / "rgb_0000.png", np.dstack([shaded(), np.full((48, 64), 255, np.uint8)]))
    classes = np.zeros((48, 64, 4), np.uint8)
    classes[...] = (0, 0, 0, 255)
    classes[10:30, 10:30] = (25, 255, 140, 255)
    write(root / "classes_0000.png", classes)
    write(root / "metres_0000.npy", 3.7 + np.linspace(0, 1, 48 * 64, dtype=np.float32).reshape(48, 64))
    write(root / "boxes_0000.npy", np.zeros(3, [("id", "<u4"), ("x", "<i4")]))
    done = augment_files([root], tmp_path / "out", CAMERA, labels=True)
    assert unchanged(root, tmp_path / "out") == {"classes_0000.png", "metres_0000.npy", "boxes_0000.npy"}
    assert done.like_labels == {"two values": 1, "most values above 1": 1}
    assert done.failed == []


def test_what_looks_like_labels():
    def why(pixels, name="a.png", **extras):
        planes = pixels[..., None] if pixels.ndim == 2 else pixels
        return why_labels(name, Picture(planes, extras=extras))

    assert why(shaded()) is None
    assert why(shaded(1, np.uint16)) is None
    assert why(np.full((48, 64), 120, np.uint8)) is None  # a flat field
    assert why(mask()) == "two values"
    assert why(mask(), "a.jpg") is None
    assert why(np.repeat(np.arange(24, dtype=np.uint8), 128).reshape(48, 64)) == "few colours"
    assert why(shaded(), palette=True) == "palette"
    assert why(np.zeros((48, 64), np.uint8), "scene/mask/1.png") == "named mask"
    assert why(np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8), "with_mask/1.png") is None
    assert why(np.random.default_rng(0).normal(0, 0.5, (48, 64, 3)).astype(np.float32)) == "negative values"
    glint = np.full((48, 64), 0.3, np.float32)
    glint[:3] = 50.5
    assert why(glint) is None
    assert words_of("gtFine/aachen_0001_labelIds.png") == {"gt", "fine", "aachen", "label", "ids"}
    assert "segmentation" in words_of("VOC/SegmentationClass/1.png")


def test_palettes_are_known_from_the_file(tmp_path):
    for name in ("p.png", "p.bmp", "p.tif"):
        Image.fromarray(np.dstack([shaded(1), mask(), mask()])).quantize(64).save(tmp_path / name)
        assert why_labels(name, read_picture(tmp_path / name)) == "palette", name


def test_a_foreign_file_is_never_replaced(tmp_path):
    write(tmp_path / "in" / "photo.png", shaded())
    write(tmp_path / "out" / "photo.png", shaded()[::-1])
    kept = (tmp_path / "out" / "photo.png").read_bytes()
    with pytest.raises(InputError, match=r"photo\.png: exists, and visaug did not write it"):
        augment_files([tmp_path / "in"], tmp_path / "out", CAMERA)
    assert (tmp_path / "out" / "photo.png").read_bytes() == kept
    done = augment_files([tmp_path / "in"], tmp_path / "out", CAMERA, force=True)
    assert (done.written, done.replaced) == (1, 1)


LIFT = """
from visaug.effects import Effect, Parameter, Stage


class Lift(Effect):
    name = "lift_of_test"
    stage = Stage.READOUT
    summary = "An offset."
    equation = "V <- V + a"
    source = "made up for the tests"
    offset_e = Parameter(10.0, unit="e-", high=1000.0, strength=True, trials=(1.0, 5.0), source="made up")

    def apply(self, signal, p, stream, context):
        return signal + FACTOR * p.offset_e

    def moments(self, mean, p, context):
        return mean + FACTOR * p.offset_e, 0 * mean
"""


def test_a_copy_is_stale_when_its_effect_or_its_map_changed(tmp_path):
    """The camera file stays the same: what it names changes. 819 e- are white: a lift of 100 e- is 31 of 255."""
    write(tmp_path / "in" / "a.png", shaded(1))
    effect, camera, table = tmp_path / "lift.py", tmp_path / "camera.yaml", tmp_path / "map.npy"
    camera.write_text(
        "resolution: [48, 64]\nbit_depth: 12\ngain_e_per_dn: 0.2\nprnu: {map: map.npy}\n"
        "effects: [{name: lift_of_test, offset_e: 10.0}]\n"
    )
    means = []
    for factor, slope, written in ((1, 0.01, 1), (1, 0.01, 0), (11, 0.01, 1), (11, 0.05, 1), (11, 0.05, 0)):
        effect.write_text(LIFT.replace("FACTOR", str(factor)))
        load_file(effect)
        np.save(table, np.full((48, 64), slope, np.float32))
        done = augment_files([tmp_path / "in"], tmp_path / "out", Camera.load(camera))
        assert done.written == written
        means.append(cv2.imread(str(tmp_path / "out" / "a.png"), -1).mean())
    assert means[0] == means[1]
    assert means[2] - means[0] == pytest.approx(31, abs=3)
    assert means[4] > means[2] + 1


def test_bits_of_what_has_eight_are_refused(tmp_path):
    write(tmp_path / "a.png", shaded())
    with pytest.raises(InputError, match="12 bit are given for an image of uint8"):
        augment_files([tmp_path / "a.png"], tmp_path / "out", CAMERA, bits=12)


def test_several_copies_say_which_annotations_they_leave(tmp_path):
    """COCO's name single pictures, so they do not go along; YOLO labels do."""
    root = tmp_path / "set"
    (root / "labels").mkdir(parents=True)
    (root / "images").mkdir()
    for name in ("a.png", "left.png"):
        write(root / "images" / name, shaded())
    (root / "labels" / "a.txt").write_text("0 0.5 0.5 0.2 0.2\n")
    (root / "coco.json").write_text("{}")
    options = {"labels": True, "exclude": ["left*"]}
    two = augment_files([root], tmp_path / "two", CAMERA, copies=2, **options)
    assert (dict(two.skipped), two.excluded, two.carried) == ({".json": 1}, 1, 2)
    one = augment_files([root], tmp_path / "one", CAMERA, **options)
    assert (dict(one.skipped), one.excluded, one.carried) == ({}, 0, 3)
