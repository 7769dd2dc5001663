"""What was done to the frames before: sharing between neighbours, denoising, demosaicing, defect correction, JPEG."""

import math
from dataclasses import replace

import numpy as np
from scipy import fft, stats

from visaug.core.constants import MAD
from visaug.core.wording import counted
from visaug.frames import FrameSet
from visaug.inspection.finding import ALPHA, Finding, needed_z
from visaug.inspection.material import FrameGroup
from visaug.pictures.blocks import SIDE
from visaug.pictures.files import largest_group, quality_of

_STEPS = np.arange(2, 61)  # of JPEG's rounding, that pixels in whole DN can show
Lag = tuple[int, int]


def processing_findings(look: FrameGroup) -> list[Finding]:
    """Sharing between neighbours and its likely causes; needs frames of a still scene."""
    if look.count == 1 and not look.is_uniform:
        return []
    # What neighbours may share: the temporal noise, of one frame its pixels.
    noise = look.data.noise_pixels if look.count > 1 else look.data.pattern_pixels[None]
    found = _demosaicing(look, noise), _correlated(look, noise), _corrected(look)
    return [f for f in found if f is not None]


def _mean_product(images: np.ndarray, lag: Lag) -> float:
    """Mean product of images (n, H, W) and themselves shifted by `lag` rows and columns, DN^2."""
    rows, columns = lag
    height, width = images.shape[-2:]
    here, there = images[..., : height - rows, : width - columns], images[..., rows:, columns:]
    return float(np.einsum("nij,nij->", here, there, dtype=np.float64)) / here.size


def shares_of_neighbours(noise: np.ndarray, frames: int) -> tuple[dict[Lag, float], dict[Lag, float]]:
    """Correlation of noise (n, H, W) with its neighbours along row, column and diagonal; of the first two in standard errors.

    Less that of pixels far apart, which what is taken out of the noise (means of rows, columns and, of several frames, of
    pixels) gives too.
    """
    variance = float(np.mean(noise**2, dtype=np.float64))
    apart = 6  # px, at which noise is not shared by optics, pixels or filters
    height, width = noise.shape[-2:]
    free = len(noise) * (1 - 1 / height) * (1 - 1 / width) * (1 - 1 / frames if frames > 1 else 1)
    shared: dict[Lag, float] = {}
    z: dict[Lag, float] = {}
    for lag in ((0, 1), (1, 0), (1, 1)):
        far = apart * lag[0], apart * lag[1]
        shared[lag] = (_mean_product(noise, lag) - _mean_product(noise, far)) / variance
        if lag != (1, 1):
            pairs = sum(1 / ((height - rows) * (width - columns)) for rows, columns in (lag, far))
            z[lag] = shared[lag] / math.sqrt(pairs / free)
    return shared, z


def _correlated(look: FrameGroup, noise: np.ndarray) -> Finding | None:
    variance = float(np.mean(noise**2, dtype=np.float64))
    if variance < 1e-3:
        return None
    shared, z = shares_of_neighbours(noise, look.count)
    across, down, diagonal = shared.values()
    lag = max(z, key=lambda lag: abs(z[lag]))
    top = shared[lag]
    if abs(z[lag]) < needed_z(2):
        return None
    error = top / z[lag]
    equal, more_equal = _equal_share(look), 1.6  # times as many equal neighbours as normal noise has
    denoised = equal > more_equal and top > 0.1
    why = "crosstalk, interpolation, a smoothing filter or a slow amplifier do that"
    if denoised:
        why = f"equal neighbours come {equal:.1f} times as often as in noise: a median or similar filter was applied"
    elif top < 0:
        why = "negative values come from sharpening"
    low, high = (look.noise_dn * math.sqrt(max(abs(top) + k * 1.96 * error, 0.0)) for k in (-1, 1))
    return Finding(
        "denoising" if denoised else "correlated_noise",
        look.new,
        f"Neighbours share noise: correlation {across:+.3f} along the row, {down:+.3f} along the column, {diagonal:+.3f} "
        f"along the diagonal; {why}.",
        f"noise shared by neighbours ({top:+.2f}{', denoised' if denoised else ''})",
        (top / error) ** 2,
        amplitude_dn=look.noise_dn * math.sqrt(abs(top)),
        low=low,
        high=high,
        share=abs(top),
        details={"along_row": across, "along_column": down, "diagonal": diagonal},
        shown={"noise": noise[0]},
    )


