"""Results on the terminal, from their JSON form."""

from typing import TYPE_CHECKING, Any

import click

from visaug.cli.tables import print_table

if TYPE_CHECKING:
    from visaug.frames.survey import Survey

MARK = "…"


def print_characterization(result: dict[str, Any]) -> None:
    """A table of parameters with intervals, what stays open, and warnings."""
    rows = [
        [name, number(entry["value"]), interval(entry), entry["unit"], entry["from"]]
        for name, entry in result["parameters"].items()
    ]
    print_table(["parameter", "value", "95 % interval", "unit", "from"], rows)
    for entry in result["not_determined"]:
        click.echo(f"not determined: {entry['parameter']}; needs {entry['needs']}")
    for warning in result["warnings"]:
        click.echo(f"warning: {warning}")


def print_survey(found: "Survey") -> None:
    """The frames of each condition, then what is missing."""
    rows = [
        [kind or "?", str(count), *(_cell(v) for v in values)]
        for (kind, *values), count in found.conditions().items()
    ]
    print_table(
        ["kind", "frames", "exposure s", "temperature C", "gain dB", "setting", "filter", "photons"], rows
    )
    for note in found.notes:
        click.echo(note)
    if not found.complete:
        click.echo("the table is not complete: fill in the blank cells before it is used")


def _cell(value: float | str | None) -> str:
    return "" if value is None else value if isinstance(value, str) else f"{value:g}"


def print_comparison(result: dict[str, Any]) -> None:
    """Whether the model holds, and where it fails."""
    print_verdict(result["fits"])
    print_places(result["where"])


def print_diagnosis(result: dict[str, Any]) -> None:
    """What was missing, the error falling step by step, and what is left."""
    error, fits = result["error"], result["fits"]
    if result["accepted"]:
        click.echo("missing: " + ", ".join(map(described(result["ranking"]), result["accepted"])))
    elif fits["adequate_before"]:
        click.echo("nothing is missing: the camera as given explains these frames")
    else:
        click.echo("no effect of the catalogue was accepted")
    for step in result["steps"]:
        value = f"{number(step['error'])} {interval_of(step.get('interval'))}".rstrip()
        click.echo(f"  {step['action']:<32} error {value}")
    if error["before"] is not None:
        after = f"{number(error['after'])} {interval_of(error.get('interval_after'))}".rstrip()
        click.echo(f"error: {number(error['before'])} before, {after} after")
        click.echo("       (0 is as close as another set of that camera would come)")
    for group in result["ambiguous"]:
        click.echo(
            f"cannot be told apart here: {', '.join(group['effects'])}; to tell them: {group['measure']}"
        )
    if result.get("form"):
        click.echo(result["form"])
    if result.get("cannot_show"):
        click.echo("frames like these could not show: " + ", ".join(result["cannot_show"]))
    if result["unexplained"]:
        click.echo(f"unexplained: {result['unexplained']['description']}")
        click.echo("if you know what it is, write it down: visaug effects new NAME")


def described(ranking: list[dict[str, Any]]):
    """Name of an effect with its fitted parameters, from the ranking where it stands there."""
    known = {entry["effect"]: entry.get("parameters") or {} for entry in ranking}

    def describe(name: str) -> str:
        values = [
            f"{key} {number(entry['value'])} {interval(entry)}".rstrip()
            for key, entry in known.get(name, {}).items()
        ]
        return f"{name} ({', '.join(values)})" if values else name

    return describe


def print_verdict(fits: dict[str, Any]) -> None:
    says = "holds" if fits["adequate_before"] else "does not hold"
    click.echo(f"the model {says} (p = {number(fits['p_value_before'])})")


def print_places(where: list[dict[str, Any]], most: int = 10) -> None:
    rows = [
        [place["view"], f"{place['share']:.0%}", str(place["worst"]), number(place["z"])]
        for place in where[:most]
    ]
    if rows:
        print_table(["view", "share of the misfit", "worst statistic", "standard deviations"], rows)


def number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.4g}"


def interval(entry: dict[str, Any]) -> str:
    low, high = entry.get("low"), entry.get("high")
    return "" if low is None and high is None else f"[{number(low)}{MARK}{number(high)}]"


def interval_of(pair: list[float] | None) -> str:
    return f"[{number(pair[0])}{MARK}{number(pair[1])}]" if pair else ""
