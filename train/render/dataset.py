"""Write a rendered dataset in SPEED+'s layout: camera.json, synthetic/, lightbox/, sunlamp/.

Every image has its own stream of random numbers, so an interrupted rendering goes on where it stopped and
gives the same bytes on the same device. A split's json is written last: where it stands, its images do.
"""

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import AfterValidator, Field, field_validator

from visaug.core.cores import cores
from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import write_json
from visaug.core.progress import Progress
from visaug_train.geometry import Pinhole
from visaug_train.reduction import write_png
from visaug_train.render.caster import RayCaster, Views, join
from visaug_train.render.independent_camera import (
    LIGHTBOX_CAMERA,
    LIGHTBOX_LINES_CAMERA,
    SUNLAMP_CAMERA,
    SUNLAMP_LINES_CAMERA,
    IndependentCamera,
)
from visaug_train.render.views import LIGHTBOX, SUNLAMP, SYNTHETIC, Lighting, draw_earth, draw_views
from visaug_train.sections import ConfigSection, Seed, ordered
from visaug_train.speed import write_listing

# SPEED+'s published intrinsics; a rendering of another size uses them scaled, so the field of view stays.
SPEED_PLUS_CAMERA = Pinhole(
    1920,
    1200,
    np.array([[2988.5795163815555, 0, 960], [0, 2988.3401159176124, 600], [0, 0, 1.0]]),
    np.array([-0.22383016606510672, 0.51409797089106379, -0.00066499611998340662, -0.00021404771667484594,
              -0.13124227429077406]),
)  # fmt: skip
LINEAR_WHITE_DN = 32767.5  # of 65535 in images_linear/: twice the 8-bit image's white fits in
Images = Annotated[int, Field(ge=1, le=10**6)]
Distance = Annotated[float, Field(ge=0.5, le=1e4)]


@dataclass(frozen=True)
class Domain:
    """How a domain is lit and by which camera it is seen; `brightness` is the target's mean, a share of full scale.

    Without a camera the image is the noiseless 8-bit one that a renderer gives. A domain with `views_of` shows the
    views of another one, image by image, with the same light and the same random numbers, by its own camera.
    """

    lighting: Lighting
    brightness: tuple[float, float]
    camera: IndependentCamera | None = None
    views_of: str | None = None


DOMAINS = {
    "synthetic": Domain(SYNTHETIC, (0.12, 0.35)),
    "lightbox": Domain(LIGHTBOX, (0.10, 0.25), LIGHTBOX_CAMERA),
    "sunlamp": Domain(SUNLAMP, (0.5, 1.1), SUNLAMP_CAMERA),
    "lightbox_base": Domain(LIGHTBOX, (0.10, 0.25), LIGHTBOX_CAMERA.without_effects(), views_of="lightbox"),
    "lightbox_lines": Domain(LIGHTBOX, (0.10, 0.25), LIGHTBOX_LINES_CAMERA, views_of="lightbox"),
    "sunlamp_lines": Domain(SUNLAMP, (0.5, 1.1), SUNLAMP_LINES_CAMERA, views_of="sunlamp"),
}


class RenderSettings(ConfigSection):
    """Size and content of the dataset. `images` holds the number of each domain's splits."""

    width: int = Field(default=240, ge=32, le=8192)
    height: int = Field(default=150, ge=32, le=8192)
    images: dict[str, dict[Literal["train", "validation", "test"], Images]] = Field(
        default={
            "synthetic": {"train": 500, "validation": 100, "test": 150},
            "lightbox": {"test": 150},
            "sunlamp": {"test": 150},
        }
    )
    distance_m: Annotated[tuple[Distance, Distance], AfterValidator(ordered)] = (2.6, 5.5)
    attitude_deg: float = Field(default=45.0, ge=0, le=180)
    samples: int = Field(default=2, ge=1, le=8)
    linear_frames: bool = False
    seed: Seed = 0

    @field_validator("images")
    @classmethod
    def _domains_are_known(cls, images: dict[str, Any]) -> dict[str, Any]:
        for domain in images.keys() - DOMAINS.keys():
            raise ValueError(f"expected one of {', '.join(DOMAINS)}, got {domain}")
        return images


