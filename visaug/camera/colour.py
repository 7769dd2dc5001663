"""A colour camera: from the picture's linear RGB to one plane behind a colour filter array, and back.

    light of filter c at a pixel:   L_c = max(0, sum_k A_ck rgb_k) min(w) / w_c,    A the inverse of the matrix M
    the sensor takes L_c of the pixel's own filter: one plane, to which the chain adds its noise, and which it clips
    white balance:                  y <- min(1, y w_c / min(w))
    demosaicing:                    r_c = the missing colours from the neighbours, linear in them
    colour matrix:                  rgb_k = clip(sum_c M_kc r_c, 0, 1)

Rows of M sum to 1, so equal channels stay equal: white is white at every white balance. The filter with the least w just saturates
at white, the others below it: that is where their noise comes from. Light cannot be negative: a colour that no light makes in this
camera is taken as the nearest without the negative part. What is more than the sensor holds saturates.

Both demosaicings are linear with weights that repeat every 2 x 2 pixels, so six sums of neighbours give all three channels:
own value; the 2 neighbours in the row; in the column; the 4 diagonal ones; the 2 next but one in the row; in the column.

Sources: B. Bayer, US patent 3 971 065 (1976); H. S. Malvar, L.-W. He, R. Cutler, "High-quality linear interpolation for
demosaicing of Bayer-patterned color images", ICASSP 2004, figure 2; the order of steps, and highlights that are clipped after
the white balance, as in D. Coffin's dcraw.
"""

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache, partial
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from visaug.camera.loops import in_threads
from visaug.core.errors import InputError

REACH = 2  # pixels to each side that a demosaicing looks at
# Weights of the six sums for a missing colour at a pixel.
BILINEAR = {
    "cross": (0, 1 / 4, 1 / 4, 0, 0, 0),  # green at red and blue
    "row": (0, 1 / 2, 0, 0, 0, 0),  # red or blue at green, whose neighbours in the row have it
    "column": (0, 0, 1 / 2, 0, 0, 0),
    "diagonal": (0, 0, 0, 1 / 4, 0, 0),  # red at blue, blue at red
}
MALVAR = {
    "cross": (4 / 8, 2 / 8, 2 / 8, 0, -1 / 8, -1 / 8),
    "row": (5 / 8, 4 / 8, 0, -1 / 8, -1 / 8, 0.5 / 8),
    "column": (5 / 8, 0, 4 / 8, -1 / 8, 0.5 / 8, -1 / 8),
    "diagonal": (6 / 8, 0, 0, 2 / 8, -1.5 / 8, -1.5 / 8),
}
DEMOSAICS = {"bilinear": BILINEAR, "malvar": MALVAR}
OWN = (1, 0, 0, 0, 0, 0)


@lru_cache(maxsize=64)
def colour_path(*numbers: Any) -> "ColourPath":
    """A `ColourPath` of these arguments, worked out once."""
    return ColourPath(*numbers)


