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
# of the blocks' means
BANDS = {"black": (-1, 0.02), "20 %": (0.15, 0.25), "50 %": (0.4, 0.6), "white": (0.95, 2)}
INVISIBLE = 1.1  # an arm that raises all noise by less than a tenth


@dataclass(frozen=True)
class Strength:
    """Standard deviations by level: of all noise, and of its white part; NaN where nothing has that level."""

    total: Mapping[str, float]
    white: Mapping[str, float]


def strength_of(noise: torch.nn.Module, shape: tuple[int, int] = (64, 64)) -> Strength:
    """An arm's noise on flat images of `shape` (rows, columns): the root mean square over images of what each shows
    around its mean.
    """
    images = 48
    total, white = {}, {}
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        torch.manual_seed(0)
        for name, level in LEVELS.items():
            flat = torch.full((images, 1, *shape), level)
            noisy = noise(flat)[:, 0].double().numpy() * 255
            total[name] = float(np.sqrt(noisy.var(axis=(1, 2)).mean()))
            white[name] = float(np.sqrt((_diagonals(noisy) ** 2).mean()))
    return Strength(total, white)


def carried(poses: PoseSet, size: tuple[int, int], how: str) -> Strength:
    """The white noise of images as the network gets them, at each level."""
    most_images = 24
    chosen = np.unique(np.linspace(0, len(poses) - 1, most_images).astype(int))
    levels, blocks = [], []
    for i in chosen:
        image = reduced(read_image(poses.files[i], poses.camera, cv2.IMREAD_GRAYSCALE), size, how)
        rows, columns = (6 * (n // 6) for n in image.shape)
        cut = image[:rows, :columns].astype(float)
        levels.append(cut.reshape(rows // 6, 6, columns // 6, 6).mean(axis=(1, 3)).ravel() / 255)
        squares = _diagonals(cut[None])[0].reshape(rows // 6, 3, columns // 6, 3) ** 2
        blocks.append(squares.mean(axis=(1, 3)).ravel())
    level, variance = np.concatenate(levels), np.concatenate(blocks)
    cells = 9  # 2 x 2 cells in a block
    # The median of the mean of nine squares lies a little below the variance.
    low = chi2.ppf(0.5, cells) / cells
    found = {}
    least_blocks = 20
    for name, (least, most) in BANDS.items():
        here = variance[(level >= least) & (level <= most)]
        found[name] = float(np.sqrt(np.median(here) / low)) if len(here) >= least_blocks else float("nan")
    return Strength(found, found)


def _diagonals(images: np.ndarray) -> np.ndarray:
    """(N, rows, columns) -> (N, rows / 2, columns / 2)."""
    a, b, c, d = images[:, ::2, ::2], images[:, ::2, 1::2], images[:, 1::2, ::2], images[:, 1::2, 1::2]
    return (a - b - c + d) / 2


@dataclass(frozen=True)
class Strengths:
    """Of a study: what its training images carry, what its test sets show, what its arms add."""

    images: Strength
    tests: Mapping[str, Strength]
    arms: Mapping[str, Strength]
    baseline: str
    noisy: tuple[str, ...]

    def table(self) -> ResultTable:
        """One row for the images, each test set and each arm."""

        def cells(strength: Strength, both: bool) -> list[str]:
            return [
                "none"
                if np.isnan(strength.total[level])
                else f"{strength.total[level]:.2f}"
                + (f" (white {strength.white[level]:.2f})" if both else "")
                for level in LEVELS
            ]

        rows = [["training images carry", *cells(self.images, False)]]
        rows += [[f"test set {name} shows", *cells(each, False)] for name, each in self.tests.items()]
        rows += [[f"arm {name} adds", *cells(each, True)] for name, each in self.arms.items()]
        title = "Noise, standard deviation in 8-bit levels (images: white part alone, an upper bound where there is texture)"
        return ResultTable(title, ["", *LEVELS], rows)

    def warnings(self) -> list[str]:
        """A line for each arm with sensor or white noise that hardly raises the noise beyond the baseline's."""
        said = []
        for name in self.noisy:
            raised = [self._raised(name, level) for level in LEVELS]
            if name != self.baseline and max(raised) < INVISIBLE:
                said.append(
                    f"invisible arm: {name} raises the noise of the training images by at most "
                    f"{100 * (max(raised) - 1):.0f} % over {self.baseline} (what the images carry included); raise its "
                    "gain (`gain_db`), or expect no difference"
                )
        return said

    def _raised(self, name: str, level: str) -> float:
        """Noise with this arm over noise with the baseline, both on top of what the images carry."""
        there = self.images.total[level]
        rounding = 12**-0.5  # what rounding to 8 bit leaves, whatever the image
        there = rounding if np.isnan(there) else max(there, rounding)
        base = self.arms[self.baseline].total[level] if self.baseline in self.arms else 0.0
        return float(np.hypot(there, self.arms[name].total[level]) / np.hypot(there, base))

    def text(self) -> str:
        """Table and warnings, as printed before a training."""
        return "\n".join([self.table().to_markdown(), *(f"warning: {line}" for line in self.warnings())])


def strengths(study: "Study") -> Strengths:
    """Of a study whose data are ready."""
    config = study.config
    arms = {name: config.arm(name) for name in config.arms}

    def seen(poses: PoseSet) -> Strength:
        return carried(poses, config.seen_size(poses.camera), config.data.reduction)

    def added(arm: Arm) -> Strength:
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
