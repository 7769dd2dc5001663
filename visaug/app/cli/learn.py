"""Commands of the pose harness: demo, train, ablate, evaluate."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from visaug.app.cli.options import (
    command,
    effects_option,
    is_silent,
    json_option,
    output_option,
    write_result,
    written,
)
from visaug.app.cli.tables import print_table
from visaug.core.errors import InputError
from visaug.core.progress import progress_bars

config_argument = click.argument("config_path", metavar="CONFIG", type=click.Path(path_type=Path))


@contextmanager
def harness() -> Iterator[None]:
    """Says which extra is missing, where it is."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name and error.name.split(".")[0] in ("ultralytics", "cv2", "visaug_train"):
            raise InputError(
                f"{error.name} is not installed", expected="the extra `train`: pip install 'visaug[train]'"
            ) from None
        raise


@command("demo", example="visaug demo -o demo/")
@output_option("DIR", "Folder for data, runs and report.html.", default=Path("demo"), show_default=True)
def demo(output: Path, seed: int) -> None:
    """Train, evaluate and report on embedded data. If interrupted, the same command resumes."""
    with harness(), progress_bars() as progress:
        from visaug_train.demo import run_demo

        report = run_demo(output, seed=seed, progress=progress)
    click.echo(f"report: {report.resolve()}")


@command("train", example="visaug train configs/demo.yaml")
@config_argument
@effects_option()
def train(config_path: Path, seed: int) -> None:
    """Train one network as configured in CONFIG."""
    run("train", config_path, seed)


@command("ablate", example="visaug ablate configs/speedplus.yaml")
@config_argument
@effects_option()
def ablate(config_path: Path, seed: int) -> None:
    """Train the arms of CONFIG and compare them.

    The arms are trained under otherwise equal conditions.
    """
    run("ablate", config_path, seed)


def run(what: str, config_path: Path, seed: int) -> None:
    with harness(), progress_bars() as progress:
        from visaug_train import commands

        click.echo(getattr(commands, what)(config_path, seed=seed, progress=progress))


@command(
    "evaluate",
    example="visaug evaluate configs/demo.yaml\n"
    "visaug evaluate --predictions P.json --data speedplus/ --domain lightbox --json scores.json",
)
@click.argument("config_path", metavar="[CONFIG]", required=False, type=click.Path(path_type=Path))
@click.option(
    "--predictions",
    metavar="P",
    type=click.Path(path_type=Path),
    help="Predictions of any network: keypoints in the COCO results format (JSON), or poses (CSV).",
)
@click.option("--data", metavar="DIR", type=click.Path(path_type=Path), help="A SPEED or SPEED+ folder.")
@click.option("--domain", metavar="NAME", help="Test set of that folder.")
@effects_option()
@click.option(
    "--images",
    metavar="F.json",
    type=click.Path(path_type=Path),
    help="COCO annotations file, needed if P gives image_id instead of file names.",
)
@click.option(
    "--poses",
    "poses_csv",
    metavar="F.csv",
    type=click.Path(path_type=Path),
    help="Write the poses computed from the keypoints of P: file, q1..q4, r1..r3.",
)
@json_option
def evaluate(
    config_path: Path | None,
    predictions: Path | None,
    data: Path | None,
    domain: str | None,
    images: Path | None,
    poses_csv: Path | None,
    json_path: Path | None,
    seed: int,
) -> None:
    """Score a network on its test sets.

    The network is the one trained by CONFIG, or any other whose predictions P on a SPEED or SPEED+ folder are given.
    P is in the COCO results format with `file_name` (or `image_id` and --images), or a CSV of poses in the format
    of the Kelvins competition: file, q1..q4 (scalar first), r1..r3 in metres.
    """
    given = {"--predictions": predictions, "--data": data, "--domain": domain}
    absent = [name for name, value in given.items() if value is None]
    if (config_path is None) == (len(absent) == 3) or (config_path is None and absent):
        raise InputError(
            "wrong arguments",
            field="evaluate",
            expected="CONFIG, or all of --predictions, --data and --domain",
        )
    if config_path is not None and (images or poses_csv):
        raise InputError("go with --predictions", field="--images and --poses", expected="no CONFIG")
    with harness(), progress_bars() as progress:
        from visaug_train import commands

        scores: dict[str, Any]
        if config_path:
            scores = commands.evaluate(config_path, seed=seed, progress=progress)
        else:
            assert predictions is not None  # nothing is absent, see above
            assert data is not None
            assert domain is not None
            scores = commands.evaluate_predictions(
                predictions, data, domain, images=images, poses_csv=poses_csv
            )
    if not is_silent(False, json_path):
        print_scores(scores)
    write_result(json_path, scores)
    written(json_path)


def print_scores(scores: dict[str, dict[str, Any]]) -> None:
    """One line for each domain."""
    head = [
        "domain",
        "images",
        "IoU",
        "OKS (paper)",
        "OKS (COCO)",
        "box AP",
        "keypoint AP (paper)",
        "(COCO)",
        "E_t, m",
        "E_q, deg",
        "SPEC (floors)",
        "(no floors)",
    ]
    rows = []
    for domain, s in scores.items():
        values = (
            s["iou"],
            s["oks"]["paper"],
            s["oks"]["coco"],
            s["box_ap50_95"],
            s["keypoint_ap50_95"]["paper"],
            s["keypoint_ap50_95"]["coco"],
            s.get("position_error_m"),
            s.get("attitude_error_deg"),
            s.get("spec_score_floored"),
            s.get("spec_score_unfloored"),
        )
        rows.append([domain, str(s["images"]), *("" if v is None else f"{v:.4f}" for v in values)])
    print_table(head, rows)


COMMANDS: list[click.Command] = [demo, train, ablate, evaluate]
