"""Results on the terminal, from their JSON form."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import click

from visaug.app.cli.options import print_table
from visaug.core.wording import first_of, with_interval
from visaug.report import headline
from visaug.report.next_step import NextStep

if TYPE_CHECKING:
    from visaug.frames.survey import Survey


def print_characterization(result: dict[str, Any], camera_file: str | None) -> None:
    """What was found beyond the base chain, a table of parameters with intervals, what stays open, and warnings."""
    if said := headline.characterization_headline(result, camera_file):
        click.echo(said)
    parameters = result["parameters"].items()
    rows = [[name, headline.entry_text(e, ""), e["unit"], e["from"]] for name, e in parameters]
    print_table(["parameter", "value [95 % interval]", "unit", "source"], rows)
    needed: dict[str, list[str]] = {}
    for entry in result["not_determined"]:
        needed.setdefault(entry["needs"], []).append(entry["parameter"])
    for needs, parameters in needed.items():
        click.echo(f"not determined: {', '.join(parameters)}; needs {needs}")
    for warning in result["warnings"]:
        click.echo(f"warning: {warning}")


def print_survey(found: "Survey") -> None:
    """The frames of each condition, then what is missing."""

    def cells(values: Iterable[float | str | None], unknown: str = "") -> list[str]:
        return [unknown if v is None else v if isinstance(v, str) else f"{v:g}" for v in values]

    conditions = found.conditions().items()
    rows = [[kind or "?", str(count), *cells(values)] for (kind, *values), count in conditions]
    head = ["kind", "frames", "exposure s", "temperature C", "gain dB", "setting", "filter", "photons"]
    print_table(head, rows)
    told = [[first_of(files, 1), *cells(key, "?")] for key, files in found.told_by().items()]
    print_table(["files", "kind", "from", "exposure s", "from", "temperature C", "from"], told)
    for note in found.notes:
        click.echo(note)
    if not found.complete:
        click.echo("the table is not complete: fill in the blank cells before you use it")


def print_comparison(result: dict[str, Any]) -> None:
    """Where the model fails, then the answer in one sentence."""
    if result["where"]:
        print_table(headline.WHERE_HEAD, headline.where_rows(result["where"]))
    print_used(result)
    click.echo(headline.comparison_headline(result))


def print_diagnosis(result: dict[str, Any]) -> None:
    """The error step by step, then the answer as the report has it."""
    for step in result["steps"]:
        low, high = step.get("interval") or (None, None)
        click.echo(f"  {step['action']:<32} error {with_interval(step['error'], low, high)}")
    if result.get("cannot_show"):
        click.echo("these frames cannot show: " + ", ".join(result["cannot_show"]))
    print_used(result)
    click.echo(headline.diagnosis_headline(result))
    for line in headline.diagnosis_details(result):
        click.echo(line)


def print_next(step: NextStep) -> None:
    """The command that follows, to standard error: a script that reads the answer does not meet it."""
    click.echo("\n    ".join([step.text, *step.command.splitlines()]), err=True)


def print_used(result: dict[str, Any]) -> None:
    """Which frames and pixels were looked at, where it is not all of them, and warnings."""
    used = result.get("used")
    if used and (used["frames"] < used["of"] or used["windows"] != [used["frame"]]):
        click.echo(f"used: {used['description']}")
    for warning in result.get("warnings", ()):
        click.echo(f"warning: {warning}", err=True)
