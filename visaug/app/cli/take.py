"""Commands on frames, simulate, plan, frames, inspect; and the catalogue of effects."""

from pathlib import Path
from typing import Any

import click

from visaug.app.cli import options as cli
from visaug.app.cli import summaries
from visaug.core.errors import InputError
from visaug.core.files import whole_file, write_text
from visaug.core.progress import progress_bars
from visaug.report.inspected import FINDING_HEAD, finding_row, measured_texts, next_step


@cli.command(
    "simulate", "visaug plan -o frames.csv\nvisaug simulate frames.csv --camera sony_imx174 -o frames/"
)
@click.argument("plan_path", metavar="PLAN", type=cli.PATH)
@cli.camera_option()
@cli.effects_option()
@cli.output_option("DIR", "Folder for the frames, frames.csv and camera.yaml.", required=True)
@cli.force_option
def simulate(plan_path: Path, camera_name: str, output: Path, force: bool, seed: int) -> None:
    """Simulate a frame set with a camera.

    PLAN is a frames.csv, whose column `file` names the files to write, or an existing frame set. A scene without
    `clean` shows a test chart with edges and a bright spot, which is written to the same folder.
    """
    from visaug.camera.simulation import simulate, with_chart
    from visaug.frames import FrameSet
    from visaug.frames.writers import check_output, places

    if output.is_dir() and any(output.iterdir()) and not force:
        raise InputError("already exists", file=output, expected="another name, or --force to overwrite it")
    check_output(output)
    camera = cli.load_camera(camera_name)
    plan = with_chart(camera, FrameSet.load(plan_path, resolution=camera.resolution))
    places(plan.records)
    with progress_bars() as progress:
        frames = simulate(camera, plan, seed=seed, progress=progress)
        frames.save(output, keep_names=True, overwrite=force, beside=lambda f: camera.save(f / "camera.yaml"))
    click.echo(f"wrote {len(frames)} frames to {output}")


@cli.command(
    "plan",
    "visaug plan --camera sony_imx174 --temperatures 20 --gains-db 0 -o frames.csv\n"
    "visaug plan --exposure 0.02 --dark-exposures 0.1,1,10 --levels 0.1,0.3,0.6,1.1 -o frames.csv",
)
@cli.camera_option(required=False)
@cli.effects_option()
@cli.option(
    "--saturation saturation_photons",
    "PHOTONS",
    "Photons per pixel at saturation, at the exposure of the flats.",
    type=float,
)
@cli.option("--exposure exposure_s", "S", "Exposure time of flats and scenes, in seconds.", type=float)
@cli.option("--dark-exposures dark_exposures_s", "S,S,...", "Exposure times of the dark series, in seconds.")
@click.option("--levels", metavar="X,X,...", help="Levels of the flats, as fractions of saturation.")
@cli.option(
    "--temperatures temperatures_c",
    "C,C,... | none",
    "Temperatures of the dark series, in degrees Celsius; all other frames use the first. `none` if not known.",
)
@click.option("--gains-db", metavar="DB,DB,...", help="Gain settings, in dB; all other frames use the first.")
@click.option("--repeats", type=int, metavar="N", help="Frames per setting, 2 or more.")
@click.option("--bias-frames", type=int, metavar="N", help="Bias frames, 2 or more.")
@cli.option(
    "--for wanted",
    "EFFECT,...",
    "With --camera: what the frames would show of these effects, and what looks alike.",
)
@cli.output_option("frames.csv", "Write the plan as a frames.csv.")
@cli.force_option
def plan(
    camera_name: str | None, wanted: str | None, output: Path | None, force: bool, seed: int, **given: Any
) -> None:
    """List the frames to take of a camera, and why.

    With --camera, light levels, exposure times, temperature and gain are chosen for that camera. Other options
    override them.
    """
    from visaug.frames.plan import describe_plan, plan_groups
    from visaug.frames.table import write_table

    cli.may_write(output, force)
    if wanted is not None:
        if not camera_name:
            raise InputError("needs a camera", field="--for", expected="--camera CAMERA")
        names = list(dict.fromkeys(name.strip() for name in wanted.split(",") if name.strip()))
        if not names:
            raise InputError("names no effect", field="--for", expected="for example row_noise,smear")
        with progress_bars(single=True) as progress:
            from visaug.diagnosis.planned import before_frames
            from visaug.report.headline import planned_text

            found = before_frames(cli.load_camera(camera_name), names, progress)
        for verdict in found:
            click.echo(planned_text(verdict.to_json()))
        if output is None:
            return
    options: dict[str, Any] = {}
    if camera_name is not None:
        from visaug.camera.simulation import plan_for

        options = plan_for(cli.load_camera(camera_name))
    for option in ("dark_exposures_s", "levels", "temperatures_c", "gains_db"):  # lists
        if (text := given[option]) is not None:
            name = "--" + option.removesuffix("_s").removesuffix("_c").replace("_", "-")
            unknown = text == "none" and option == "temperatures_c"
            given[option] = (None,) if unknown else cli.numbers(text, name)
    options.update({name: value for name, value in given.items() if value is not None})
    groups = plan_groups(**options)
    click.echo(describe_plan(groups))
    if output:
        with whole_file(output) as temporary:
            write_table(temporary, [record for group in groups for record in group.records])
    cli.written(output)


