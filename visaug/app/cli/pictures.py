"""Commands on ordinary pictures: augment, preview; and example data."""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from visaug.app.cli import options as cli
from visaug.core.errors import PartlyFailed
from visaug.core.progress import progress_bars
from visaug.core.wording import counted
from visaug.report.preview import WORDS, write_preview

if TYPE_CHECKING:
    from visaug.augment.files import Augmented


class Range(click.ParamType):
    """A number, or two with a colon between: `0:24`."""

    name = "A[:B]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        with suppress(ValueError):
            ends = tuple(float(end) for end in str(value).split(":"))
            if len(ends) <= 2:
                return ends if len(ends) == 2 else ends[0]
        self.fail(f"{value!r} is not a number or a pair of numbers such as 0:24", param, ctx)


# Options of the conditions under which a picture is taken: encoding, light, gain, strength of the noise.
light_options = cli.all_of(
    cli.choice_option(
        "--transfer",
        ("auto", "linear", "srgb"),
        "Encoding of the pixel values. auto: from colour profile, tags, bit depth and number of channels.",
    ),
    click.option(
        "--gain-db", type=Range(), help="Gain in dB on the camera's scale. With A:B, drawn for each picture."
    ),
    click.option(
        "--exposure",
        type=Range(),
        help="Fraction of the saturation exposure, 1e-6 to 1; the brightness is restored. With A:B, drawn for each picture.",
    ),
    cli.with_default(
        "--strength", click.FloatRange(min=0), 1.0, "Factor on the standard deviation of the noise."
    ),
    click.option(
        "--bits",
        type=click.IntRange(1, 16),
        help="Bits used in 16-bit data, if fewer: 10, 12 or 14. Refused for other data, except 8 for 8-bit.",
    ),
)


@cli.command("augment", "visaug augment photos/ portrait.tif -o noisy/ --camera sony_imx174 --gain-db 0:24")
@click.argument("inputs", metavar="IN...", nargs=-1, required=True, type=cli.PATH)
@cli.output_option("OUT", "Folder for the copies.", required=True)
@cli.camera_option(if_repeated="If repeated, one is drawn for each picture.")
@light_options
@cli.with_default("--p", click.FloatRange(0, 1), 1.0, "Probability that a copy gets noise.")
@cli.with_default("--copies", click.IntRange(min=1), 1, "Copies of each picture: a_1.png, a_2.png, ...")
@cli.flag(
    "--copy-labels labels",
    "Copy everything else of the folders too: YOLO labels to where ultralytics looks for them, annotations, masks and "
    "depth to their places.",
)
@cli.option(
    "--include",
    "PATTERN",
    "Add noise to these pictures alone, for example 'rgb/*.png'; paths below an input. May be repeated.",
    multiple=True,
)
@cli.option("--exclude", "PATTERN", "Leave these out, for example '*mask*'. May be repeated.", multiple=True)
@cli.flag(
    "--force",
    "Add noise to what looks like labels too, and replace files that visaug did not write or that were changed since.",
)
@cli.choice_option(
    "--fixed-pattern",
    ("image", "camera"),
    "Draw new fixed patterns for each picture, or keep those of one camera.",
)
@cli.choice_option(
    "--black-level", ("subtract", "keep"), "Subtract the camera's black level from the result, or keep it."
)
@cli.effects_option()
def augment(inputs: tuple[Path, ...], output: Path, camera_names: tuple[str, ...], **options: Any) -> None:
    """Write noisy copies of pictures or folders.

    Reads PNG, JPEG, TIFF, WebP and BMP with 8 or 16 bits, floating-point TIFF, OpenEXR and NumPy arrays. Names,
    sizes, depth, channels and tags are preserved. Files that look like labels (masks, segmentations, depth) are copied
    without noise. If interrupted, the same command resumes. Damaged pictures are listed at the end (exit status 1).
    """
    from visaug.augment.files import augment_files

    cameras = [cli.load_camera(name) for name in camera_names]
    with progress_bars() as progress:
        done = augment_files(inputs, output, cameras, progress=progress, **options)
    _say(done, output)
    mono = [camera.name for camera in cameras if not camera.spec.colour]
    if done.coloured and mono:
        click.echo(f"monochrome, the same noise in the three channels of colour pictures: {', '.join(mono)}")
    if done.failed:
        head = f"{counted(len(done.failed), 'picture')} could not be used:"
        raise PartlyFailed("\n  ".join([head, *done.failed]))


