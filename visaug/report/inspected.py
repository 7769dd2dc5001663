"""The page of `inspect`: the answer, one picture for each finding, what would tell more."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from visaug.core.wording import counted, number, with_interval
from visaug.report.html import Block, Page, Section, Table, Text, figure, footer, next_text, write_page
from visaug.report.next_step import NextStep
from visaug.report.plots.inspected import plot_finding

if TYPE_CHECKING:
    from visaug.inspection import Finding, Inspection

FINDING_HEAD = ["finding", "kind", "size [95 % interval]", "period"]
_KINDS = {"fixed": "fixed", "per_frame": "new in each frame", None: "–"}


def write_inspection(path: str | Path, result: "Inspection") -> Path:
    """What patterns the frames have, what they cannot tell, and the command that follows."""
    answer = Text(f"{result.answer[:1].upper()}{result.answer[1:]}.", "finding")
    blocks: list[Block] = [answer, Text(" ".join(measured_texts(result)))]
    if rows := [finding_row(f) for f in result.findings]:
        blocks.append(Table(FINDING_HEAD, rows, caption="In the order of their evidence."))
    blocks.append(next_text(next_step(result)))
    sections = [Section("Answer", blocks)]
    sections += [_pictured(finding) for finding in result.findings]
    told = [
        *(Text(f"These frames cannot tell: {line}.") for line in result.ambiguous),
        *(Text(f"More would be told by {line}.") for line in result.more),
        *([Text("Which frames to take, and what each tells:", command="visaug plan")] if result.more else []),
        *(Text(note, "note") for note in result.notes),
    ]
    sections.append(Section("What would tell more", told))
    counts = ", ".join(counted(n, f"{kind} frame") for kind, n in result.kinds.items())
    page = Page(
        "Inspection",
        f"{counts}; kinds by {result.kinds_from}. Sizes are standard deviations in DN, of a sine its peak.",
        [section for section in sections if section.blocks],
        facts=[(with_size(f), f.what.replace("_", " ")) for f in result.findings[:4]],
        footer=footer(None, result.frames),
    )
    return write_page(path, page)


def next_step(result: "Inspection") -> NextStep:
    aim = "write the table of the frames, which the measuring commands need"
    if " characterize " in result.next_command:
        aim = "measure the camera's parameters"
    return NextStep(f"Next: {aim}.", result.next_command)


def finding_row(finding: "Finding") -> Sequence[str]:
    """Name, kind, size and period of a finding as text."""
    period = "" if finding.period is None else f"{finding.period:.4g}"
    return [_name(finding), _KINDS[finding.kind], with_size(finding), period]


def with_size(finding: "Finding") -> str:
    """Amplitude with its interval, or the share where there is no amplitude."""
    if finding.amplitude_dn is None:
        return "" if finding.share is None else f"{finding.share:.2%}"
    return with_interval(finding.amplitude_dn, finding.low, finding.high, "DN")


def measured_texts(result: "Inspection") -> list[str]:
    """What was measured of each group of frames, one sentence each; first of all the bits."""
    stated = "" if result.bits_stated else "at least "
    moved = f", moved up by {counted(result.shift, 'bit')} in the files" if result.shift else ""
    count = counted(len(result.frames), "frame")
    lines = [f"{count}, kinds by {result.kinds_from}; {stated}{counted(result.bits, 'bit')}{moved}."]
    for m in result.measured:
        noise = pattern = ""
        if m.temporal_noise_dn and m.pixel_pattern_dn:
            t, p = m.temporal_noise_dn, m.pixel_pattern_dn
            noise = f", temporal noise {with_interval(t['value'], t['low'], t['high'], 'DN')} ({m.law})"
            pattern = f", pixel pattern {with_interval(p['value'], p['low'], p['high'], 'DN')}"
        level = f"level {number(m.level_dn)} DN"
        lines.append(f"{counted(m.frames, f'{m.kind} frame')}: {level}{noise}{pattern}.")
    return lines


def _pictured(finding: "Finding") -> Section:
    blocks: list[Block] = [Text(finding.text)]
    if drawn := plot_finding(finding):
        raster = any(axes.images for axes in drawn.axes)
        blocks = [figure(drawn, finding.text, wide=drawn.get_figwidth() > 6, raster=raster)]
    if finding.places:
        rows = [
            [*("" if n < 0 else str(n) for n in place), kind, number(height)]
            for *place, kind, height in finding.places[:12]
        ]
        more = f"; {len(finding.places) - 12} more: --defects F.csv" if len(finding.places) > 12 else ""
        blocks.append(Table(["row", "column", "type", "height / DN"], rows, caption=f"Places{more}."))
    return Section(f"{_name(finding).capitalize()}, {with_size(finding)}", blocks)


def _name(finding: "Finding") -> str:
    name = finding.what.replace("_", " ")
    return f"{name} ({finding.axis}s)" if finding.axis and finding.axis not in finding.what else name
