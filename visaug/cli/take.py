"""Commands that make images or tell what can be made: augment, simulate, plan, cameras, effects."""

from pathlib import Path

import click

from visaug.cli.options import camera_option, command, load_camera, output_option, written
from visaug.cli.tables import print_table
from visaug.progress import progress_bars


@command("augment", example="visaug augment photos/ portrait.tif -o noisy/ --camera sony_imx174 --seed 1")
@click.argument("inputs", metavar="IN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@output_option("OUT", "Folder for the copies.", required=True)
@camera_option()
@click.option(
    "--transfer",
    type=click.Choice(["linear", "srgb"]),
    default="linear",
    show_default=True,
    help="Whether pixel values are linear in light, or sRGB that is made linear first.",
)
@click.option(
    "--fixed-pattern",
    type=click.Choice(["image", "camera"]),
    default="image",
    show_default=True,
    help="Fixed patterns drawn anew for each image, or kept as one camera's.",
)
@click.option(
    "--black-level",
    type=click.Choice(["subtract", "keep"]),
    default="subtract",
    show_default=True,
    help="Whether the camera's offset is taken off again.",
)
def augment(
    inputs: tuple[Path, ...],
    output: Path,
    camera_name: str,
    transfer: str,
    fixed_pattern: str,
    black_level: str,
    seed: int,
) -> None:
    """Noisy copies of pictures or folders.

    PNG, TIFF and JPEG of 8 or 16 bit; names, sizes, depth and channels stay. Stopped half-way, the same
    command goes on where it was.
    """
    from visaug.augment.files import augment_files

    camera = load_camera(camera_name)
    with progress_bars() as progress:
        done = augment_files(
            inputs,
            output,
            camera,
            seed=seed,
            progress=progress,
            transfer=transfer,
            fixed_pattern=fixed_pattern,
            black_level=black_level,
        )
    click.echo(
        f"wrote {done.written} pictures to {output}" + (f", {done.kept} were there" if done.kept else "")
    )


@command(
    "simulate",
    example="visaug plan -o frames.csv\nvisaug simulate frames.csv --camera sony_imx174 -o frames/",
)
@click.argument("plan_path", metavar="PLAN", type=click.Path(path_type=Path))
@camera_option()
@output_option("DIR", "Folder for the frames, frames.csv and camera.yaml.", required=True)
def simulate(plan_path: Path, camera_name: str, output: Path, seed: int) -> None:
    """A frame set as a camera would take it.

    PLAN is a frames.csv, whose `file` names what to write, or a frame set to take again. A scene whose
    `clean` is blank shows a chart of edges and a bright spot, which is written beside the frames.
    """
    from visaug.frames import FrameSet
    from visaug.simulation import simulate, with_chart

    camera = load_camera(camera_name)
    plan = with_chart(camera, FrameSet.load(plan_path, resolution=camera.resolution))
    with progress_bars() as progress:
        frames = simulate(camera, plan, seed=seed, progress=progress)
        frames.save(output, keep_names=True)
    camera.save(output / "camera.yaml")
    click.echo(f"wrote {len(frames)} frames to {output}")


@command("plan", example="visaug plan -o frames.csv")
@output_option("frames.csv", "Write the plan as a frames.csv.")
def plan(output: Path | None, seed: int) -> None:
    """Which frames to take of a camera, and why."""
    from visaug.frames.plan import default_plan, describe_plan
    from visaug.frames.table import write_table

    click.echo(describe_plan())
    if output:
        from visaug.files import whole_file

        with whole_file(output) as temporary:
            write_table(temporary, default_plan())
    written(output)


@command("cameras", example="visaug cameras")
def cameras(seed: int) -> None:
    """The cameras that come with visaug."""
    from visaug.camera import Camera, shipped

    rows = []
    for name in shipped():
        spec = Camera.load(name).spec
        size = "{} x {}".format(*spec.resolution)
        gain, noise = f"{spec.gain_e_per_dn:.3g}", f"{spec.read_noise.sigma_e:.3g}"
        rows.append([name, spec.name, size, str(spec.bit_depth), gain, noise])
    print_table(["name", "camera", "rows x columns", "bit", "e-/DN", "read noise e-"], rows)


@command("effects", example="visaug effects row_noise\nvisaug effects new my_effect")
@click.argument("words", metavar="[NAME | new NAME]", nargs=-1)
@output_option("FILE.py", "Where `new` writes; NAME.py if left out.")
@click.option(
    "--effects",
    "files",
    metavar="my.py",
    multiple=True,
    type=click.Path(path_type=Path),
    help="List these too.",
)
def effects(words: tuple[str, ...], output: Path | None, files: tuple[Path, ...], seed: int) -> None:
    """The catalogue of effects; one in full; or a new file to write one's own in.

    The file that `new` writes runs as it is.
    """
    from visaug.cli import effect_pages
    from visaug.effects.catalogue import load_file
    from visaug.errors import InputError

    for file in files:
        load_file(file)
    match words:
        case ():
            effect_pages.print_catalogue()
        case ("new", name):
            written(effect_pages.write_new(name, output))
        case (name,) if name != "new":
            effect_pages.print_effect(name)
        case _:
            raise InputError(
                " ".join(words), field="visaug effects", expected="nothing, a NAME, or: new NAME"
            )


COMMANDS: list[click.Command] = [augment, simulate, plan, cameras, effects]