@cli.command(
    "preview", "visaug preview photo.jpg --camera sony_imx174 --camera canon_5d4_iso800 -o sheet.png"
)
@click.argument("picture", metavar="IMAGE", type=cli.PATH)
@cli.camera_option(if_repeated="If repeated, the sheet shows each.")
@light_options
@cli.output_option("sheet.png", "Write the contact sheet; an earlier sheet is replaced.", required=True)
@cli.force_option
@cli.effects_option()
def preview(picture: Path, camera_names: tuple[str, ...], output: Path, **options: Any) -> None:
    """Write a contact sheet of one picture.

    For each camera it shows a crop at 1:1, a part of it at 4x, and the standard deviation of the noise at five levels,
    in 8-bit levels (0 to 255). Gain and exposure that are not given are chosen so that the noise is visible, and
    are printed on the sheet.
    """
    said = write_preview(picture, [cli.load_camera(name) for name in camera_names], output, **options)
    click.echo(f"transfer function: {said}")
    cli.written(output)


@cli.command(
    "example", "visaug example example/\nvisaug preview example/render.png --camera sony_imx174 -o sheet.png"
)
@click.argument("folder", metavar="DIR", type=cli.PATH)
def example(folder: Path, seed: int) -> None:
    """Copy example data into DIR, a new or empty folder.

    A clean rendered picture (render.png), frames of a simulated camera (frames/), and the data sheet of that camera
    (data_sheet.yaml), which lacks one effect.
    """
    from visaug.data import copy_example

    click.echo(f"wrote render.png, frames/ and data_sheet.yaml to {copy_example(folder)}")


def _say(done: "Augmented", output: Path) -> None:
    """What was done, what was assumed, what was left out."""
    line = f"wrote {counted(done.written, 'picture')} to {output}"
    line += f" ({done.replaced} replaced)" if done.replaced else ""
    click.echo(line + (f", {done.kept} existed already" if done.kept else ""))
    if done.carried:
        they_are = "it is" if done.carried == 1 else "they are"
        click.echo(f"copied {counted(done.carried, 'other file')} as {they_are}")
    if done.like_labels:
        reasons = ", ".join(f"{why}: {count}" for why, count in sorted(done.like_labels.items()))
        click.echo(
            f"warning: {counted(sum(done.like_labels.values()), 'file')} of these got no noise, for looking like labels "
            f"({reasons}); --exclude PATTERN leaves such files out, --force adds noise"
        )
    if done.assumed:
        parts = [f"{WORDS[kind]} for {count} ({why})" for (kind, why), count in sorted(done.assumed.items())]
        click.echo(f"transfer function: {', '.join(parts)}")
    skipped = ", ".join(f"{count} {suffix}" for suffix, count in sorted(done.skipped.items()))
    clipped = "which are clipped: 1 is white; divide a high-dynamic-range render by the value that shall be white first"
    for there, said in (
        (done.clipped, f"{counted(done.clipped, 'picture')} with values outside [0, 1], {clipped}"),
        (done.skipped, f"skipped {counted(sum(done.skipped.values()), 'file')}: {skipped}"),
        (done.outputs, f"skipped copies of visaug augment in {', '.join(map(str, done.outputs))}"),
        (done.again, f"noise was added to copies of visaug augment: {', '.join(map(str, done.again))}"),
        (done.excluded, f"left out {counted(done.excluded, 'picture')} by --include and --exclude"),
        (done.unlabelled, f"{counted(done.unlabelled, 'picture')} without labels"),
    ):
        if there:
            click.echo(said)
