#!/usr/bin/env python
"""Makes docs/effects/ (one page an effect, from its code) and docs/chain.md (order and readings).

Usage: python scripts/make_docs.py [NAME ...]     without names: every page
"""

import inspect
import re
import sys
from pathlib import Path

import chain_page
import effect_pictures as pictures

from visaug.camera.paths import path_of
from visaug.effects import Effect, catalogue

DOCS = Path(__file__).resolve().parents[1] / "docs"
STAGES = {
    "OPTICS": "light on its way to the sensor; photons per pixel",
    "GENERATION": "means in the pixel, before shot noise; electrons",
    "CHARGE": "counted charge, stored, shared and transferred; electrons",
    "READOUT": "voltages on their way to the converter, told in electrons",
    "DIGITAL": "in and after the converter; DN",
    "PICTURE": "the developed picture, encoded as it is shown; 0 to 1",
}


def main(names: list[str]) -> None:
    folder = DOCS / "effects"
    folder.mkdir(parents=True, exist_ok=True)
    effects = list(catalogue().values())
    for effect in effects:
        if not names or effect.name in names:
            span = pictures.strip(effect, folder / f"{effect.name}.png")
            pictures.signature(effect, folder / f"{effect.name}_signature.png")
            (folder / f"{effect.name}.md").write_text(page(effect, span))
    (folder / "index.md").write_text(index(effects))
    if not names or "chain" in names:
        chain_page.write(DOCS, effects)


def page(effect: type[Effect], span: str) -> str:
    """The page of one effect, in Markdown."""
    doc = inspect.cleandoc(effect.__doc__ or "")
    lines = [
        f"# {effect.name}",
        "",
        effect.summary,
        "",
        f"Stage: {effect.stage.name.lower()} ({STAGES[effect.stage.name]}), order {effect.order}"
        + (", a term of the base chain." if effect.base else "."),
        "",
        doc,
        "",
        "## Equation",
        "",
        f"    {effect.equation}",
        "",
        f"Source: {effect.source}.",
        "",
        *_parameters(effect),
        "## Gradient",
        "",
        "To the image and to every number." if effect.differentiable else f"None: {effect.why_not}.",
        "",
    ]
    if text := effect.separates:
        lines += ["## What tells it from its look-alikes", "", f"{text[0].upper()}{text[1:]}.", ""]
    settings = ", ".join(f"{name} {value:g}" for name, value in pictures.shown(effect).items())
    at = f" ({settings})" if settings and not effect.base else ""
    lines += [
        "## What it looks like",
        "",
        f"Without, with{at}, and the difference (blue to red: -{span} to {span} {pictures.unit(effect)}), same random numbers:",
        "",
        f"![{effect.name}: without, with, difference]({effect.name}.png)",
        "",
        "What it does to a camera's usual measures, grey without and blue with it:",
        "",
        f"![signature of {effect.name}]({effect.name}_signature.png)",
        "",
    ]
    return "\n".join(lines)


def _parameters(effect: type[Effect]) -> list[str]:
    if not effect.parameters:
        return ["It has no parameters.", ""]
    lines = [
        "## Parameters",
        "",
        "| in camera.yaml | unit | default | allowed | source |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, p in effect.parameters.items():
        allowed = (
            ", ".join(p.options) if p.options else f"{p.low:g} to {p.high:g}{', whole' if p.integer else ''}"
        )
        default = p.default if p.options else f"{p.default:g}"
        path = path_of(effect.name, name) if effect.base else name
        lines.append(f"| `{path}` | {p.unit if not p.options else ''} | {default} | {allowed} | {p.source} |")
    if effect.map_unit:
        path = f"{effect.name}.map" if effect.base else "map"
        lines.append(f"| `{path}` | {effect.map_unit} | | a file | measured; .npy, TIFF or FITS |")
    lines.append("")
    zeros = " and ".join(f"`{strength}`" for strength in effect.strengths())
    if zeros:
        lines += [f"It vanishes where {zeros} {'are' if ' and ' in zeros else 'is'} 0.", ""]
    if not effect.base:
        given = ", ".join(f"{name}: {value:g}" for name, value in pictures.shown(effect).items())
        lines += ["```yaml", "effects:", f"  - {{name: {effect.name}, {given}}}", "```", ""]
    return lines


def index(effects: list[type[Effect]]) -> str:
    """The list of all effects in the order of the chain."""
    lines = [
        "# Effects",
        "",
        "In the order in which they act ([why this order](../chain.md)).",
        "Pages and pictures are made from the code by `scripts/make_docs.py`.",
    ]
    for stage, unit in STAGES.items():
        lines += ["", f"## {stage.capitalize()}: {unit}", "", "| effect | what it is |", "| --- | --- |"]
        for effect in effects:
            if effect.stage.name == stage:
                star = " (base chain)" if effect.base else ""
                lines.append(
                    f"| [{effect.name}]({effect.name}.md){star} | {re.sub(r'[|]', '/', effect.summary)} |"
                )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main(sys.argv[1:])
