"""What `visaug effects` prints and writes."""

import keyword
from pathlib import Path

import click

from visaug.app.cli.tables import print_table
from visaug.core.errors import InputError
from visaug.core.files import write_text
from visaug.effects.catalogue import catalogue, load_file
from visaug.effects.effect import Effect, Parameter

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


def print_catalogue() -> None:
    """One line for each effect, in the order of the chain."""
    rows = [[name, effect.stage.name.lower(), effect.summary] for name, effect in catalogue().items()]
    print_table(["effect", "stage", "description"], rows)


def print_effect(name: str) -> None:
    """An effect in full: law, parameters with units and bounds, sources."""
    effect = find(name)
    click.echo(f"{name} ({effect.stage.name.lower()})")
    for line in (effect.summary, effect.equation, effect.source and f"Source: {effect.source}"):
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
        raise InputError(
            repr(name), field="NAME", expected="lower-case letters, digits and _, such as my_effect"
        )
    if name in catalogue():
        raise InputError(f"{name!r} is an effect of the catalogue", field="NAME", expected="another name")
    output = output or Path(f"{name}.py")
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
        raise InputError(
            f"{faults} laws are broken, see the table", file=file, expected="effects that keep them all"
        )


def find(name: str) -> type[Effect]:
    effects = catalogue()
    if name in effects:
        return effects[name]
    from difflib import get_close_matches

    near = get_close_matches(name, effects, n=3) or sorted(effects)
    raise InputError(f"{name!r} is not an effect of the catalogue", field="NAME", expected=" or ".join(near))


def _range(parameter: Parameter) -> str:
    if parameter.options:
        return " | ".join(parameter.options)
    return (
        f"{parameter.low:g} to {parameter.high:g}"
        if parameter.high != float("inf")
        else f">= {parameter.low:g}"
    )
