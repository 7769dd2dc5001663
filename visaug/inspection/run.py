"""From frames to findings: each detector looks at the frames of one kind and level; what they share is put together."""

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet
from visaug.inspection.codes import code_findings, codes_of, shift_of
from visaug.inspection.field import frame_drift, glow
from visaug.inspection.finding import Finding, Inspection, Measurement
from visaug.inspection.kinds import kinds_of
from visaug.inspection.line_findings import line_findings
from visaug.inspection.lines import rows_of
from visaug.inspection.material import FrameGroup, load_pixels, looks
from visaug.inspection.pixels import line_defects, pixel_findings, pixel_pattern
from visaug.inspection.processing import compression, noise_law, processing_findings


def inspect(frames: FrameSet | str | Path | np.ndarray | Sequence[np.ndarray]) -> Inspection:
    """What pattern is in these frames; no camera file, exposure or calibrated light is needed.

    Args:
        frames: 2 to 200 frames of any kind: a frame set, the path of one, or an array (n, H, W) in DN. Fractions of 1 are
            taken as such of 65535 DN.

    Returns:
        Patterns beyond temporal noise and ordinary pixel non-uniformity, each with its size in DN, its 95 % interval, and
        whether it is fixed or new in every frame. The probability that frames without patterns give any is below 1 %.

    Raises:
        InputError: no frames, or frames that cannot be read.

    Examples:
        >>> import numpy as np, visaug
        >>> noise = np.random.default_rng(1).normal(100, 3, (4, 64, 96))
        >>> visaug.inspect(np.rint(noise + 4 * (np.arange(96) >= 48))).findings[0].what
        'halves'
    """
    frames = _as_set(frames)
    shift = shift_of(frames)
    kinds, told_by = kinds_of(frames, shift)
    groups, notes = looks(frames, kinds, guessed="level" in told_by, shift=shift)
    if not groups:
        expected = "frames of 16 x 16 pixels or more"
        raise InputError("no frame is large enough", file=frames.loaded_from, expected=expected)
    chosen = _chosen(groups)
    container = 16 if frames.told_bits and frames.told_bits > 8 else frames.bit_depth or 16
    codes = codes_of(chosen, container, shift)
    packed = compression(chosen, frames)
    parts = [_findings_of(replace(look, coloured=packed is not None)) for look in chosen]
    mosaic = next((r.bayer for r in frames.records if r.bayer), None)
    if mosaic:
        parts = [(look, [f for f in found if not _is_of_colours(look, f.what)]) for look, found in parts]
        notes = [*notes, _MOSAIC.format(mosaic)]
    found = [*_merged(parts), *code_findings(codes, [look for look, _ in parts])]
    found += [packed] if packed else []
    found.sort(key=lambda f: -f.evidence)
    return Inspection(
        frames,
        tuple(_said_once(found)),
        {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)},
        told_by,
        codes.bits,
        codes.stated,
        codes.shift,
        tuple(_measurement(look, mosaic is not None) for look in chosen if look.kind != "image"),
        tuple(_ambiguous(groups, packed, found)),
        tuple(_more(groups)),
        (*notes, *(w for w in frames.warnings if not w.startswith("exposure_unknown"))),
        _next(frames, kinds),
    )


_MOSAIC = (
    "the frames have a colour mosaic ({}): in lit frames odd and even lines and neighbouring pixels differ by the colours, and "
    "patterns of this kind are not looked for there"
)


def _is_of_colours(look: FrameGroup, what: str) -> bool:
    """Whether the colours of a mosaic make such a pattern in lit frames."""
    return look.kind not in ("dark", "bias") and what in ("parity", "pixel_pattern")


def _as_set(frames: FrameSet | str | Path | np.ndarray | Sequence[np.ndarray]) -> FrameSet:
    if isinstance(frames, str | Path):
        return load_pixels(frames)
    if isinstance(frames, FrameSet):
        return frames
    stack = frames if isinstance(frames, np.ndarray | list | tuple) else []
    if not len(stack) or any(np.ndim(frame) != 2 for frame in stack):
        expected = "a FrameSet, the path of one, or an array (n, H, W)"
        raise InputError("is no set of frames", field="frames", expected=expected)
    return FrameSet.from_arrays([FrameRecord(k, f"frame {k}", "image") for k in range(len(stack))], stack)