class ColourPath:
    """The numbers of one camera's colour path.

    Args:
        cfa: RGGB, BGGR, GRBG or GBRG: colours of the sensor's pixels (0, 0), (0, 1), (1, 0), (1, 1).
        white_balance: w, factors of red, green, blue; only their ratios matter.
        matrix: M, from the camera's RGB to the picture's, rows of sum 1.
        demosaic: bilinear or malvar.
        origin: row and column of the sensor at which the images begin.

    Attributes:
        filters: (2, 2) which of red, green, blue (0, 1, 2) lies at even and odd rows and columns of the image.
        inverse: (3, 3) from the picture's linear RGB to the light of the three filters.
        gains: (3,) white balance, the least is 1.
        weights: (2, 2, 3, 6) from the six sums to the picture's RGB, demosaicing and matrix in one.
    """

    def __init__(
        self,
        cfa: str,
        white_balance: Sequence[float] = (1, 1, 1),
        matrix: Sequence[Sequence[float]] = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        demosaic: str = "bilinear",
        origin: tuple[int, int] = (0, 0),
    ):
        pattern = np.array(["RGB".index(letter) for letter in cfa]).reshape(2, 2)
        self.filters = np.roll(pattern, (-(origin[0] % 2), -(origin[1] % 2)), (0, 1))
        gains = np.array(white_balance, np.float32)
        self.gains = gains / gains.min()
        rows = np.array(matrix, np.float64)
        rows /= rows.sum(1, keepdims=True)  # 1 but for the rounding of the file
        self.inverse = (np.linalg.inv(rows) / self.gains[:, None]).astype(np.float32)
        self.weights = np.einsum("kc,xycf->xykf", rows, self._missing(DEMOSAICS[demosaic])).astype(np.float32)

    def _missing(self, weights: Mapping[str, Sequence[float]]) -> np.ndarray:
        """Weights of the six sums for each colour, (2, 2, 3, 6)."""
        table = np.zeros((2, 2, 3, 6))
        for row, column in np.ndindex(2, 2):
            own, beside = self.filters[row, column], self.filters[row, 1 - column]
            for wanted in range(3):
                if wanted == own:
                    table[row, column, wanted] = OWN
                elif wanted == 1:
                    table[row, column, wanted] = weights["cross"]
                elif own == 1:
                    table[row, column, wanted] = weights["row" if wanted == beside else "column"]
                else:
                    table[row, column, wanted] = weights["diagonal"]
        return table

    def plane(self, images: Tensor) -> Tensor:
        """Light behind the filters, (B, 1, H, W), of pictures (B, 1|3, H, W): `mosaic(light(images))`, compiled where it can be."""
        loops = _loops(images)
        if loops is None:
            return self.mosaic(self.light(images))
        check_size(images)
        source = images.detach().contiguous()
        plane = torch.empty_like(source[:, :1])
        arguments = source.numpy(), plane.numpy()[:, 0], self.filters, self.inverse
        in_threads(partial(loops.mosaic, *arguments), plane.shape[0] * plane.shape[2])
        return plane

    def light(self, images: Tensor) -> Tensor:
        """Light of the three filters, (B, 3, H, W), from pictures (B, 1|3, H, W), linear in light, in [0, 1]."""
        check_size(images)
        inverse = self._like(self.inverse, images)
        return torch.einsum("ck,bkhw->bchw", inverse, images.expand(-1, 3, -1, -1)).clamp_min(0)

    def mosaic(self, light: Tensor) -> Tensor:
        """Of (B, 3, H, W) the one plane (B, 1, H, W) that the filters let through."""
        plane = torch.zeros_like(light[:, :1])
        for channel in range(3):
            plane = torch.where(self._is(channel, light), light[:, channel : channel + 1], plane)
        return plane

    def develop(self, plane: Tensor) -> Tensor:
        """The picture (B, 3, H, W), linear in light, in [0, 1], of a plane (B, 1, H, W) whose 1 is saturation."""
        loops = _loops(plane)
        if loops is None:
            return self._developed(plane)
        balanced = plane.detach().clone(memory_format=torch.contiguous_format).numpy()[:, 0]
        picture = torch.empty(len(plane), 3, *plane.shape[2:])
        rows = plane.shape[0] * plane.shape[2]
        in_threads(partial(loops.balance, balanced, self.filters, self.gains), rows)
        in_threads(partial(loops.develop, balanced, picture.numpy(), self.weights), rows)
        return picture

    def _developed(self, plane: Tensor) -> Tensor:
        """The same in torch."""
        gains = torch.ones_like(plane[:1])
        for channel in range(3):
            gains = torch.where(self._is(channel, plane), float(self.gains[channel]), gains)
        sums = _sums((plane * gains).clamp_max(1))
        weights = self._like(self.weights, plane)
        picture = plane.new_empty(len(plane), 3, *plane.shape[2:])
        for row, column in np.ndindex(2, 2):
            own = torch.einsum("kf,bfhw->bkhw", weights[row, column], sums[..., row::2, column::2])
            picture[..., row::2, column::2] = own
        return picture.clamp(0, 1)

    def _is(self, channel: int, like: Tensor) -> Tensor:
        """Where this filter lies, (1, 1, H, W)."""
        rows, columns = (torch.arange(n, device=like.device) % 2 for n in like.shape[2:])
        filters = torch.from_numpy(self.filters).to(like.device)
        return (filters[rows][:, columns] == channel)[None, None]

    @staticmethod
    def _like(array: np.ndarray, like: Tensor) -> Tensor:
        return torch.as_tensor(array, dtype=like.dtype, device=like.device)


def check_size(images: Tensor) -> None:
    """Refuses pictures that a colour camera cannot take."""
    channels, rows, columns = images.shape[1:]
    if channels not in (1, 3):
        raise InputError(f"images have {channels} channels", expected="1 or 3 channels for a colour camera")
    if min(rows, columns) <= REACH:
        expected = f"{REACH + 1} x {REACH + 1} or more for a colour camera"
        raise InputError(f"images have {rows} x {columns} pixels", expected=expected)


def _loops(tensor: Tensor) -> Any:
    """The compiled loops if they can replace torch: on a CPU, without gradients; else None."""
    if torch.compiler.is_compiling() or tensor.device.type != "cpu" or tensor.dtype != torch.float32:
        return None
    if torch.is_grad_enabled() and tensor.requires_grad:
        return None
    return _kernel()


@cache
def _kernel() -> Any:
    try:
        from visaug.camera import colour_kernel
    except ImportError:
        return None
    return colour_kernel


def _sums(plane: Tensor) -> Tensor:
    """The six sums of neighbours, (B, 6, H, W); beyond the edge the image is mirrored about its last pixel: filters stay."""
    rows, columns = plane.shape[2:]
    padded = F.pad(plane, (REACH,) * 4, mode="reflect")

    def at(down: int, right: int) -> Tensor:
        return padded[:, 0, REACH + down : REACH + down + rows, REACH + right : REACH + right + columns]

    diagonal = at(-1, -1) + at(-1, 1) + at(1, -1) + at(1, 1)
    near = at(0, -1) + at(0, 1), at(-1, 0) + at(1, 0)
    return torch.stack([at(0, 0), *near, diagonal, at(0, -2) + at(0, 2), at(-2, 0) + at(2, 0)], 1)
