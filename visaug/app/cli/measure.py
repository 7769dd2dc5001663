"""Commands that measure: characterize, compare, diagnose, lab."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal

import click

import visaug
from visaug import report
from visaug.app.cli import options as cli
from visaug.app.cli import summaries
from visaug.core.errors import InputError, NoSensorNoise
from visaug.core.extras import check_installed, extra
from visaug.core.files import write_json
from visaug.core.progress import progress_bars
from visaug.report import next_step
from visaug.report.next_step import Inputs
from visaug.report.pages import possible_pictures

# what `characterize --maps` writes, and what --use-maps writes beside it
MAPS = ("master_bias.fits", "response.fits", "read_noise.fits", "dark_current.fits", "defects.fits")
CAMERA_MAPS = ("prnu.npy", "dsnu.npy", "read_noise.npy", "dark_current_nonuniformity.npy")
MISFIT = 3  # exit status of `compare --fail-on-misfit`; 1 and 2 are failures of the program and of its input


@cli.command("characterize", "visaug characterize frames/ -o camera.yaml --report characterization.html")
@cli.frames_argument
@cli.camera_option(required=False)
@cli.effects_option()
@cli.bit_depth_option
@cli.choice_option(
    "--method",
    ("emva", "paper"),
    "EMVA 1288 with likelihood fits, or the paper's procedure, which uses bias and dark frames only.",
)
@cli.output_option("camera.yaml", "Write the measured camera.")
@cli.path_option(
    "--maps maps_path",
    "DIR",
    "Write maps of every pixel as FITS: master bias, response, read noise, dark current, defects.",
)
@cli.flag(
    "--use-maps", "The camera of -o names the maps in --maps (.npy) in place of patterns drawn by chance."
)
@cli.path_option(
    "--sheet sheets",
    "F.html|F.json",
    "Write the EMVA 1288 release 4 data sheet for each operating point, as a page to print or as JSON. May be repeated.",
    multiple=True,
)
@cli.result_options
def characterize(
    frames_path: Path,
    camera_name: str | None,
    bit_depth: int | None,
    method: Literal["emva", "paper"],
    output: Path | None,
    maps_path: Path | None,
    use_maps: bool,
    sheets: tuple[Path, ...],
    force: bool,
    json_path: Path | None,
    report_path: Path | None,
    quiet: bool,
    seed: int,
) -> None:
    """Measure camera parameters from frames.

    All parameters have 95 % confidence intervals.

    With --camera, parameters that the frames do not determine (resolution of raw files, quantum efficiency
    without a calibrated source) are taken from that camera. All others are reported as not determined. A folder of
    ordinary pictures gives an effective camera: the noise of these pictures, each figure with its assumption.
    """
    cli.may_write(output, force)
    if use_maps and not (output and maps_path):
        expected = "-o and --maps beside it"
        raise InputError("there is no camera or no folder", field="--use-maps", expected=expected)
    for path in sheets:
        cli.may_replace(path, force)
        if path.suffix.lower() not in (".html", ".json"):
            raise InputError("is neither", file=path, field="--sheet", expected="a name in .html or .json")
    if maps_path:
        for file in (*MAPS, *(CAMERA_MAPS if use_maps else ())):
            cli.may_write(maps_path / file, force)
    camera = None if camera_name is None else cli.load_camera(camera_name)
    frames = cli.load_frames(frames_path, camera.resolution if camera else None, bit_depth, quiet)
    for option, given in (("--method", method == "paper"), ("--maps", maps_path), ("--sheet", sheets)):
        if given and frames.is_pictures:
            problem, expected = "FRAMES are ordinary pictures", "bias, dark or flat frames"
            raise InputError(problem, field=option, expected=expected)
    with progress_bars(quiet=quiet) as progress:
        progress("characterizing", 0, 1)
        result = visaug.characterize(frames, camera, seed=seed, method=method)
        progress("characterizing", 1, 1)
    silent = cli.is_silent(quiet, json_path)
    if not silent:
        noiseless = result.is_noiseless
        summaries.print_characterization(result.to_json(), str(output) if output and not noiseless else None)
    cli.write_result(json_path, result.to_json())
    no_camera: InputError | None = None
    if output and result.is_noiseless:
        click.echo("no sensor noise found: no camera is written", err=silent)
        output = None
    elif output:
        try:
            result.save_camera(output, maps_path if use_maps else None)
        except InputError as mistake:  # what was measured is written all the same
            no_camera, output = mistake, None
    if maps_path and not result.save_maps(maps_path):
        click.echo("no map is written: the frames determine none; two or more bias frames do", err=True)
        maps_path = None
    if report_path:
        report.write_characterization(report_path, result, frames, output, camera)
    if sheets:
        from visaug.characterization.points import operating_points

        with progress_bars(quiet=quiet) as progress:
            points = operating_points(frames, camera, seed, progress)
        for path in sheets:
            if path.suffix.lower() == ".json":
                write_json(path, report.sheet_json(points))
            else:
                report.write_sheet(path, points, frames)
    if not silent:
        cli.written(output, maps_path, json_path, report_path, *sheets)
        if no_camera is None and (not frames.is_pictures or "gain_e_per_dn" in result.parameters):
            inputs = replace(Inputs.of(camera, frames, output), transfer=result.transfer or "linear")
            known = frames.is_pictures, result.has_gain, camera is not None
            summaries.print_next(next_step.after_characterization(inputs, *known))
    if no_camera is not None:
        raise no_camera


transfer_option = cli.choice_option(
    "--transfer", ("linear", "srgb"), "Encoding of ordinary pictures: linear or sRGB."
)


@cli.command("compare", "visaug compare frames/ --camera camera.yaml --report comparison.html")
@cli.frames_argument
@cli.camera_option(required=False)
@cli.path_option(
    "--target",
    "PICTURES",
    "Pictures of the target domain: FRAMES are then pictures too, with the camera's noise where one is given.",
)
@transfer_option
@cli.effects_option()
@cli.bit_depth_option
@cli.result_options
@cli.flag("--fail-on-misfit", f"Exit with status {MISFIT} if the camera does not explain the frames.")
def compare(
    frames_path: Path,
    camera_name: str | None,
    target: Path | None,
    transfer: Literal["linear", "srgb"],
    bit_depth: int | None,
    force: bool,
    json_path: Path | None,
    report_path: Path | None,
    quiet: bool,
    fail_on_misfit: bool,
    seed: int,
) -> None:
    """Test whether a camera explains its frames.

    The statistics of the frames are compared with those of simulated frames. Deviations are listed by view.
    With --target, pictures are compared with pictures: what the camera of the target does that FRAMES lack.
    """
    if target is None and camera_name is None:
        raise InputError("is missing", field="--camera", expected="a camera, or --target PICTURES")
    if target is None and report_path:
        for file in possible_pictures(report_path):
            cli.may_replace(file, force)
    camera = None if camera_name is None else cli.load_camera(camera_name)
    silent = cli.is_silent(quiet, json_path)
    pictures: dict[str, Path] = {}
    if target is not None:
        from visaug.pictures.comparison import compare_pictures

        renders = visaug.FrameSet.load(frames_path, None, bit_depth)
        wanted = visaug.FrameSet.load(target, None, bit_depth)
        with progress_bars(quiet=quiet) as progress:
            result = compare_pictures(renders, wanted, camera, transfer, seed, progress)
        content = result.to_json()
        step = next_step.after_pictures(content, next_step.picture_inputs(result))
        if not silent:
            summaries.print_comparison(content)
        cli.write_result(json_path, content)
        if report_path:
            result.report(report_path)
    else:
        assert camera is not None
        frames = cli.load_frames(frames_path, camera.resolution, bit_depth, quiet)
        with progress_bars(quiet=quiet) as progress, _warning_of_renders(json_path, fail_on_misfit):
            result = visaug.compare(camera, frames, seed=seed, progress=progress, transfer=transfer)
        inputs = replace(Inputs.of(camera, frames), transfer=transfer)
        content = result.to_json()
        step = next_step.after_comparison(content, inputs)
        if not silent:
            summaries.print_comparison(content)
        if report_path:
            pictures = report.write_comparison(report_path, result, camera, frames, seed, inputs)
            content["pictures"] = {name: str(path) for name, path in pictures.items()}
        cli.write_result(json_path, content)
    if not silent:
        cli.written(json_path, report_path)
        if pictures:
            click.echo(f"wrote {len(pictures)} pictures to {next(iter(pictures.values())).parent}")
        summaries.print_next(step)
    if fail_on_misfit and not result.adequate:
        raise SystemExit(MISFIT)


@contextmanager
def _warning_of_renders(json_path: Path | None, fail_on_misfit: bool = False) -> Iterator[None]:
    """Where pictures have no sensor noise, writes the warning alone as JSON; no camera with noise explains such pictures."""
    try:
        yield
    except NoSensorNoise as none:
        cli.write_result(json_path, {"warnings": [f"no_sensor_noise: {none}"]})
        if not fail_on_misfit:
            raise
        click.echo(str(none), err=True)
        raise SystemExit(MISFIT) from None


@cli.command(
    "diagnose", "visaug diagnose frames/ --camera camera.yaml -o better.yaml --report diagnosis.html"
)
@cli.frames_argument
@cli.camera_option()
@cli.effects_option(
    "File with your own effects to try with those of the catalogue (see `visaug effects new`).", pass_on=True
)
@cli.bit_depth_option
@cli.option("--without", "NAME", "Do not try this effect of the catalogue. May be repeated.", multiple=True)
@cli.option(
    "--cluster",
    "ADDRESS",
    "Run the simulations on a Ray cluster: its address, `auto`, or `local` for this machine (extra `cluster`).",
)
@cli.path_option(
    "--scenes",
    "PICTURES",
    "Where FRAMES are ordinary pictures: others of such scenes, e.g. the training images. Vignetting needs them.",
)
@transfer_option
@cli.output_option("camera2.yaml", "Write the refitted camera with the missing effects.")
@cli.flag(
    "--unexplained with_component",
    "Measure what no effect explains (a fixed map, spectra of rows and columns, a variance curve) and write it beside "
    "the camera of -o, which names it as the effect `unexplained`.",
)
@cli.result_options
def diagnose(
    frames_path: Path,
    camera_name: str,
    effects: tuple[Path, ...],
    bit_depth: int | None,
    without: tuple[str, ...],
    cluster: str | None,
    scenes: Path | None,
    transfer: Literal["linear", "srgb"],
    output: Path | None,
    with_component: bool,
    force: bool,
    json_path: Path | None,
    report_path: Path | None,
    quiet: bool,
    seed: int,
) -> None:
    """Find the effects that a camera lacks.

    The camera is refitted with the missing effects. The error is given before and after. FRAMES may be a folder of ordinary
    pictures: effects that show in a black sky and in flat regions are then found, and those that pictures cannot show are named.
    """
    from visaug.app.cli.effect_pages import find
    from visaug.diagnosis.empirical import file_beside

    cli.may_write(output, force)
    if with_component:
        if output is None:
            raise InputError("there is no camera", field="--unexplained", expected="-o beside it")
        cli.may_write(file_beside(output), force)
    for name in without:
        find(name, "--without")
    camera = cli.load_camera(camera_name)
    frames = cli.load_frames(frames_path, camera.resolution, bit_depth, quiet)
    if scenes and not frames.is_pictures:
        raise InputError("FRAMES are no ordinary pictures", field="--scenes", expected="no --scenes")
    with progress_bars(single=True, quiet=quiet) as progress, _warning_of_renders(json_path):
        how = {"seed": seed, "progress": progress, "cluster": cluster, "transfer": transfer, "scenes": scenes}
        result = visaug.diagnose(camera, frames, effects=list(effects), without=list(without), **how)
        result = result.with_component(progress) if with_component else result
    part = result.component
    if output and part is not None and part.helps:
        part = part.saved(output)
        result = replace(result, component=part)
    elif output:
        result.camera.save(output)
    if not cli.is_silent(quiet, json_path):
        summaries.print_diagnosis(result.to_json())
        if with_component and result.unexplained is None:
            click.echo("Nothing is left unexplained: no component is written.")
    chosen = [word for name in without for word in ("--without", name)]
    chosen += [*(("--seed", str(seed)) if seed else ()), *(("--scenes", str(scenes)) if scenes else ())]
    inputs = replace(Inputs.of(camera, frames, output), transfer=transfer, options=tuple(chosen))
    cli.write_result(json_path, result.to_json())
    if report_path:
        report.write_diagnosis(report_path, result, camera, result.frame_set or frames, seed, inputs)
    if not cli.is_silent(quiet, json_path):
        cli.written(output, part.file if part else None, json_path, report_path)
        summaries.print_next(next_step.after_diagnosis(result.to_json(), inputs))


@cli.command("lab", "visaug lab frames/ --camera camera.yaml")
@cli.frames_argument
@cli.camera_option()
@cli.effects_option("File with your own effects; the page can load more.", pass_on=True)
@cli.bit_depth_option
@cli.output_option("camera2.yaml", "File that the page's Save camera writes, in addition to the download.")
@cli.force_option
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, show_default="a free one", help="Port on 127.0.0.1."
)
@click.option("--open/--no-browser", "browser", default=False, help="Open the page in a browser.")
def lab(
    frames_path: Path,
    camera_name: str,
    effects: tuple[Path, ...],
    bit_depth: int | None,
    output: Path | None,
    force: bool,
    port: int,
    browser: bool,
    seed: int,
) -> None:
    """Compare and diagnose interactively.

    Effects can be added and removed to see how the error changes.

    Prints the address of a page that is served on this machine only, until Ctrl-C. Anyone who has the address
    can use the page and load effects, whose Python code is then executed.
    """
    with extra():
        from visaug.app.lab import Bench, load_own, serve
    check_installed("matplotlib", "jinja2")
    cli.may_write(output, force)
    own = [name for file in effects for name in load_own(file)]  # first: the camera may name one of them
    camera = cli.load_camera(camera_name)
    frames = cli.load_frames(frames_path, camera.resolution, bit_depth)
    bench = Bench(camera, frames, own, seed=seed, output=output, force=force)
    try:
        serve(bench, port, say=click.echo, ready=click.launch if browser else None)
    except KeyboardInterrupt:
        click.echo("the lab is closed")