@cli.command("frames", "visaug frames measured/ -o measured/frames.csv --bit-depth 12 --temperature 20")
@click.argument("folder", metavar="FOLDER", type=cli.PATH)
@cli.bit_depth_option
@cli.option(
    "--exposure exposure_s", "S", "Exposure time of files that do not state it, in seconds.", type=float
)
@cli.option(
    "--temperature temperature_c", "C", "Temperature of files that do not state it, in C.", type=float
)
@cli.option("--gain-db gain_db", "DB", "Gain of files that do not state it, in dB.", type=float)
@click.option("--resolution", metavar="ROWSxCOLUMNS", help="Resolution of .raw files.")
@cli.output_option("frames.csv", "Write the table; the column `file` is relative to its folder.")
@cli.force_option
def frames(
    folder: Path, resolution: str | None, output: Path | None, force: bool, seed: int, **given: float | None
) -> None:
    """Write the frames.csv of a folder.

    Conditions come from headers (FITS, TIFF, EXIF), subfolders and file names.

    Names such as bias_000.tif, darks/dark_2s_20C_003.fits and flat_10ms_500ph.png are understood. Unknown values
    stay blank and are listed with the way to supply them.
    """
    from visaug.frames.survey import parse_resolution, survey

    cli.may_write(output, force)
    with progress_bars() as progress:
        found = survey(folder, given, parse_resolution(resolution), progress=progress)
    summaries.print_survey(found)
    if output:
        write_text(output, found.text(output.parent))
    cli.written(output)


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
        summaries.print_next(next_step(result))


@cli.command(
    "effects",
    "visaug effects row_noise\nvisaug effects --search banding\n"
    "visaug effects new my_effect\nvisaug effects check my_effect.py",
)
@click.argument("words", metavar="[NAME | new NAME | check FILE.py]", nargs=-1)
@cli.option(
    "--search", "WORDS", "List the effects that are called or described so: banding, EMI, ghosting, PRNU."
)
@cli.output_option("FILE.py", "File that `new` writes.  [default: NAME.py]")
@cli.effects_option("File with your own effects to include.")
def effects(words: tuple[str, ...], search: str | None, output: Path | None, seed: int) -> None:
    """List or describe effects, write a template, or check a file of your own.

    Without arguments all effects are listed, grouped by where they act; with --search those that match. NAME describes one;
    `new` writes a file with a working effect to edit; `check` asks every effect in a file the laws that those of the package
    keep.
    """
    from visaug.app.cli import effect_pages

    if output is not None and words[:1] != ("new",):
        raise InputError("goes with `new`", field="--output", expected="visaug effects new NAME -o FILE.py")
    match words:
        case ():
            effect_pages.print_catalogue(search or "")
        case _ if search:
            expected = "visaug effects --search WORDS"
            raise InputError("goes without a NAME", field="--search", expected=expected)
        case ("new", name):
            cli.written(effect_pages.write_new(name, output))
        case ("check", file):
            effect_pages.check_file(Path(file))
        case (name,) if name not in ("new", "check"):
            effect_pages.print_effect(name)
        case _:
            said = "nothing, a NAME, new NAME, or check FILE.py"
            raise InputError(" ".join(words), field="visaug effects", expected=said)
