"""A colour camera of its own in NumPy and SciPy, after the papers; shares nothing with the package."""

import numpy as np
from scipy.ndimage import convolve

COLOURS = {"R": 0, "G": 1, "B": 2}
BILINEAR_GREEN = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
BILINEAR_OTHER = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
# H. Malvar, L. He, R. Cutler, ICASSP 2004, figure 2, each times 8.
GREEN_AT_OTHER = np.array(
    [[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]
)
SAME_ROW = np.array(
    [[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]]
)
OPPOSITE = np.array(
    [[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]]
)


def cfa_map(word, shape, origin=(0, 0)):
    """Which colour each pixel has, 0 to 2."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    places = 2 * ((y + origin[0]) % 2) + (x + origin[1]) % 2
    return np.array([COLOURS[letter] for letter in word])[places]


def light(rgb, cfa, white_balance, matrix):
    """What falls on each pixel behind its filter, of pictures (..., 3, H, W)."""
    gains = np.asarray(white_balance) / min(white_balance)
    camera = np.einsum("ij,...jhw->...ihw", np.linalg.inv(matrix), rgb) / gains[:, None, None]
    return np.maximum(
        np.take_along_axis(camera, np.broadcast_to(cfa, (*camera.shape[:-3], 1, *cfa.shape)), -3), 0
    )[..., 0, :, :]


def demosaiced(raw, cfa, method):
    """(3, H, W) of a plane (H, W)."""
    if method == "bilinear":
        kernels = [BILINEAR_OTHER, BILINEAR_GREEN, BILINEAR_OTHER]
        return np.stack(
            [convolve(np.where(cfa == c, raw, 0), k, mode="mirror") for c, k in enumerate(kernels)]
        )
    cross, row, column, opposite = (
        convolve(raw, k / 8, mode="mirror") for k in (GREEN_AT_OTHER, SAME_ROW, SAME_ROW.T, OPPOSITE)
    )
    beside = np.pad(cfa, 1, mode="reflect")[1:-1, 2:]  # the colour of the neighbours in the row
    out = []
    for c in range(3):
        other = cross if c == 1 else np.where(cfa == 1, np.where(beside == c, row, column), opposite)
        out.append(np.where(cfa == c, raw, other))
    return np.stack(out)


def developed(raw, cfa, white_balance, matrix, method):
    """The picture (3, H, W) of a plane (H, W) whose 1 is saturation."""
    gains = np.asarray(white_balance) / min(white_balance)
    balanced = np.minimum(raw * gains[cfa], 1)
    return np.clip(np.einsum("ij,jhw->ihw", matrix, demosaiced(balanced, cfa, method)), 0, 1)