def render_dataset(root: str | Path, settings: RenderSettings, progress: Progress | None = None) -> Path:
    """Render what is not there yet into `root` and return it; a GPU follows the rays where there is one.

    With `linear_frames` each image has a noiseless partner in ``images_linear/``: 16 bit, the same exposure,
    full scale at twice the 8-bit image's white, so highlights that clip in 8 bit are kept.
    """
    root = Path(root)
    stamp, described = root / "render.json", read_back(settings)
    if stamp.is_file() and read_json(stamp) != described:
        raise InputError(f"{root}: was rendered with other settings (render.json); expected a new folder")
    camera = SPEED_PLUS_CAMERA.scaled(settings.width, settings.height)
    write_json(stamp, described)
    write_json(root / "camera.json", camera.to_json())
    caster = RayCaster(camera, settings.samples, device="cuda" if torch.cuda.is_available() else "cpu")
    total, done, batch = sum(sum(splits.values()) for splits in settings.images.values()), 0, 16
    for domain, splits in settings.images.items():
        first = 0
        for split, count in splits.items():
            numbers = range(first, first + count)
            listing = root / domain / f"{split}.json"
            if not listing.is_file():
                views = [_draw(camera, settings, domain, number) for number in numbers]
                cuts = [slice(start, min(start + batch, count)) for start in range(0, count, batch)]
                render = partial(_render_part, root, settings, domain, caster)
                with one_torch_thread(), ThreadPoolExecutor(cores()) as pool:
                    jobs = pool.map(render, [views[cut] for cut in cuts], [numbers[cut] for cut in cuts])
                    for cut, _ in zip(cuts, jobs):
                        if progress:
                            progress("rendering", done + cut.stop, total)
                joined = join(views)
                write_listing(listing, map(_name, numbers), joined.quaternions, joined.translations)
            done += count
            first += count
    return root


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Parts are rendered beside each other; threads inside their many small steps would only wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def read_back(settings: RenderSettings) -> dict:
    """The settings with the domains that they name, as JSON has them."""
    named = {name: asdict(DOMAINS[name]) for name in settings.images}
    return json.loads(json.dumps({"settings": settings.model_dump(), "domains": named}))


def _draw(camera: Pinhole, settings: RenderSettings, domain: str, number: int) -> Views:
    rng = _stream(settings, domain, number, 0)
    return draw_views(camera, 1, DOMAINS[domain].lighting, settings.distance_m, settings.attitude_deg, rng)


def _render_part(
    root: Path, settings: RenderSettings, domain: str, caster: RayCaster, views: list[Views], numbers: range
) -> None:
    files = [root / domain / "images" / _name(number) for number in numbers]
    if all(file.is_file() for file in files):
        return
    radiance, covered = (tensor.numpy() for tensor in caster.render(join(views)))
    for file, number, image, cover in zip(files, numbers, radiance, covered):
        rng = _stream(settings, domain, number, 1)
        clean, picture = _expose(DOMAINS[domain], image, cover, caster.camera, rng)
        write_png(file, picture)
        if settings.linear_frames:
            frame = np.clip(np.rint(clean * LINEAR_WHITE_DN), 0, 65535).astype(np.uint16)
            write_png(root / domain / "images_linear" / file.name, frame)


def _expose(
    kind: Domain, radiance: np.ndarray, cover: np.ndarray, camera: Pinhole, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Noiseless image (1 is white) and the 8-bit one, exposed for the target as an automatic exposure would."""
    earth = draw_earth(camera, kind.lighting.earth_share, rng)
    seen = radiance[cover > 0.5]
    mean = max(float(seen.mean()) if seen.size else 0.1, 1e-3)
    exposure = float(np.clip(rng.uniform(*kind.brightness) / mean, 0.2, 8.0))
    if earth is not None:
        radiance = radiance + (1 - cover) * earth
    clean = radiance * exposure
    if kind.camera is None:
        return clean, np.clip(np.rint(clean * 255), 0, 255).astype(np.uint8)
    photons = clean * kind.camera.saturation_e / kind.camera.quantum_efficiency
    return clean, kind.camera.to_8bit(kind.camera.expose(photons, rng))


def _name(number: int) -> str:
    return f"img{number + 1:06d}.png"


def _stream(settings: RenderSettings, domain: str, number: int, part: int) -> np.random.Generator:
    views = DOMAINS[domain].views_of or domain
    return np.random.default_rng([settings.seed, list(DOMAINS).index(views), number, part])
