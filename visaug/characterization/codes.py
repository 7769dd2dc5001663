"""Codes that the converter never gives: gaps between codes, and rows or columns that lack their lowest bits."""

import numpy as np

from visaug.characterization.additivity import FROM_GAIN
from visaug.characterization.defective import Extremes
from visaug.statistics.findings import Findings

NEEDS_WHOLE_STEPS = "frames whose steps are 1 DN: as the converter gave them, neither scaled nor multiplied"


def check(seen: Extremes, found: Findings) -> None:
    """Sets `found.step_dn` where codes have gaps; warns of it, and of lines with fewer bits than the others."""
    steps = [step for v in seen.levels if v.codes is not None and (step := _step(v.codes)) is not None]
    if steps:
        found.step_dn = float(np.median(steps))
        companded = max(steps) > 1.5 * min(steps)  # such steps are not of one scale
        found.warn(
            f"code_gaps: the values step by {min(steps):.4g} to {max(steps):.4g} DN, by more where it is brighter (a square root, "
            "a gamma or a table of fewer codes): rounding grows with the signal as noise of light does"
            if companded
            else f"code_gaps: the values step by {found.step_dn:.4g} DN in place of 1 (a digital gain, or values scaled to more "
            "bits); rounding counts as that of this step",
            spoils=FROM_GAIN if companded else ("read_noise.shape",),
        )
    _lines(seen, found)


def _step(counts: np.ndarray) -> float | None:
    """Mean step of the codes of one level, DN; None where none are left out.
    Runs of empty codes between two codes that many pixels have are all of one length but for rounding.
    """
    # pixels at the codes on either side: an empty one between them has a probability of exp(-20)
    certain = 20
    filled = np.flatnonzero(counts >= certain)
    used = np.flatnonzero(counts)
    between = np.searchsorted(used, filled[1:]) - np.searchsorted(used, filled[:-1]) - 1
    clean = np.diff(filled)[between == 0]
    fewest = 4  # gaps: the peaks of a mosaic, or two levels, leave fewer
    # Gaps of one stretched scale differ by a DN of rounding, those of a square root by a fifth within a level, growing with the
    # signal. The widest that is looked for: 8 bits in a word of 16 stretch to 257.
    if (clean > 1).sum() < fewest or np.ptp(clean) > max(1, 0.2 * clean.mean()) or clean.max() > 300:
        return None
    return float(clean.mean())


def _lines(seen: Extremes, found: Findings) -> None:
    for name, bits in (("row", seen.row_bits), ("column", seen.column_bits)):
        if bits is None:
            continue
        moving = bits[bits != 0]  # the others are stuck
        lowest = np.log2(np.maximum(moving & -moving, 1)).astype(int)
        least = int(lowest.min()) if lowest.size else 0
        short = lowest > least
        if short.any():
            found.warn(
                f"bits_missing: in {short.sum()} of {len(bits)} {name}s the lowest "
                f"{lowest[short].max() - least} bits never change (a fault of packing or unpacking)",
                spoils=("gain_e_per_dn", "quantum_efficiency", "read_noise.*", "dsnu.*", "prnu.*", "dark_current.*",
                        "black_level_dn", "temporal.*", "full_well_e", "emva.*", "emva4.*", "emva4_corrected.*"),
            )  # fmt: skip
