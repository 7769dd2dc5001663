"""JPEG."""

import torch
import torch.nn.functional as F
from torch import Tensor

from visaug.effects.effect import Effect, Stage
from visaug.effects.optics.spread import cosines
from visaug.effects.parameter import Parameter, choice
from visaug.effects.straight_through import round_through

# Annex K.1 of the standard, the tables of quality 50 for luminance and chrominance, row by row.
LUMINANCE = """
16 11 10 16 24 40 51 61  12 12 14 19 26 58 60 55  14 13 16 24 40 57 69 56  14 17 22 29 51 87 80 62
18 22 37 56 68 109 103 77  24 35 55 64 81 104 113 92  49 64 78 87 103 121 120 101  72 92 95 98 112 100 103 99
"""
CHROMINANCE = """
17 18 24 47 99 99 99 99  18 21 26 66 99 99 99 99  24 26 56 99 99 99 99 99  47 66 99 99 99 99 99 99
99 99 99 99 99 99 99 99  99 99 99 99 99 99 99 99  99 99 99 99 99 99 99 99  99 99 99 99 99 99 99 99
"""
YCC = ((0.299, 0.587, 0.114), (-0.168735892, -0.331264108, 0.5), (0.5, -0.418687589, -0.081312411))  # JFIF


class JPEG(Effect):
    """The picture is compressed as an 8-bit JPEG file and decoded.

    Blocks of 8 x 8 pixels are cosine transformed, and their coefficients are rounded to multiples of a step that grows with
    the frequency and with decreasing quality: fine noise is lost first, and the remaining noise has the shape of the basis
    functions. A picture with three channels is converted to luminance and two colour differences, which are averaged over
    2 x 2 pixels if `chroma` is half (4:2:0). One channel is a gray JPEG. Images whose sides are not multiples of the block
    size are padded with their last pixels, as encoders do.
    """

    name = "jpeg"
    stage = Stage.PICTURE
    order = 40
    local = False
    aliases = ("compression", "block artefacts")
    summary = "The picture is compressed as JPEG."
    equation = """c <- q round(c / q), c the DCT of 8 x 8 blocks of 255 y - 128, q = clip(floor((s t + 50) /
    100), 1, 255), s = 5000 / quality below 50, 200 - 2 quality from there, t the tables of Annex K"""
    source = """ITU-T T.81 (1992), Annexes A and K; JFIF 1.02; quality as in the Independent JPEG Group's library"""
    separates = "compute the DCT of 8 x 8 blocks: the coefficients are multiples of a step"
    differentiable = False
    why_not = """the quality is an integer and coefficients are rounded; the gradient of the image passes
    straight through the rounding"""
    quality = Parameter(
        90.0, "1", 1.0, 100.0, "cameras: 85 to 98; SPEED+ is JPEG", integer=True, trials=(95, 75)
    )
    chroma = choice(("half", "full"), "half: 4:2:0, most files; full: 4:4:4")

    def apply(self, signal, p, stream, context):
        picture = round_through(signal.clamp(0, 1) * 255)
        channels, (rows, columns) = signal.shape[1], signal.shape[2:]
        if channels != 3:
            return round_through(_coded(picture - 128, steps(p.quality, LUMINANCE)) + 128).clamp(0, 255) / 255
        block = 16 if p.chroma == "half" else 8
        padded = F.pad(picture, (0, -columns % block, 0, -rows % block), mode="replicate")
        matrix = torch.tensor(YCC, dtype=signal.dtype, device=signal.device)
        ycc = torch.einsum("ij,bjhw->bihw", matrix, padded - torch.tensor(128.0, device=signal.device))
        ycc = round_through(ycc)
        luminance = round_through(_coded(ycc[:, :1], steps(p.quality, LUMINANCE)))
        differences = ycc[:, 1:]
        if p.chroma == "half":
            differences = round_through(F.avg_pool2d(differences, 2))
        differences = round_through(_coded(differences, steps(p.quality, CHROMINANCE)))
        if p.chroma == "half":
            differences = _doubled(differences)
        back = torch.linalg.inv(matrix.double()).to(signal.dtype)
        rgb = torch.einsum("ij,bjhw->bihw", back, torch.cat([luminance, differences], 1)) + 128
        return round_through(rgb[..., :rows, :columns]).clamp(0, 255) / 255


def steps(quality: Tensor, table: str) -> Tensor:
    """The rounding steps of each image's coefficients, (B, 1, 1, 1, 8, 8)."""
    quality = quality.round().view(-1, 1, 1, 1, 1, 1)
    scale = torch.where(quality < 50, torch.floor(5000 / quality), 200 - 2 * quality)
    half = torch.tensor(list(map(float, table.split())), dtype=quality.dtype, device=quality.device)
    return ((scale * half.view(8, 8) + 50) / 100).floor().clamp(1, 255)


def _coded(plane: Tensor, step: Tensor) -> Tensor:
    """Planes (B, C, H, W) with the coefficients of their blocks rounded."""
    rows, columns = plane.shape[-2:]
    padded = F.pad(plane, (0, -columns % 8, 0, -rows % 8), mode="replicate")
    batch, channels, high, wide = padded.shape
    dct = cosines(8, plane.dtype, str(plane.device))
    blocks = padded.view(batch, channels, high // 8, 8, wide // 8, 8).transpose(3, 4)
    rounded = round_through(dct @ blocks @ dct.T / step) * step
    whole = (dct.T @ rounded @ dct).transpose(3, 4).reshape(batch, channels, high, wide)
    return whole[..., :rows, :columns]


def _doubled(plane: Tensor) -> Tensor:
    """Twice as many rows and columns: each new pixel is 3/4 of the nearest and 1/4 of the next, as decoders have it."""
    for axis in (2, 3):
        last = plane.shape[axis] - 1
        before = torch.cat([plane.narrow(axis, 0, 1), plane.narrow(axis, 0, last)], axis)
        after = torch.cat([plane.narrow(axis, 1, last), plane.narrow(axis, last, 1)], axis)
        pair = torch.stack([0.75 * plane + 0.25 * before, 0.75 * plane + 0.25 * after], axis + 1)
        plane = pair.flatten(axis, axis + 1)
    return plane
