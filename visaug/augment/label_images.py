"""Whether an image file holds labels or measurements rather than light: masks, segmentations, depth, normals, flow.

Such files look like pictures and lie beside them in data sets of BlenderProc (BOP), Isaac Replicator, Pascal VOC and
Cityscapes. Noise destroys them. Lossy files (JPEG) never hold labels.
"""

import re
from pathlib import PurePosixPath

import numpy as np

from visaug.augment.image_io import Picture

MEASURED = {"depth", "distance", "disparity", "flow", "normals", "nocs"}  # no limit on their number of values
CLASSES = {"mask", "masks", "seg", "segm", "segmentation", "semantic", "instance", "instances", "label", "labels",
           "panoptic", "gt", "matte"}  # fmt: skip


def why_labels(name: str, picture: Picture) -> str | None:
    """The reason to take an image, by its path below a folder and by what it holds, for labels; None for a picture."""
    if PurePosixPath(name).suffix.lower() in (".jpg", ".jpeg"):
        return None
    words = words_of(name)
    if words & MEASURED:
        return f"named {', '.join(sorted(words & MEASURED))}"
    if picture.extras.get("palette"):
        return "palette"
    light = picture.pixels[..., : picture.colours]
    if light.dtype.kind == "f":
        return _measured(picture.light)
    named = words & CLASSES
    few_colours = 32  # a segmentation of an image has so many classes or instances; a shaded picture has hundreds of colours
    grays = 256  # distinct colours of an 8-bit gray image: a name such as "mask" is believed up to here
    colours = number_of_colours(light, grays if named else few_colours)
    if named and colours <= grays:
        return f"named {', '.join(sorted(named))}"
    if 1 < colours <= few_colours:
        return "two values" if colours == 2 else "few colours"
    return None


def words_of(name: str) -> set[str]:
    """The words in a path without its suffix, in lower case: `gtFine/a_labelIds` has gt, fine, a, label and ids."""
    bare = str(PurePosixPath(name).with_suffix(""))
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", bare)}


def number_of_colours(light: np.ndarray, most: int) -> int:
    """Number of distinct values of pixels (H, W, C) of whole numbers; anything above `most` where there are more."""
    pixels = light.reshape(-1, light.shape[2]).astype(np.uint64)
    packed = pixels @ (np.uint64(1) << (np.uint64(16) * np.arange(light.shape[2], dtype=np.uint64)))
    sampled = 4096  # pixels that are looked at first: a picture has shown more colours by then
    seen = len(np.unique(packed[:: max(1, len(packed) // sampled)]))
    return seen if seen > most else len(np.unique(packed))


def _measured(light: np.ndarray) -> str | None:
    """Floating-point values of which most are no fraction of white: metres, or the signed parts of a direction."""
    there = light[np.isfinite(light)]
    if there.size and not np.array_equal(there, np.round(there)):  # whole numbers have an error of their own
        if float(np.median(there)) > 1:
            return "most values above 1"
        if float((there < 0).mean()) > 0.05:
            return "negative values"
    return None
