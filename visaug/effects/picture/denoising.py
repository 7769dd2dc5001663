"""Denoising in the camera."""

import torch
import torch.nn.functional as F

from visaug.effects.effect import Spreading, Stage
from visaug.effects.parameter import Parameter, Strength, choice


class Denoising(Spreading):
    """What a denoiser in the camera or in a converter leaves: less noise, correlated over neighbours, and less fine detail.

    `median`: of the 3 x 3 pixels around each. `wavelet`: the two finest scales of the undecimated starlet transform, each
    reduced by the threshold (soft thresholding); the second scale, whose noise is a fifth, by a fifth of it.
    """

    name = "denoising"
    stage = Stage.PICTURE
    order = 16  # before the sharpening
    aliases = ("noise reduction", "NR", "despeckle", "smoothing", "star eater")
    summary = "A denoiser removes noise together with fine detail."
    equation = """y <- y + amount (f(y) - y); median: f the median of 3 x 3; wavelet: f = y - sum_j clip(w_j,
    -t_j, t_j), w_1 and w_2 the starlet coefficients, t_2 = t_1 / 5"""
    source = """J.-L. Starck, F. Murtagh and J. Fadili, Sparse Image and Signal Processing (Cambridge 2010),
    starlets; D. L. Donoho, IEEE Trans. Information Theory 41 (1995) 613"""
    separates = """compare the noise of flat regions with that beside edges: a denoiser leaves more of it near edges"""
    amount = Strength(1.0, "fraction", 0.0, 1.0, "mixture of both, as editors offer it", trials=(0.5, 1.0))
    threshold = Parameter(
        0.03, "fraction", 0.0, 1.0, "of full scale; three standard deviations of the noise", of=("wavelet",)
    )
    filter = choice(("median", "wavelet"), "median: despeckling; wavelet: raw converters")

    def apply(self, signal, p, stream, context):
        smooth = _median(signal) if p.filter == "median" else _shrunk(signal, p.threshold)
        return signal + p.amount * (smooth - signal)


def _median(signal):
    rows, columns = signal.shape[-2:]
    padded = F.pad(signal, (1, 1, 1, 1), mode="replicate")
    around = [padded[..., i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return torch.stack(around).median(0).values


def _shrunk(signal, threshold):
    fine, taken = signal, torch.zeros_like(signal)
    for scale in range(2):  # structures of one and two pixels
        coarse = _smoothed(_smoothed(fine, 2**scale, -1), 2**scale, -2)
        most = threshold / 5**scale  # white noise of 1 has 0.89 and 0.20 in the first two scales
        taken = taken + torch.maximum(torch.minimum(fine - coarse, most), -most)
        fine = coarse
    return signal - taken


def _smoothed(signal, step, axis):
    reach, length = 2 * step, signal.shape[axis]
    padded = F.pad(signal, (reach, reach, 0, 0) if axis == -1 else (0, 0, reach, reach), mode="replicate")
    total = torch.zeros_like(signal)
    spline = (1 / 16, 4 / 16, 6 / 16, 4 / 16, 1 / 16)  # B3 scaling function of the starlet transform
    for k, weight in enumerate(spline):
        total = total + weight * padded.narrow(axis, k * step, length)
    return total
