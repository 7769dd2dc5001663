"""What changes slowly over the sensor, and from frame to frame as a whole."""

import math

import numpy as np

from visaug.core.wording import number
from visaug.inspection.finding import Finding, deviation, needed, needed_z
from visaug.inspection.lines import RowMeans, regular
from visaug.inspection.material import FrameGroup
from visaug.statistics.reduction import block_means, edges

_PLACES = (
    ("the upper left corner", "the upper edge", "the upper right corner"),
    ("the left edge", "the middle", "the right edge"),
    ("the lower left corner", "the lower edge", "the lower right corner"),
)


def glow(look: FrameGroup, rows: RowMeans, columns: RowMeans) -> Finding | None:
    """A smooth bump or slope of the mean frame, against what pixels and lines scatter."""
    if not look.is_uniform:
        return None
    mean = look.data.calm.astype(np.float64) - regular(rows)[:, None] - regular(columns)[None, :]
    height, width = look.shape
    most_blocks = 8  # along rows and along columns
    parts = [edges(n, min(most_blocks, n // 8)) for n in look.shape]
    blocks = block_means(mean, *parts).astype(np.float64)
    blocks -= np.median(blocks)
    down, across = blocks.shape
    area = height * width / blocks.size
    coarse = max(rows.look.colour[:down].max() * columns.look.colour[:across].max(), 1.0)
    variance = look.pattern_variance / area * coarse
    for lines, count in ((rows, height / down), (columns, width / across)):
        fixed, temporal = lines.continua()
        variance += fixed.white / count
        variance += 0.0 if temporal is None else float(temporal.beyond(1.0)) / look.count / count
    error = math.sqrt(max(variance, 1e-12))
    apart = blocks / error
    top = tuple(int(k) for k in np.unravel_index(np.abs(apart).argmax(), apart.shape))
    chi = float((apart**2).sum())
    if abs(apart[top]) < max(needed_z(apart.size), 5.0) or chi < needed(1, apart.size):
        return None
    vertical, horizontal = (0 if k == 0 else 2 if k == n - 1 else 1 for k, n in zip(top, apart.shape))
    place = _PLACES[vertical][horizontal]
    spread = deviation(float(blocks.var()), blocks.size - 1, variance)
    value, peak = spread["amplitude_dn"], float(blocks[top])
    shaded = look.is_lit and (peak < 0 or not look.guessed)
    what, short = ("shading", "shading") if shaded else ("glow", "a glow")
    return Finding(
        what,
        look.fixed,
        f"The level changes smoothly over the sensor: {place} lies {number(abs(peak))} DN {'above' if peak > 0 else 'below'} the "
        f"usual level; the standard deviation over the frame is {number(value)} DN.",
        f"{short} {'towards' if peak > 0 or shaded else 'away from'} {place}, {abs(peak):.2g} DN",
        chi,
        amplitude_dn=value,
        low=min(math.sqrt(max(value**2 - 4 * value * error, 0.0)), value),
        high=math.sqrt(value**2 + 4 * value * error),
        details={"peak_dn": peak, "where": place},
        shown={"blocks": blocks},
    )


def frame_drift(look: FrameGroup, rows: RowMeans, columns: RowMeans) -> Finding | None:
    """Means of frames that scatter more than pixels, rows and columns explain."""
    n = look.count
    if n < 2 or look.kind in ("scene", "image"):
        return None
    height, width = look.shape
    coarse = rows.look.colour[0] * columns.look.colour[0]
    variance = look.noise_variance / (height * width) * max(coarse, 1.0)
    means = look.data.frame_means - _sampled(rows) - _sampled(columns)
    means = means - means.mean()
    for lines, length in ((rows, height), (columns, width)):
        _, temporal = lines.continua()
        assert temporal is not None  # of two frames
        variance += float(temporal.beyond(0.5)) / length
    found = float((means**2).sum()) / (n - 1)
    gain = (n - 1) * found / variance
    if gain < needed(1, n - 1) or found < 4 * variance:
        return None
    size = deviation(found, n - 1, variance)
    value = size["amplitude_dn"]
    order = float(np.corrcoef(np.arange(n), np.argsort(np.argsort(means)))[0, 1]) if n >= 5 else 0.0
    how = "changes from frame to frame"
    if abs(order) > 0.9:
        how = f"{'rises' if order > 0 else 'falls'} from first to last"
    of = f" ({value / look.data.level:.2%} of it)" if look.is_lit else ""
    return Finding(
        "frame_drift",
        "per_frame",
        f"The level of the whole frame {how}, with a standard deviation of {number(value)} DN{of}.",
        f"a level that {how} by {value:.2g} DN",
        min(gain - (n - 1) * math.log(max(found / variance, 1.0)), gain),
        **size,
        details={"trend": order},
        shown={"drift": means},
    )


def _sampled(lines: RowMeans) -> np.ndarray:
    """(n,) mean over the frame that sines have which do not end with it, DN."""
    total = np.zeros(lines.count)
    for wave in lines.waves:
        angle = 2j * math.pi * wave.frequency * np.arange(lines.length) / lines.length
        total += (wave.amplitudes * np.exp(angle).mean()).real
    return total
