"""The command `cameras`: those of the package and the user's own; add one, export one."""

from pathlib import Path

import click

from visaug.app.cli import options as cli
from visaug.core.errors import InputError


@cli.command(
    "cameras",
    "visaug cameras\nvisaug cameras sony_imx174 > my_camera.yaml\nvisaug cameras add my_camera.yaml\n"
    "visaug cameras export my_camera",
)
@click.argument("words", metavar="[NAME | add FILE | export NAME]", nargs=-1)
@cli.output_option("DIR", "Folder that `export` writes.  [default: NAME-camera]")
@cli.effects_option()
@cli.force_option
def cameras(words: tuple[str, ...], output: Path | None, force: bool, seed: int) -> None:
    """List the cameras, or print, add or export one.

    With NAME, the camera.yaml of that camera is printed. `add` keeps a file in $XDG_DATA_HOME/visaug/cameras
    (~/.local/share/visaug/cameras), from where every command knows it by name. Every figure of it must have a `source` or
    be listed under `assumed`. `export` writes a folder with the file and a page of its figures and sources, which is what
    a maintainer needs to take it into the package.
    """
    from visaug.camera import camera_file
    from visaug.camera.sharing import add_camera, export_camera

    if output is not None and words[:1] != ("export",):
        raise InputError("goes with `export`", field="--output", expected="visaug cameras export NAME -o DIR")
    match words:
        case ():
            _list()
        case ("add", file):
            path = add_camera(file, force)
            cli.written(path)
            click.echo(f"use it as --camera {path.stem}")
        case ("export", name):
            cli.written(export_camera(name, output))
        case (name,) if name not in ("add", "export"):
            cli.load_camera(name)
            click.echo(camera_file(name).read_text(encoding="utf-8"), nl=False)
        case _:
            expected = "nothing, a NAME, add FILE, or export NAME"
            raise InputError(" ".join(words), field="visaug cameras", expected=expected)


def _list() -> None:
    from visaug.camera import Camera, shipped
    from visaug.camera.camera import own_cameras

    rows, broken = [], []
    for place, names in (("package", shipped()), ("yours", own_cameras())):
        for name, file in names.items():
            try:
                spec = Camera.load(file).spec
            except InputError as mistake:
                broken.append(str(mistake))
                continue
            size = "{} x {}".format(*spec.resolution)
            gain, noise = f"{spec.gain_e_per_dn:.3g}", f"{spec.read_noise.sigma_e:.3g}"
            is_preset = isinstance(spec.source, dict) and "kind" in spec.source  # what it stands for
            values = "preset" if is_preset else "sourced"
            values += f", {len(spec.assumed)} assumed" if spec.assumed else ""
            colour = "colour" if spec.colour else "mono"
            rows.append([name, spec.name, values, colour, size, str(spec.bit_depth), gain, noise, place])
    head = ["name", "camera", "values", "colour", "rows x columns", "bit", "e-/DN", "read noise e-", "from"]
    cli.print_table(head, rows)
    for mistake in broken:
        click.echo(f"warning: {mistake}", err=True)
