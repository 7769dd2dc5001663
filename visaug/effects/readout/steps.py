"""Steps in the profile of a measured frame."""

from itertools import pairwise

import numpy as np

MOST = 256  # lines of a profile; of a longer one means of neighbours are taken


def edges(profile: np.ndarray, count: int) -> tuple[list[int], np.ndarray]:
    """The staircase of one or two steps that fits a profile best, by least squares over all places.

    Args:
        profile: (n,), the means of lines, n > count. Every level takes a sixteenth of them (rounded down) or more.
        count: of steps, 1 or 2.

    Returns:
        The first line behind each step, and the level before, between and behind them: (count + 1,).
    """
    starts = np.unique(np.linspace(0, len(profile), MOST + 1).astype(int)[:-1])
    sums = np.concatenate([[0.0], np.cumsum(np.add.reduceat(profile.astype(np.float64), starts))])
    lines = np.append(starts, len(profile))
    # smallest width of a level, as a share of the profile: narrower features are single outlying lines
    narrowest = 1 / 16
    least = max(1, int(narrowest * len(starts)))
    inner = np.arange(least, len(starts) - least + 1)
    places = [inner] if count == 1 else [inner[i] for i in np.triu_indices(len(inner), least)]
    bounds = [np.zeros_like(places[0]), *places, np.full_like(places[0], len(starts))]
    parts = list(pairwise(bounds))
    explained = sum((sums[b] - sums[a]) ** 2 / (lines[b] - lines[a]) for a, b in parts)
    best = int(np.argmax(explained))
    levels = [(sums[b[best]] - sums[a[best]]) / (lines[b[best]] - lines[a[best]]) for a, b in parts]
    return [int(lines[place[best]]) for place in places], np.array(levels)