def _chosen(groups: list[FrameGroup]) -> list[FrameGroup]:
    """At most so many groups: of each kind that of the most frames, then by their number."""
    first = {look.kind: look for look in reversed(groups)}
    ordered = [*first.values(), *(look for look in groups if look is not first[look.kind])]
    most_looks = 6  # groups of frames inspected, spread over kinds and levels
    return sorted(ordered[:most_looks], key=groups.index)


def _findings_of(look: FrameGroup) -> tuple[FrameGroup, list[Finding]]:
    """What one group of frames shows; and the group without defective lines."""
    if look.kind == "image" or (look.count == 1 and not look.is_uniform):  # the scene hides everything else
        return look, []
    found: list[Finding] = processing_findings(look)
    look = replace(look, coloured=look.coloured or any(f.what in _COLOURED for f in found))
    if look.is_uniform:
        for axis in ("row", "column"):
            turned = look if axis == "row" else look.transposed()
            defect, bad = line_defects(turned, axis)
            if defect:
                found.append(defect)
                turned = turned.without_lines(bad)
                look = turned if axis == "row" else turned.transposed()
    rows, columns = rows_of(look, "row"), rows_of(look.transposed(), "column")
    found += [*line_findings(rows), *line_findings(columns), *pixel_findings(look)]
    found += [f for f in (glow(look, rows, columns), frame_drift(look, rows, columns)) if f]
    return look, _explained(found)


_COLOURED = ("correlated_noise", "denoising", "demosaicing")  # findings of noise that neighbours share


def _explained(found: list[Finding]) -> list[Finding]:
    """Without what another finding explains: 1/f noise along one axis is drift and sharing along the other."""
    flicker = [f for f in found if f.what == "flicker_noise"]
    if flicker:
        best = max(flicker, key=lambda f: f.evidence)
        size = best.amplitude_dn or 0.0

        def is_part(f: Finding) -> bool:
            small = (f.amplitude_dn or 0.0) < size and f.kind == "per_frame"
            # A pattern that changes and has a tenth of the evidence may be waves of the 1/f noise.
            faint = f.evidence < 0.1 * best.evidence and f.what.endswith(("_banding", "_offset"))
            of_flicker = faint or f.what in ("flicker_noise", "frame_drift", "correlated_noise")
            return f is not best and small and of_flicker

        found = [f for f in found if not is_part(f)]
    if any(f.what == "demosaicing" for f in found):
        found = [f for f in found if f.what not in (*_COLOURED[:2], "defect_correction")]
    return found


def _merged(parts: list[tuple[FrameGroup, list[Finding]]]) -> list[Finding]:
    """One finding of those that several groups of frames share, with what their levels of light tell."""
    levels = [float(look.data.level) for look, _ in parts if look.is_uniform]
    several = len(levels) > 1 and max(levels) > 1.2 * min(levels) + 5
    merged: list[Finding] = []
    left = [(look, f) for look, found in parts for f in found]
    while left:
        first = left[0][1]
        same = [(look, f) for look, f in left if _is_same(first, f)]
        left = [(look, f) for look, f in left if not _is_same(first, f)]
        best = max((f for _, f in same), key=lambda f: f.evidence)
        merged.append(_with_nature(best, same, parts) if several and best.kind == "fixed" else best)
    return merged


def _is_same(one: Finding, other: Finding) -> bool:
    names = ("at_row", "at_column", "end", "code_dn")
    alike = all(one.details.get(name) == other.details.get(name) for name in names)
    alike &= (one.what, one.kind, one.axis) == (other.what, other.kind, other.axis)
    if one.period is None or other.period is None:
        return alike
    same_period = 0.03  # relative, of one banding in two groups
    return alike and abs(math.log(one.period / other.period)) < same_period


def _with_nature(
    finding: Finding, same: list[tuple[FrameGroup, Finding]], parts: list[tuple[FrameGroup, list[Finding]]]
) -> Finding:
    """The same as an offset or a gain, by its size in the darkest and the brightest group."""
    of_lines = finding.what.endswith(("_offset", "_banding"))
    if not of_lines and finding.what not in ("halves", "step", "parity", "pixel_pattern"):
        return finding
    uniform = sorted((look for look, _ in parts if look.is_uniform), key=lambda look: look.data.level)
    size = {id(look): f.amplitude_dn or 0.0 for look, f in same}
    dim, bright = size.get(id(uniform[0]), 0.0), size.get(id(uniform[-1]))
    steeper = 1.5  # times as strong in light as in the dark, from which a pattern is a gain
    nature = "gain" if bright is not None and bright > steeper * dim else "offset"
    text = "it grows with the light: a gain" if nature == "gain" else "it is as large in the dark: an offset"
    return replace(finding, nature=nature, text=f"{finding.text[:-1]}; {text}.")


