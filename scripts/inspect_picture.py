"""Makes docs/pictures/inspect.png: what `visaug inspect` shows of eight simulated dark frames with banding and column offsets.

Usage: python scripts/inspect_picture.py
"""

from pathlib import Path

import numpy as np

import visaug
from visaug.report.plots.inspected import plot_finding

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "inspect.png"
SHAPE, COUNT = (120, 160), 8


def frames() -> np.ndarray:
    """12-bit dark frames: noise of 3 DN, banding of 13 rows and 2.5 DN with a new phase in each, fixed column offsets of 1.5 DN."""
    rng = np.random.default_rng(3)
    phase = rng.uniform(0, 1, (COUNT, 1, 1))
    banding = 2.5 * np.sin(2 * np.pi * (np.arange(SHAPE[0])[:, None] / 13 + phase))
    columns = rng.normal(0, 1.5, SHAPE[1])
    return np.rint(100 + rng.normal(0, 3, (COUNT, *SHAPE)) + banding + columns).astype(np.uint16)


if __name__ == "__main__":
    result = visaug.inspect(frames())
    print(result.answer)
    figure = plot_finding(result.findings[0])
    assert figure is not None
    figure.savefig(PICTURE, dpi=120)