def _equal_share(look: FrameGroup) -> float:
    """How often neighbours are equal, over how often normal differences of the same spread are."""
    frame = look.frames[0]
    difference = frame[:, 1:] - frame[:, :-1]
    spread = MAD * float(np.median(np.abs(difference[difference != 0]))) if difference.any() else 0.0
    return 0.0 if spread < 1.0 else float(np.mean(difference == 0)) * math.sqrt(2 * math.pi) * spread


def _demosaicing(look: FrameGroup, noise: np.ndarray) -> Finding | None:
    """Interpolated pixels have less noise than those that a colour filter left alone: a lattice of period 2, with sharing."""
    height, width = (n // 2 * 2 for n in look.shape)
    cells = noise[:, :height, :width].reshape(len(noise), height // 2, 2, width // 2, 2)
    variances = (cells.astype(np.float64) ** 2).mean((0, 1, 3)).ravel()
    total = float(variances.mean())
    if total < 1e-3:
        return None
    independent = noise.size / 4 * (1 - 1 / look.count if look.count > 1 else 1)
    kurtosis = float((noise.astype(np.float64) ** 4).mean()) / total**2
    error = math.sqrt((kurtosis - 1) / independent)
    spread = float(np.ptp(variances)) / total
    shared = (_mean_product(noise, (0, 1)) + _mean_product(noise, (1, 0))) / 2 / total
    least_shared = max(needed_z() / math.sqrt(independent), 0.05)
    if spread < max(needed_z(6) * 1.5 * error, 0.1) or shared < least_shared:
        return None
    return Finding(
        "demosaicing",
        look.new,
        f"Noise differs between the four places of a 2 x 2 cell by {spread:.0%} and is shared by neighbours ({shared:+.2f}): the "
        "frames were interpolated from a colour mosaic.",
        "demosaiced frames",
        (spread / error) ** 2 + (shared**2) * independent,
        period=2.0,
        share=spread,
        details={"variances": [float(v / total) for v in variances]},
        shown={"noise": noise[0]},
    )


def _corrected(look: FrameGroup) -> Finding | None:
    """Pixels that are the mean of their neighbours in every frame."""
    frames = look.frames
    if look.count < 2 or look.noise_dn < 1.0:
        return None
    inner = frames[:, 1:-1, 1:-1]
    left, right = frames[:, 1:-1, :-2], frames[:, 1:-1, 2:]
    up, down = frames[:, :-2, 1:-1], frames[:, 2:, 1:-1]
    moves = np.ptp(inner, axis=0) > 0
    many = 0.05  # of the pixels: more are no defects
    for name, guess in (
        ("of its neighbours in the row", (left + right) / 2),
        ("of its neighbours in the column", (up + down) / 2),
        ("of its four neighbours", (left + right + up + down) / 4),
    ):
        near = np.abs(inner - guess) <= 0.5
        hits = near.all(0) & moves
        count = int(hits.sum())
        # Without a correction as many pixels lie one or two DN beside the mean in every frame.
        beside = max(int(((np.abs(inner - guess - d) <= 0.5).all(0) & moves).sum()) for d in (-2, -1, 1, 2))
        chance = max(beside + 3 * math.sqrt(beside), hits.size * near.mean() ** look.count) + 0.2
        if not 0 < count < many * hits.size or stats.poisson.sf(count - 1, chance) > ALPHA:
            continue
        where = np.pad(hits, 1)
        verb = "are" if count > 1 else "is"
        return Finding(
            "defect_correction",
            "fixed",
            f"{counted(count, 'pixel')} {verb} the mean {name} in every frame: defects were corrected before.",
            counted(count, "corrected pixel"),
            2 * (count * math.log(count / chance) - count + chance),
            share=count / where.size,
            details={"pixels": count},
            places=tuple((int(r), int(c), "corrected", 0.0) for r, c in np.argwhere(where)),
            shown={"image": look.raw.mean, "where": where},
        )
    return None


def compression(looks: list[FrameGroup], frames: FrameSet) -> Finding | None:
    """JPEG, by the files themselves or by the rounding of block coefficients that it left in the pixels."""
    path = frames.path(0)
    if path is not None and path.suffix.lower() in (".jpg", ".jpeg"):
        images = frames.with_records([replace(r, kind="image") for r in frames.records])
        pictures = largest_group(images, lambda _: None)
        quality, step = quality_of(pictures.steps)[0], float(np.min(pictures.steps))
        return Finding(
            "compression",
            None,
            f"The files are JPEG of quality {quality:.0f}: differences below its steps ({step:.0f} DN and more) are hidden, and "
            "single pixels cannot be trusted.",
            f"JPEG of quality {quality:.0f}",
            1e9,
            amplitude_dn=step / math.sqrt(12),
            details={"quality": quality, "step_dn": step},
        )
    look = max(looks, key=lambda k: k.frames.size)
    found = _by_pixels(look)
    if found is None:
        return None
    (down, across), step, count, gain = found
    return Finding(
        "compression",
        None,
        f"{count} of 49 coefficients of 8 x 8 blocks are rounded, to multiples of {step:.0f} DN in the median: the frames were "
        "JPEG before; differences below that are hidden.",
        "JPEG compression before",
        gain,
        amplitude_dn=step / math.sqrt(12),
        period=float(SIDE),
        details={"step_dn": step, "grid_row": down, "grid_column": across},
        shown={"noise": look.frames[0]},
    )


def _by_pixels(look: FrameGroup) -> tuple[tuple[int, int], float, int, float] | None:
    """Place of the grid, median step, number of rounded coefficients, evidence.

    The places with most coefficients of 0 are looked at, against others of the same frames.
    """
    if min(look.shape) < 4 * SIDE:
        return None
    places = [(down, across) for down in range(SIDE) for across in range(SIDE)]
    still = np.array([np.mean(np.abs(_coefficients(look, *place)) < 0.5) for place in places])
    order = np.argsort(-still)
    others = [_characteristic(look, *places[k])[0] for k in order[SIDE :: SIDE * 2]]
    usual = np.nan_to_num(np.median(others, axis=0), nan=1.0)
    rounded = 0.25  # of the characteristic function at 1/step, above which coefficients are multiples of it
    least = 4  # coefficients that are so, of 49 that rows and columns do not reach
    number = np.arange(1, SIDE**2)
    of_no_line = (number >= SIDE) & (number % SIDE > 0)
    for place in dict.fromkeys([(0, 0), places[order[0]]]):
        function, count = _characteristic(look, *place)
        excess = np.nan_to_num(function - usual).max(1)
        # A mean cosine of n blocks scatters by 1 / sqrt(2 n) at most, the median of the others by 0.6 of it.
        chance = needed_z(2 * function.size) * 1.2 / np.sqrt(2.0 * np.maximum(count, 1))
        which = np.flatnonzero((excess > np.maximum(rounded, chance)) & of_no_line)
        if len(which) >= least:
            steps = _STEPS[(function - usual)[which].argmax(1)]
            return place, float(np.median(steps)), len(which), 2e3 * len(which)
    return None


def _coefficients(look: FrameGroup, down: int, across: int) -> np.ndarray:
    """(blocks, 63) coefficients of 8 x 8 blocks of the first frames on one place of the grid, without the mean."""
    height, width = ((n - k) // SIDE for n, k in zip(look.shape, (down, across)))
    most_blocks = 1000
    take = max(1, min(look.count, most_blocks // (height * width)))
    part = look.frames[:take, down : down + height * SIDE, across : across + width * SIDE]
    blocks = part.reshape(take, height, SIDE, width, SIDE).transpose(0, 1, 3, 2, 4).reshape(-1, SIDE, SIDE)
    blocks = blocks[:: -(-len(blocks) // most_blocks)]
    return np.asarray(fft.dctn(blocks, axes=(1, 2), norm="ortho")).reshape(len(blocks), -1)[:, 1:]


def _characteristic(look: FrameGroup, down: int, across: int) -> tuple[np.ndarray, np.ndarray]:
    """(63, steps) mean cosine of 2 pi c / step of block coefficients c, NaN where hardly any differs from 0; how many do."""
    c = _coefficients(look, down, across)
    moves = np.abs(c) >= 0.5  # a coefficient of 0 is a multiple of every step
    count = moves.sum(0)
    phi = np.stack([np.where(moves, np.cos(2 * math.pi / q * c), 0.0).sum(0) for q in _STEPS], 1)
    return np.where(count > 50, 1 / np.maximum(count, 1), np.nan)[:, None] * phi, count


def noise_law(look: FrameGroup) -> tuple[str, float] | None:
    """Whether the temporal noise is normal or has heavy tails, and its excess kurtosis in one frame; None of one frame."""
    if look.count < 2:
        return None
    if look.noise_dn < 0.5:  # DN, below which rounding hides its law
        return "law not told: below the step of the codes", 0.0
    noise = look.raw.noise_pixels
    n = look.count
    second = float((noise.astype(np.float64) ** 2).mean())
    excess = float((noise.astype(np.float64) ** 4).mean()) / second**2 - 3
    mixing = (1 - 1 / n) ** 2 + (n - 1) / n**4 / (1 - 1 / n) ** 2  # of a frame less the mean of all
    error = math.sqrt(24 / (noise.size * (1 - 1 / n))) / mixing
    excess /= mixing
    return "heavy tails" if excess > 4 * error else "normal", excess
