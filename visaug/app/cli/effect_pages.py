"""What `visaug effects` prints and writes."""

import keyword
import re
from pathlib import Path

import click

from visaug.app.cli.options import print_table
from visaug.core.errors import InputError
from visaug.core.files import write_text
from visaug.core.nearest import did_you_mean
from visaug.core.wording import counted
from visaug.effects.catalogue import catalogue, load_file
from visaug.effects.effect import Effect, Parameter, Stage

TEMPLATE = '''"""{name}: describe in one sentence what it does to the signal, and cite the source of the law."""

from visaug import Effect, Parameter, Stage


class {class_name}(Effect):
    """An independent random offset for each row and frame. Replace it with your own physics in `apply`."""

    name = "{name}"
    # OPTICS (photons) -> GENERATION (mean electrons) -> CHARGE (electrons after shot noise)
    # -> READOUT (electrons before the converter) -> DIGITAL (DN) -> PICTURE (0 to 1, not part of measured frames)
    stage = Stage.READOUT
    summary = "One random offset for each row and frame."
    equation = "V <- V + r_row, r ~ N(0, sigma^2), new in every frame"
    source = "assumed"

    # The effect must vanish if the parameter marked `strength` is zero. `trials` are the starting values of a
    # diagnosis, from weak to strong.
    sigma_e = Parameter(0.0, unit="e-", low=0.0, strength=True, trials=(0.3, 1.0, 3.0), source="assumed")

    def apply(self, signal, p, stream, context):
        """`signal` is (images, channels, rows, columns) in the stage's unit; parameters are p.NAME."""
        # stream: random numbers, independent in each frame; stream.fixed: the same in every frame of a camera.
        return signal + p.sigma_e * stream.normal("row")
'''


ACTS = {
    Stage.OPTICS: "on the light before the sensor",
    Stage.GENERATION: "on the mean electrons in the pixel, before shot noise",
    Stage.CHARGE: "on the charge, stored, shared and transferred",
    Stage.READOUT: "on the voltage before the converter",
    Stage.DIGITAL: "in the converter and after it",
    Stage.PICTURE: "on the developed picture",
}


def print_catalogue(search: str) -> None:
    """One line for each effect, in the order of the chain, grouped by where they act.

    Only those that have all words of `search` in their name, their other names, or their description; refused where none has.
    """
    shown = [effect for effect in catalogue().values() if is_meant(effect, search)]
    if not shown:
        problem = f"no effect is described by {search!r}"
        raise InputError(problem, field="--search", expected="a word such as banding, or none")
    for stage, where in ACTS.items():
        here = [effect for effect in shown if effect.stage == stage]
        if rows := [[effect.name, effect.summary, ", ".join(effect.aliases)] for effect in here]:
            click.echo(f"\n{stage.name.lower()}: {where}")
            print_table(["effect", "description", "also called"], rows)


def is_meant(effect: type[Effect], search: str) -> bool:
    """Whether an effect's name, other names, or description hold every word, or words that begin so; case does not matter."""
    text = " ".join([effect.name, *effect.aliases, effect.summary, effect.__doc__ or ""]).replace("_", " ")
    words = search.replace("_", " ").split()
    return all(re.search(rf"\b{re.escape(word)}", text, re.IGNORECASE) for word in words)


def print_effect(name: str) -> None:
    """An effect in full: law, parameters with units and bounds, sources."""
    effect = find(name)
    click.echo(f"{name} ({effect.stage.name.lower()})")
    also = effect.aliases and f"Also called: {', '.join(effect.aliases)}"
    for line in (effect.summary, also, effect.equation, effect.source and f"Source: {effect.source}"):
        if line:
            click.echo(line)
    if not effect.differentiable:
        click.echo(f"No gradients: {effect.why_not}")
    if effect.parameters:
        click.echo()
        rows = [[key, p.unit, f"{p.default}", _range(p), p.source] for key, p in effect.parameters.items()]
        print_table(["parameter", "unit", "default", "range", "source"], rows)


def write_new(name: str, output: Path | None) -> Path:
    """A file with an effect of this name, ready to edit; an existing file is never overwritten."""
    if not name.isidentifier() or keyword.iskeyword(name) or name != name.lower():
        expected = "lower-case letters, digits and _, such as my_effect"
        raise InputError(repr(name), field="NAME", expected=expected)
    if name in catalogue():
        raise InputError(f"{name!r} is an effect of the catalogue", field="NAME", expected="another name")
    output = output or Path(f"{name}.py")
    if output.suffix != ".py":
        raise InputError("is no name of a Python file", file=output, expected="a name that ends in .py")
    if output.exists():
        raise InputError("already exists", file=output, expected="a new file; choose one with -o")
    class_name = "".join(part.capitalize() for part in name.split("_"))
    write_text(output, TEMPLATE.format(name=name, class_name=class_name))
    return output


def check_file(file: Path) -> None:
    """Asks every effect in a file the laws of effects, prints which it keeps, and refuses the file if one is broken."""
    from visaug.effects.testing import LAWS, broken_laws

    faults = 0
    for effect in load_file(file):
        broken = broken_laws(effect)
        faults += len(broken)
        rows = [[law.__name__.replace("_", " "), broken.get(law.__name__, "kept")] for law in LAWS]
        print_table([effect.name, "result"], rows)
    if faults:
        problem = f"breaks {counted(faults, 'law')}, see the table"
        raise InputError(problem, file=file, expected="effects that keep them all")


def find(name: str, field: str = "NAME") -> type[Effect]:
    effects = catalogue()
    if name in effects:
        return effects[name]
    problem = f"{name!r} is not an effect of the catalogue" + did_you_mean(name, effects)
    raise InputError(problem, field=field, expected="a name that `visaug effects` lists")


def _range(parameter: Parameter) -> str:
    if parameter.options:
        return " | ".join(parameter.options)
    low, high = parameter.low, parameter.high
    return f">= {low:g}" if high == float("inf") else f"{low:g} to {high:g}"
