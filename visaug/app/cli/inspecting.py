"""The command that looks at a handful of frames: inspect."""

from pathlib import Path

import click

from visaug.app.cli import options as cli
from visaug.app.cli.summaries import print_next
from visaug.core.progress import progress_bars
from visaug.report.inspected import FINDING_HEAD, finding_row, measured_texts, next_step


@cli.command("inspect", "visaug inspect dark/ --report inspection.html --defects defects.csv")
@cli.frames_argument
@cli.bit_depth_option
@cli.path_option(
    "--defects defects_path",
    "F.csv",
    "Write the places of hot, dead and unstable pixels and of defective lines.",
    callback=cli.check_result,
)
@cli.result_options
def inspect(
    frames_path: Path,
    bit_depth: int | None,
    defects_path: Path | None,
    force: bool,  # read by the options
    json_path: Path | None,
    report_path: Path | None,
    quiet: bool,
    seed: int,
) -> None:
    """Find the patterns in a handful of frames.

    2 to 200 frames of any kind; no camera file, exposure or calibrated light is needed. Each pattern is given in DN with a
    95 % interval, and as fixed or new in each frame. The first line is the answer in one sentence.

    Kinds are taken from a table or headers, else from names (dark_000.png, bias, flat), else from level and structure.
    """
    import visaug
    from visaug.inspection.material import load_pixels

    frames = load_pixels(frames_path, bit_depth)
    silent = cli.is_silent(quiet, json_path)
    with progress_bars(quiet=silent) as progress:
        progress("inspecting", 0, 1)
        result = visaug.inspect(frames)
        progress("inspecting", 1, 1)
    if not silent:
        click.echo("\n".join([result.answer, *measured_texts(result)]))
        if result.findings:
            cli.print_table(FINDING_HEAD, map(finding_row, result.findings))
            for finding in result.findings:
                click.echo(f"- {finding.text}")
        titles = "cannot tell", "would tell more (see visaug plan)", "note"
        for title, lines in zip(titles, (result.ambiguous, result.more, result.notes), strict=True):
            for line in lines:
                click.echo(f"{title}: {line}")
    cli.write_result(json_path, result.to_json())
    if report_path:
        result.report(report_path)
    if defects_path:
        result.save_defects(defects_path)
    if not silent:
        cli.written(json_path, report_path, defects_path)
        print_next(next_step(result))


COMMANDS: list[click.Command] = [inspect]
