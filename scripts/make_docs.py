#!/usr/bin/env python
"""Generates docs/effects/ (one page per effect, from its code) and docs/chain.md (order and readings).

Usage: python scripts/make_docs.py [NAME ...]     without names: every page
"""

import inspect
import sys
from pathlib import Path

import chain_page
import effect_pictures as pictures

from visaug.camera.paths import path_of
from visaug.effects import Effect, Stage, Unexplained, catalogue
from visaug.effects.parameter import used_with

DOCS = Path(__file__).resolve().parents[1] / "docs"
STAGES = {
    "OPTICS": "light before it reaches the sensor; photons per pixel",
    "GENERATION": "mean electrons in the pixel, before shot noise",
    "CHARGE": "charge after shot noise, stored, shared and transferred; electrons",
    "READOUT": "voltages before the converter, in electrons",
    "DIGITAL": "the converter and after it; DN",
    "PICTURE": "the developed picture, encoded for display; 0 to 1",
}


def main(names: list[str]) -> None:
    folder = DOCS / "effects"
    folder.mkdir(parents=True, exist_ok=True)
    effects = list(catalogue().values())
    for effect in effects:
        if not names or effect.name in names:
            span = pictures.strip(effect, folder / f"{effect.name}.png")
            pictures.signature(effect, folder / f"{effect.name}_signature.png")
            for form in pictures.OTHER_FORMS.get(effect.name, {}).items():
                pictures.strip(effect, folder / f"{effect.name}_{form[1]}.png", **dict([form]))
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
        *([f"Also called: {', '.join(effect.aliases)}.", ""] if effect.aliases else []),
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
        *([] if is_tried(effect) else ["`visaug diagnose` does not try this effect by itself.", ""]),
        *_parameters(effect),
        "## Gradient",
        "",
        "With respect to the image and to every numeric parameter."
        if effect.differentiable
        else f"None: {effect.why_not}.",
        "",
    ]
    if text := effect.separates:
        lines += ["## How to distinguish it from similar effects", "", f"{text[0].upper()}{text[1:]}.", ""]
    settings = ", ".join(f"{name} {value:g}" for name, value in pictures.shown(effect).items())
    colours = f"blue to red: -{span} to {span} {pictures.unit(effect)}"
    at = f" ({settings})" if settings and not effect.base else ""
    lines += [
        "## Example",
        "",
        f"Without the effect, with it{at}, and the difference ({colours}), for the same random numbers:",
        "",
        f"![{effect.name}: without, with, difference]({effect.name}.png)",
        "",
    ]
    for option, word in pictures.OTHER_FORMS.get(effect.name, {}).items():
        lines += [
            f"The same with `{option}: {word}`:",
            "",
            f"![{effect.name}, {word}: without, with, difference]({effect.name}_{word}.png)",
            "",
        ]
    lines += [
        "Statistics of simulated frames without (grey) and with (blue) the effect:",
        "",
        f"![signature of {effect.name}]({effect.name}_signature.png)",
        "",
    ]
    return "\n".join(lines)


def is_tried(effect: type[Effect]) -> bool:
    """Whether a diagnosis tries the effect by itself."""
    return effect.proposed and effect.stage < Stage.PICTURE


def _parameters(effect: type[Effect]) -> list[str]:
    if not effect.parameters and not effect.map_unit:
        return ["The effect has no parameters.", ""]
    lines = [
        "## Parameters",
        "",
        "| in camera.yaml | unit | default | allowed | source |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, p in effect.parameters.items():
        allowed = (
            ", ".join(p.options)
            if p.options
            else f"{p.low:g} to {p.high:g}{', integer' if p.integer else ''}"
        )
        allowed += f"; with `{used_with(effect.parameters, p)}` only" if p.of else ""
        default = p.default if p.options else f"{p.default:g}"
        path = path_of(effect.name, name) if effect.base else name
        lines.append(f"| `{path}` | {p.unit if not p.options else ''} | {default} | {allowed} | {p.source} |")
    if effect.map_unit:
        path = f"{effect.name}.map" if effect.base else "map"
        forms = ".npz" if effect is Unexplained else ".npy, TIFF or FITS"
        lines.append(f"| `{path}` | {effect.map_unit} | | a file | measured; {forms} |")
    lines.append("")
    zeros = " and ".join(f"`{strength}`" for strength in effect.strengths())
    if zeros:
        lines += [f"The effect vanishes if {zeros} {'are' if ' and ' in zeros else 'is'} 0.", ""]
    if not effect.base:
        given = ", ".join(f"{name}: {value:g}" for name, value in pictures.shown(effect).items())
        given = "map: better_unexplained.npz" if effect is Unexplained else given
        lines += ["```yaml", "effects:", f"  - {{name: {effect.name}, {given}}}", "```", ""]
    return lines


def index(effects: list[type[Effect]]) -> str:
    """The list of all effects in the order of the chain."""
    further = [effect for effect in effects if not effect.base]
    tried = [effect for effect in further if is_tried(effect)]
    lines = [
        "# Effects",
        "",
        "The effects in the order in which they act ([the chain](../chain.md) explains the order).",
        f"There are {len(effects) - len(further)} terms of the base chain and {len(further)} further effects; `visaug diagnose`",
        f"tries {len(tried)} of the further effects, and the pages of the others say that it does not.",
        "`visaug effects --search banding` finds effects by the words of the field.",
        "`scripts/make_docs.py` generates these pages and pictures from the code.",
    ]
    for stage, unit in STAGES.items():
        lines += ["", f"## {stage.capitalize()}: {unit}", "", '<div class="gallery" markdown>']
        for effect in effects:
            if effect.stage.name == stage:
                star = " (base chain)" if effect.base else ""
                lines += [
                    "",
                    f"[![{effect.name}]({effect.name}.png)]({effect.name}.md)",
                    f"**[{effect.name}]({effect.name}.md)**{star}: {effect.summary}",
                ]
        lines += ["", "</div>"]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main(sys.argv[1:])