def _said_once(found: list[Finding]) -> list[Finding]:
    """Without what lossy compression makes: noise shared by neighbours, and patterns fainter than its rounding."""
    packed = next((f for f in found if f.what == "compression"), None)
    if packed is None:
        return found
    least = packed.amplitude_dn or 0.0
    left = (f for f in found if f.what not in (*_COLOURED, "defect_correction"))
    return [f for f in left if f is packed or f.amplitude_dn is None or f.amplitude_dn > least]


def _measurement(look: FrameGroup, coloured: bool) -> Measurement:
    noise = pattern = None
    law, excess = noise_law(look) or (None, None)
    if excess is not None:
        error = 1.96 * math.sqrt((2 + max(excess, 0)) / 4 / look.frames.size)
        value = look.noise_dn
        noise = {"value": value, "low": value * (1 - error), "high": value * (1 + error)}
        if not (coloured and _is_of_colours(look, "pixel_pattern")):
            size = pixel_pattern(look)
            pattern = {"value": size["amplitude_dn"], "low": size["low"], "high": size["high"]}
    level = float(look.data.level)
    return Measurement(look.kind, look.count + look.copies, level, noise, pattern, law, excess)


def _ambiguous(groups: list[FrameGroup], packed: Finding | None, found: list[Finding]) -> list[str]:
    said = []
    for look in groups:
        if look.copies and np.ptp(look.frames[0]) > 0:
            said.append(
                f"{look.copies} of {look.count + look.copies} {look.kind} frames are copies of others to the last bit: one "
                "exposure saved again cannot tell fixed from new"
            )
        elif look.count == 1 and look.kind != "image":
            said.append(f"of one {look.kind} frame fixed patterns and noise cannot be told apart")
    kinds = {look.kind for look in groups}
    if packed:
        hidden = f"here {packed.details['step_dn']:.0f} DN and more in a block of 8 x 8 pixels"
        said.append(f"JPEG hides patterns that are fainter than its steps, {hidden}")
    if "image" in kinds:
        looked_at = "only their codes and compression were looked at"
        said.append(f"pictures of changing scenes hide patterns of the camera; {looked_at}")
    if "scene" in kinds:
        said.append(
            "frames of one scene do not tell fixed patterns from the scene; only what changes was looked at"
        )
    if any(look.guessed for look in groups) and any(f.what in ("glow", "shading") for f in found):
        said.append(
            "nothing states that the frames are dark ones or flats: a dim, smooth scene that stays looks like a glow or shading"
        )
    return said


def _more(groups: list[FrameGroup]) -> list[str]:
    """Which frames would tell more."""
    kinds = {look.kind for look in groups}
    most = max(look.count for look in groups)
    said = []
    few = 8  # frames below which more tell more
    if most < few:
        said.append(
            f"{few} frames or more of the same exposure: unstable pixels, the phase of banding, drift"
        )
    if not kinds & {"dark", "bias"}:
        said.append("dark frames (lens capped): offsets, read noise and black level without the light's part")
    if "flat" not in kinds:
        said.append(
            "frames of uniform light at two levels: whether a pattern is an offset or a gain, and electrons per DN"
        )
    if kinds <= {"dark", "bias"}:
        said.append(
            "dark frames of a second, longer exposure: glow and hot pixels grow with it, offsets do not"
        )
    return said


def _is_read(path: Path) -> bool:
    """Whether the measuring commands read what lies there as it is."""
    try:
        FrameSet.load(path).shape(0)
    except InputError:
        return False
    return True


def _next(frames: FrameSet, kinds: list[str]) -> str:
    """The command that follows: of a camera that can be measured, its parameters; else the table of its frames."""
    path = frames.loaded_from
    folder = str(path) if path else "FRAMES"
    if (set(kinds) <= {"image", "scene"} or not frames.is_pictures) and (path is None or _is_read(path)):
        lit = set(kinds) - {"dark", "bias"}  # without light there is no gain, and no camera in electrons
        words = ("-o", "camera.yaml") if lit else ("--report", "characterization.html")
        return shlex.join(("visaug", "characterize", folder, *words))
    if path and Path(path).is_file():  # a table is of the files of a folder
        folder = str(Path(path).parent)
    return shlex.join(("visaug", "frames", folder, "-o", f"{folder.rstrip('/')}/frames.csv"))
