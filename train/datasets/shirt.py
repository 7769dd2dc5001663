"""SHIRT: two rendezvous trajectories with Tango, each rendered and taken in the laboratory.

``camera.json`` and, for TRAJECTORY roe1 and roe2, ``TRAJECTORY/TRAJECTORY.json`` with ``TRAJECTORY/{synthetic,lightbox}/images/``;
both domains share the list of poses. Source: T. H. Park and S. D'Amico, https://purl.stanford.edu/zq716br5462, as public readers of
it open it. Records are SPEED+'s (`filename`, `q_vbs2tango_true`, `r_Vo2To_vbs_true`). The domains are roe1_synthetic,
roe1_lightbox and so on; all images are test images.
"""

from pathlib import Path

from visaug_train.datasets.reader import Reader
from visaug_train.geometry import Pinhole
from visaug_train.speed import PoseSet, read_listing


def _domains(root: Path) -> dict[str, tuple[str, ...]]:
    lists = [file for file in sorted(root.glob("roe[12]/roe[12].json")) if file.stem == file.parent.name]
    folders = [images for file in lists for images in sorted(file.parent.glob("*/images"))]
    return {f"{images.parent.parent.name}_{images.parent.name}": ("test",) for images in folders}


def _read(root: Path, domain: str, split: str) -> PoseSet:
    trajectory, _, source = domain.partition("_")
    images = root / trajectory / source / "images"
    camera = Pinhole.load(root / "camera.json")
    return read_listing(root / trajectory / f"{trajectory}.json", images, camera, f"{domain}/{split}")


SHIRT = Reader("SHIRT", ("roe1/roe1.json", "roe2/roe2.json"), _domains, _read)
