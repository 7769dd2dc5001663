"""Commands of the pose harness: demo, prepare, train, ablate, evaluate."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from visaug.app.cli import options as cli
from visaug.core.errors import InputError
from visaug.core.extras import extra
from visaug.core.progress import progress_bars

config_argument = click.argument("config_path", metavar="CONFIG", type=cli.PATH)

arm_option = click.option("--arm", metavar="NAME", help="Arm of CONFIG; the last one by default.")
keypoints_option = click.option(
    "--keypoints",
    metavar="F.yaml",
    default="tango",
    show_default=True,
    help="Points of the spacecraft: points_m (name: [x, y, z] in metres), and sigmas and flip_pairs if wanted.",
)


@cli.command("demo", "visaug demo -o demo/")
@cli.output_option("DIR", "Folder for data, runs and report.html.", default=Path("demo"), show_default=True)
@cli.flag("--full", "The longer study: three arms trained from nothing, four test sets.")
def demo(output: Path, full: bool, seed: int) -> None:
    """Diagnose a camera, train with its noise, evaluate and report, on rendered data. If interrupted, the same command resumes."""
    cli.may_replace(output / "report.html", force=False, expected="another folder")
    with extra(), progress_bars() as progress:
        from visaug_train.demo import run_demo

        report, finding = run_demo(output, seed=seed, progress=progress, full=full)
    for sentence in finding:
        click.echo(sentence)
    click.echo(f"report: {report.resolve()}")


@cli.command(
    "prepare",
    "visaug prepare speedplusv2.zip -o datasets/speedplus\n"
    "visaug prepare speed.zip -o datasets/speed --coco --size 640x400\nvisaug prepare datasets/speed",
)
@click.argument("archive", metavar="ARCHIVE", type=cli.PATH)
@cli.output_option(
    "DIR",
    "Folder of the dataset, required for an archive. A folder is used where it lies: there, DIR only names what --coco and "
    "--size write.",
)
@cli.option("--size", "WxH", "Also write copies of this size with ultralytics labels, beside DIR.")
@click.option("--coco", is_flag=True, help="Also write COCO keypoint annotations of every set, to DIR-coco.")
@keypoints_option
def prepare(
    archive: Path, output: Path | None, size: str | None, coco: bool, keypoints: str, seed: int
) -> None:
    """Unpack and check an archive or a folder of SPEED, SPEED+, SHIRT, SPE3R, SPARK 2022, SpaceSense-Bench, BOP or COCO keypoints.

    If interrupted, the same command resumes. An archive that is not the one DIR was made of is refused.
    """
    with extra(), progress_bars() as progress:
        from visaug_train.archive import prepare_dataset

        said = prepare_dataset(archive, output, size, keypoints, coco, progress)
    click.echo(said)


@cli.command("train", "visaug train configs/demo.yaml --arm vis")
@config_argument
@arm_option
@cli.effects_option()
def train(config_path: Path, arm: str | None, seed: int) -> None:
    """Train one network as configured in CONFIG."""
    run("train", config_path, seed, arm=arm)


@cli.command("ablate", "visaug ablate configs/speedplus.yaml")
@config_argument
@cli.effects_option()
def ablate(config_path: Path, seed: int) -> None:
    """Train the arms of CONFIG and compare them.

    The arms are trained under otherwise equal conditions.
    """
    run("ablate", config_path, seed)


def run(what: str, config_path: Path, seed: int, **more: Any) -> None:
    with extra(), progress_bars() as progress:
        from visaug_train import commands

        click.echo(getattr(commands, what)(config_path, seed=seed, progress=progress, **more))


@cli.command(
    "evaluate",
    "visaug evaluate configs/demo.yaml --arm vis\n"
    "visaug evaluate --predictions P.json --data speedplus/ --domain lightbox --json scores.json\n"
    "visaug evaluate configs/speed.yaml --data speed/ --domain real_test --poses submission.csv\n"
    "visaug evaluate configs/demo.yaml --arm vis --severity sony_imx174 -o severity/",
)
@click.argument("config_path", metavar="[CONFIG]", required=False, type=cli.PATH)
@cli.path_option(
    "--predictions",
    "P",
    "Predictions of any network: keypoints in the COCO results format (JSON), or poses (CSV).",
)
@cli.path_option("--data", "DIR", "Folder of a pose data set.")
@click.option("--domain", metavar="NAME", help="Test set of that folder.")
@cli.option("--split", "NAME", "train, validation or test; by default the test split where there is one.")
@keypoints_option
@arm_option
@cli.effects_option()
@cli.path_option(
    "--images", "F.json", "COCO annotations file, needed if P gives image_id instead of file names."
)
@cli.path_option(
    "--poses poses_csv",
    "F.csv",
    "Write the poses computed from the keypoints: file, q1..q4, r1..r3. All there is for images without labels.",
)
@cli.option(
    "--severity severity_camera",
    "CAMERA",
    "Scores of CONFIG's network as this camera's gain, exposure, temperature and single effects grow worse.",
)
@cli.option(
    "--curve curves",
    "NAME",
    "One curve of --severity: gain_db, exposure, temperature_c or an effect. May be repeated; all by default.",
    multiple=True,
)
@cli.output_option(
    "DIR", "Folder of the curves of --severity; the same command resumes.  [default: severity]"
)
@cli.json_option
@cli.force_option
def evaluate(
    config_path: Path | None,
    predictions: Path | None,
    data: Path | None,
    domain: str | None,
    split: str | None,
    keypoints: str,
    arm: str | None,
    images: Path | None,
    poses_csv: Path | None,
    severity_camera: str | None,
    curves: tuple[str, ...],
    output: Path | None,
    json_path: Path | None,
    force: bool,
    seed: int,
) -> None:
    """Score a network on its test sets.

    The network is the one trained by CONFIG, or any other whose predictions P on a data set are given.
    P is in the COCO results format with `file_name` (or `image_id` and --images), `bbox` may be absent; or it is a CSV of
    poses in the format of the Kelvins competition: file, q1..q4 (scalar first), r1..r3 in metres. Another order of
    quaternions, centimetres, millimetres and points of a common other scale are recognised and reported.

    CONFIG with --data and --domain scores its network on that set. A set without labels gives the poses of a submission.
    """
    together = (data is None) == (domain is None) and (predictions is None or data is not None)
    if (config_path is None) == (predictions is None) or not together:
        expected = "CONFIG, or all of --predictions, --data and --domain"
        raise InputError("wrong arguments", field="evaluate", expected=expected)
    if config_path is not None and (images or keypoints != "tango"):
        raise InputError("go with --predictions", field="--images and --keypoints", expected="no CONFIG")
    if config_path is not None and data is None and (poses_csv or split):
        raise InputError("go with --data", field="--poses and --split", expected="--data and --domain")
    if predictions is not None and arm is not None:
        raise InputError("goes with CONFIG", field="--arm", expected="no --predictions")
    if (curves or output) and severity_camera is None:
        raise InputError("go with --severity", field="--curve and --output", expected="--severity CAMERA")
    cli.may_write(poses_csv, force)
    elsewhere = None if data is None or domain is None else (data, domain, split)
    if severity_camera is not None and (config_path is None or poses_csv or json_path):
        expected = "CONFIG, without --poses and --json; for another network visaug_train.severity.severity"
        raise InputError("needs the network itself", field="--severity", expected=expected)
    scores: dict[str, Any]
    with extra(), progress_bars() as progress:
        from visaug_train import commands

        if config_path is not None and severity_camera is not None:
            folder, how = output or Path("severity"), ([*curves], seed, progress, arm, elsewhere)
            said, scores = commands.severity_curves(config_path, severity_camera, folder, *how), {}
        elif config_path is not None:
            said, scores = "", commands.evaluate(config_path, seed, progress, arm, elsewhere, poses_csv)
        else:
            assert predictions is not None and data is not None and domain is not None  # noqa: PT018 - see above
            how = keypoints, split, images, poses_csv, seed
            said, scores = "", commands.evaluate_predictions(predictions, data, domain, *how)
    if said:  # after the progress bar, which would be drawn over it
        click.echo(said)
        return
    for name, each in scores.items():
        for note in each.get("notes", ()):
            click.echo(f"note: {name}: {note}.", err=True)
    if not cli.is_silent(False, json_path):
        print_scores(scores)
    cli.write_result(json_path, scores)
    cli.written(json_path, poses_csv)


def print_scores(scores: dict[str, dict[str, Any]]) -> None:
    """One line for each domain."""
    columns: dict[str, Callable[[dict[str, Any]], float | None]] = {
        "IoU": lambda s: s["iou"],
        "OKS (paper)": lambda s: s["oks"]["paper"],
        "OKS (COCO)": lambda s: s["oks"]["coco"],
        "box AP": lambda s: s["box_ap50_95"],
        "keypoint AP (paper)": lambda s: s["keypoint_ap50_95"]["paper"],
        "(COCO)": lambda s: s["keypoint_ap50_95"]["coco"],
        "E_t, m": lambda s: s["position_error_m"],
        "E_q, deg": lambda s: s["attitude_error_deg"],
        "SPEC (floors)": lambda s: s["spec_score_floored"],
        "(no floors)": lambda s: s["spec_score_unfloored"],
        "answered": lambda s: s["poses_found"],
        "SPEC of these": lambda s: s["answered"]["spec_score"],
    }
    rows = []
    for domain, s in scores.items():
        if "spec_score" not in s:
            click.echo(f"{domain}: {s['images']} images without labels, poses of {s['poses_found']:.0%}")
            continue
        values = [of(s) for of in columns.values()]
        rows.append([domain, str(s["images"]), *("" if v is None else f"{v:.4f}" for v in values)])
    if rows:
        cli.print_table(["domain", "images", *columns], rows)
