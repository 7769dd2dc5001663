"""Codes of the converter: bits in use, codes that never come, clipping."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import stats

from visaug.frames import FrameSet
from visaug.frames.raw import unused_low_bits
from visaug.inspection.finding import ALPHA, Finding, about, some
from visaug.inspection.material import FrameGroup
from visaug.statistics.views.codes import NEIGHBOURS, SIDE


@dataclass(frozen=True)
class CodeCounts:
    """How often each code comes in all frames."""

    counts: np.ndarray  # by code
    step: int  # difference of neighbouring codes in use, a power of 2 (1 where all come)
    bits: int  # of the converter, or the fewest usual ones that hold the largest code
    shift: int  # by how many bits the codes are moved up in the file; they are counted without
    stated: bool  # whether the files state the bits
    whole: bool  # whether the frames hold integers


def shift_of(frames: FrameSet) -> int:
    """By how many bits all values are moved up to the top of 16, where nobody states the bits."""
    if frames.told_bits is not None or frames.bit_depth not in (16, None):
        return 0
    low, highest = 16, 0
    for i in range(len(frames)):
        frame = frames.read(i)
        if frame.min() < 0 or frame.max() > 65535 or (frame != np.rint(frame)).any():
            return 0
        low, highest = min(low, unused_low_bits(frame.astype(np.uint16))), max(highest, int(frame.max()))
        if low < 2:
            return 0
    low = min(low, 8)
    # 8, 10, 12 or 14 bits at the top of 16; nobody loses four
    return low if highest and (low in (4, 6, 8) or (low == 2 and highest >= 1 << 14)) else 0


def codes_of(looks: list[FrameGroup], container: int, shift: int) -> CodeCounts:
    """The codes of all frames; `container`: bits of a value in the files, 16 where they hold floats."""
    whole = all(bool((look.frames[0] == np.rint(look.frames[0])).all()) for look in looks)
    highest = int(max(float(look.frames.max()) for look in looks))
    if not whole or highest > 1 << 20:
        return CodeCounts(np.zeros(0, np.int64), 1, container, shift, False, whole)
    counts = np.zeros(highest + 1, np.int64)
    for frame in (frame for look in looks for frame in look.frames):
        counts += np.bincount(frame.ravel().astype(np.intp), minlength=len(counts))
    used = np.flatnonzero(counts)
    finest = 6  # low bits that may be lost
    step = int(np.gcd.reduce(used, initial=1 << finest))
    told = looks[0].bits
    least = 16 - shift if shift else 10 if container == 16 else 8
    depths = (8, 10, 12, 14, 16)  # of usual converters
    bits = told or next(b for b in (*depths, 24) if b >= least and highest < 1 << b)
    return CodeCounts(counts, step, bits, shift, told is not None, whole)


def code_findings(codes: CodeCounts, looks: list[FrameGroup]) -> list[Finding]:
    """Lost low bits, missing codes, clipping at either end."""
    if not codes.whole or not codes.counts.any():
        return []
    found = _lost_bits(codes), _gaps(codes), _clipped(codes, looks, False), _clipped(codes, looks, True)
    return [f for f in found if f is not None]


def _lost_bits(codes: CodeCounts) -> Finding | None:
    used = np.flatnonzero(codes.counts)
    step = codes.step
    if step == 1 or len(used) < 3:
        return None
    bits, noise = int(math.log2(step)), step / math.sqrt(12)
    return Finding(
        "code_gaps",
        "fixed",
        f"Only every {step}th code comes: the lowest {bits} bits are always 0; a step of {step} DN adds noise of {noise:.2g} DN.",
        f"the lowest {bits} bits lost",
        2 * float(codes.counts.sum()) * math.log(step),
        **about(noise, 0.0),
        share=1 - 1 / step,
        details={"step_dn": step, "lost_bits": bits},
        shown={"counts": codes.counts},
    )


def _gaps(codes: CodeCounts) -> Finding | None:
    """Codes that do not come although those around do, as after a digital gain or from a faulty converter."""
    counts = codes.counts[:: codes.step].astype(np.float64)
    expected = np.convolve(counts, NEIGHBOURS)[SIDE:-SIDE]
    pairs = np.convolve(counts, [1, 1], "full")  # of neighbouring codes, by the upper one
    around = np.minimum(np.concatenate([[0], pairs[:-2]]), np.concatenate([pairs[2:], [0]]))
    enough = 50.0  # pixels of a code that its neighbours predict, from which its absence tells
    filled = (expected > enough) & (around > enough)
    never = np.flatnonzero(filled & (counts < 0.02 * expected))
    if not len(never):
        return None
    gaps = np.diff(never)
    missing = [int(c) * codes.step for c in never]
    return Finding(
        "code_gaps",
        "fixed",
        f"{len(never)} codes never come although their neighbours do: {some(missing, 5)}.",
        f"{len(never)} missing codes",
        2 * float(expected[never].sum()),
        share=len(never) / max(int(filled.sum()), 1),
        period=float(np.median(gaps)) if len(never) > 3 and np.ptp(gaps) <= 1 else None,
        details={"codes": missing[:1000]},
        shown={"counts": codes.counts},
    )


def _clipped(codes: CodeCounts, looks: list[FrameGroup], at_top: bool) -> Finding | None:
    """A pile at the lowest or the highest code, higher than the codes beside it lead to expect."""
    shares = [_pile(look, at_top, codes) for look in looks]
    share = max(shares, default=0.0)
    piled = 1e-3  # share of the pixels at an end of the range from which it is clipped
    if share < piled:
        return None
    look = looks[int(np.argmax(shares))]
    code = int(look.frames.max() if at_top else look.frames.min())
    end, spoils = "lowest", "the black level is too low; noise and offsets in the dark come out too small"
    if at_top:
        end, spoils = "highest", "saturated"
    return Finding(
        "clipping",
        "fixed",
        f"{share:.2%} of the pixels of the {look.kind} frames lie at the {end} code, {code}: {spoils}.",
        f"{share:.1%} of the pixels clipped at {code} DN",
        2 * share * look.frames.size,
        share=share,
        details={"code_dn": code, "end": end},
        shown={"counts": codes.counts},
    )


def _pile(look: FrameGroup, at_top: bool, codes: CodeCounts) -> float:
    """Share of the pixels at the end code, 0 where they are no pile."""
    sign = -1 if at_top else 1
    values = sign * look.frames
    end = float(values.min())
    here = np.count_nonzero(values == end)
    beside = max(np.count_nonzero(values == end + k * codes.step) for k in (1, 2))
    share = here / values.size
    limit = float((1 << codes.bits) - 1) if at_top else 0.0
    is_limit = abs(end) == limit
    if here == values.size:
        return share if is_limit else 0.0
    steep = 1.0 if is_limit else 3.0
    narrow = look.noise_dn < codes.step and not is_limit
    # One-sided sign test: are pixels at the last code more frequent than at the code beside it?
    by_chance = stats.binom.sf(here - 1, here + beside, 0.5) > ALPHA
    return share if here > steep * beside and not narrow and not by_chance else 0.0
