"""How strong each arm's noise is, beside the noise that the images carry and that each test set shows.

All figures are standard deviations in 8-bit levels (0 to 255), at the resolution at which the noise acts. For an arm they are
measured on flat images. For images they are estimated where the picture is smooth: the difference of the diagonals of
2 x 2 pixels, (a - b - c + d) / 2, has the standard deviation of white noise, and neither gradients nor rows nor columns are
in it. Blocks of 6 x 6 pixels are sorted by their mean level; the median over the blocks of a level leaves edges out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch
from scipy.stats import chi2

from visaug_train.arms import Arm
from visaug_train.noise import batch_noise
from visaug_train.reduction import read_image, reduced
from visaug_train.speed import PoseSet
from visaug_train.tables import ResultTable

if TYPE_CHECKING:
    from visaug_train.training import Study

LEVELS = {"black": 0.0, "20 %": 0.2, "50 %": 0.5, "white": 1.0}


@dataclass(frozen=True)
class NoiseStrength:
    """Standard deviations by level: of all noise, and of its white part; NaN where nothing has that level."""

    total: Mapping[str, float]
    white: Mapping[str, float]


def strength_of(noise: torch.nn.Module, shape: tuple[int, int] = (64, 64)) -> NoiseStrength:
    """An arm's noise on flat images of `shape` (rows, columns): the root mean square over images of what each shows
    around its mean.
    """
    images = 48
    total, white = {}, {}
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        torch.manual_seed(0)
        for name, level in LEVELS.items():
            noisy = noise(torch.full((images, 1, *shape), level))[:, 0].double().numpy() * 255
            total[name] = float(np.sqrt(noisy.var(axis=(1, 2)).mean()))
            white[name] = float(np.sqrt((_diagonals(noisy) ** 2).mean()))
    return NoiseStrength(total, white)


def carried(poses: PoseSet, size: tuple[int, int], how: str) -> NoiseStrength:
    """The white noise of images as the network gets them, at each level."""
    most_images, least_blocks = 24, 20
    levels, blocks = [], []
    for i in np.unique(np.linspace(0, len(poses) - 1, most_images).astype(int)):
        image = reduced(read_image(poses.files[i], poses.camera, cv2.IMREAD_GRAYSCALE), size, how)
        rows, columns = (n // 6 for n in image.shape)
        cut = image[: 6 * rows, : 6 * columns].astype(float)
        levels.append(cut.reshape(rows, 6, columns, 6).mean(axis=(1, 3)).ravel() / 255)
        squares = _diagonals(cut[None])[0].reshape(rows, 3, columns, 3) ** 2
        blocks.append(squares.mean(axis=(1, 3)).ravel())
    level, variance = np.concatenate(levels), np.concatenate(blocks)
    cells = 9  # 2 x 2 cells in a block
    # The median of the mean of nine squares lies a little below the variance.
    low = chi2.ppf(0.5, cells) / cells
    # of the blocks' means
    bands = {"black": (-1, 0.02), "20 %": (0.15, 0.25), "50 %": (0.4, 0.6), "white": (0.95, 2)}
    found = {}
    for name, (least, most) in bands.items():
        here = variance[(level >= least) & (level <= most)]
        found[name] = float(np.sqrt(np.median(here) / low)) if len(here) >= least_blocks else float("nan")
    return NoiseStrength(found, found)


def _diagonals(images: np.ndarray) -> np.ndarray:
    """(N, rows, columns) -> (N, rows / 2, columns / 2)."""
    a, b, c, d = images[:, ::2, ::2], images[:, ::2, 1::2], images[:, 1::2, ::2], images[:, 1::2, 1::2]
    return (a - b - c + d) / 2


@dataclass(frozen=True)
class Strengths:
    """Of a study: what its training images carry, what its test sets show, what its arms add."""

    images: NoiseStrength
    tests: Mapping[str, NoiseStrength]
    arms: Mapping[str, NoiseStrength]
    baseline: str
    noisy: tuple[str, ...]

    def table(self) -> ResultTable:

        def row(name: str, strength: NoiseStrength, both: bool = False) -> list[str]:
            white = {level: f" (white {strength.white[level]:.2f})" if both else "" for level in LEVELS}
            known = {level: value for level, value in strength.total.items() if not np.isnan(value)}
            return [name, *(f"{known[n]:.2f}{white[n]}" if n in known else "none" for n in LEVELS)]

        rows = [row("training images carry", self.images)]
        rows += [row(f"test set {name} shows", each) for name, each in self.tests.items()]
        rows += [row(f"arm {name} adds", each, both=True) for name, each in self.arms.items()]
        title = "Noise, standard deviation in 8-bit levels (images: white part alone, an upper bound where there is texture)"
        return ResultTable(title, ["", *LEVELS], rows)

    def warnings(self) -> list[str]:
        """A line for each arm with sensor or white noise that hardly raises the noise beyond the baseline's."""
        rounding = 12**-0.5  # what rounding to 8 bit leaves, whatever the image
        there = np.fmax([self.images.total[level] for level in LEVELS], rounding)  # the latter for NaN
        invisible, said = 1.1, []  # an arm that raises all noise by less than a tenth

        def with_images(arm: str) -> np.ndarray:
            """Noise of an arm on top of what the images carry, by level."""
            added = self.arms[arm].total if arm in self.arms else dict.fromkeys(LEVELS, 0.0)
            return np.hypot(there, [added[level] for level in LEVELS])

        for name in self.noisy:
            raised = float((with_images(name) / with_images(self.baseline)).max())
            if name != self.baseline and raised < invisible:
                said.append(
                    f"invisible arm: {name} raises the noise of the training images by at most "
                    f"{100 * (raised - 1):.0f} % over {self.baseline} (what the images carry included); raise its "
                    "gain (`gain_db`), or expect no difference"
                )
        return said

    def text(self) -> str:
        """Table and warnings, as printed before a training."""
        return "\n".join([self.table().to_markdown(), *(f"warning: {line}" for line in self.warnings())])


def strengths(study: "Study") -> Strengths:
    config = study.config
    arms = {name: config.arm(name) for name in config.arms}

    def seen(poses: PoseSet) -> NoiseStrength:
        return carried(poses, config.seen_size(poses.camera), config.data.reduction)

    def added(arm: Arm) -> NoiseStrength:
        columns, rows = config.seen_size(study.training_images.camera)
        if not any(part and part.resolution == "sensor" for part in (arm.vis, arm.white)):
            rows, columns = min(rows, 96), min(columns, 96)  # of a noise that does not know the image's size
        return strength_of(batch_noise(arm), (rows - rows % 2, columns - columns % 2))

    return Strengths(
        seen(study.training_images),
        {name: seen(poses) for name, poses in study.tests.items()},
        {name: added(arm) for name, arm in arms.items()},
        config.baseline,
        tuple(name for name, arm in arms.items() if arm.vis or arm.white),
    )
