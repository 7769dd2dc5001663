"""Frames whose compression lost noise: JPEG, and FITS images of floats that were quantised."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from visaug.characterization.facts import Facts
from visaug.core.extras import extra
from visaug.frames import FrameSet
from visaug.statistics.findings import Findings

_JPEG = (".jpg", ".jpeg")
_COARSE = 0.35  # step over the noise of a pixel from which on rounding adds 1 % to its variance: step^2 / 12
_SPOILED = ("gain_e_per_dn", "quantum_efficiency", "read_noise.sigma_e", "read_noise.shape",
            "prnu.*", "dsnu.*", "dark_current.*", "full_well_e", "emva.*", "emva4.*", "temporal.*")  # fmt: skip


def check(frames: FrameSet, facts: Sequence[Facts], found: Findings) -> None:
    """Warns of JPEG files, and of compressed FITS files whose steps are coarse beside the noise."""
    if any(r.file.lower().endswith(_JPEG) for r in frames.records):
        found.warn(
            "lossy_frames: JPEG compression removes noise and rounds coarsely; measure raw or lossless frames",
            spoils=_SPOILED,
        )
    steps = [(_step(frames.path(i)), f.noise) for i, f in enumerate(facts)]
    coarse = [step / noise for step, noise in steps if step and noise and step > _COARSE * noise]
    if coarse:
        found.warn(
            f"lossy_frames: {len(coarse)} FITS files were compressed with values rounded to {max(coarse):.2g} "
            "of their noise; the "
            "rounding adds to the noise and grows with it (quantize_level 4 or more, or no quantisation, does no harm)",
            spoils=_SPOILED,
        )


def _step(path: Path | None) -> float | None:
    """Median step of the tiles of a compressed FITS image of floats (ZSCALE of the FITS standard 4.0, section 10.2), DN."""
    if path is None or not path.name.lower().endswith(".fz"):
        return None
    with extra(path):
        from astropy.io import fits

    with fits.open(path, disable_image_compression=True) as file:
        for part in (p for p in file if isinstance(p, fits.BinTableHDU)):
            columns = part.columns
            # pyrefly: ignore[missing-attribute]
            if part.header.get("ZIMAGE") and columns is not None and "ZSCALE" in (columns.names or ()):
                return float(np.median(np.abs(np.asarray(part.data["ZSCALE"], np.float64))))
    return None
