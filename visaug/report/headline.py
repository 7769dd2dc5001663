"""The answer of a result in one sentence, what it means, and the next command: the same on pages, terminal and lab."""

from collections.abc import Mapping
from math import isclose
from typing import Any

from visaug.core.wording import (
    deviation_text,
    p_text,
    probability_text,
    share_text,
    statistic_text,
    with_interval,
)

Content = Mapping[str, Any]


def characterization_headline(content: Content, written: str | None) -> str | None:
    """What the frames show beyond the base chain, and where it was written; None where there is nothing.

    Args:
        written: the camera file that holds it.
    """
    if not content.get("effects"):
        return None
    named = [_measured(effect, content["parameters"]) for effect in content["effects"]]
    where = f"written to {written}" if written else "-o camera.yaml writes it"
    return f"This camera also has {' and '.join(named)}: {where}."


def _measured(effect: Content, parameters: Content) -> str:
    """An effect by name and numbers, with the interval of those that were measured as a parameter of temporal noise."""
    said = []
    for key, value in effect.items():
        if key == "name":
            continue
        if isinstance(value, str):
            said.append(f"{key} {value}")
            continue
        same = (
            e
            for k, e in parameters.items()
            if k.startswith("temporal.") and isclose(e["value"], value, rel_tol=1e-3)
        )
        e = next(same, None)
        number = with_interval(e["value"], e.get("low"), e.get("high"), e["unit"]) if e else f"{value:.3g}"
        said.append(number if key == "sigma_e" and e else f"{key} {number}")
    name = effect["name"].replace("_", " ")
    return f"{name}, {', '.join(said)}" if said else name


def view_title(name: str) -> str:
    """The plain name of a view."""
    from visaug.statistics import VIEWS

    titles = {view.name: view.title for view in VIEWS}
    return titles.get(name, name.replace("_", " ").capitalize()).rstrip(".")


WHERE_HEAD = ["view", "share of the misfit", "worst statistic", "standard deviations"]


def where_rows(where: list[dict[str, Any]]) -> list[list[str]]:
    """Where model and frames differ, the ten largest shares, under `WHERE_HEAD`."""
    return [
        [view_title(w["view"]), share_text(w["share"]), statistic_text(w["worst"]), deviation_text(w["z"])]
        for w in where[:10]
    ]


def comparison_headline(content: Content) -> str:
    """Whether the camera file explains the frames and, if not, where they differ most."""
    fits = content["fits"]
    p = p_text(fits["p_value_before"])
    if "pictures" in content and "target" in content["pictures"]:
        return _pictures_headline(content, p)
    if fits["adequate_before"]:
        return f"The model holds: nothing differs beyond chance ({p})."
    said = f"The model does not hold: the frames differ from it ({p})."
    if not content["where"]:
        return said
    worst = content["where"][0]
    view, side = view_title(worst["view"]), "above" if worst["z"] > 0 else "below"
    return (
        f"{said} The largest difference: {view[0].lower()}{view[1:]} ({statistic_text(worst['worst'])}), "
        f"{deviation_text(abs(worst['z']))} standard deviations {side} the model."
    )


def _pictures_headline(content: Content, p: str) -> str:
    if content["fits"]["adequate_before"]:
        return f"The two sets agree: no difference of their cameras beyond chance ({p})."
    said = f"The cameras of the two sets differ ({p})."
    if not content["where"]:
        return said
    worst = content["where"][0]
    side = "more" if worst["z"] > 0 else "less"
    size = f"{deviation_text(abs(worst['z']))} standard deviations"
    return f"{said} The largest difference: {worst['worst']}; the target has {side} ({size})."


def diagnosis_headline(content: Content) -> str:
    """What is missing, how strong, and how sure."""
    if content["accepted"]:
        known = {entry["effect"]: entry for entry in content["ranking"]}
        named = [_named(name, known.get(name, {})) for name in content["accepted"]]
        verb = "effects are" if len(named) > 1 else "effect is"
        return f"The missing {verb} {' and '.join(named)}."
    if content["fits"]["adequate_before"]:
        p = p_text(content["fits"]["p_value_before"])
        return f"Nothing is missing: the camera explains these frames ({p})."
    if content["unexplained"]:
        return f"No effect of the catalogue explains these frames. {content['unexplained']['description']}"
    return "No effect of the catalogue was accepted; refitting the camera was enough."


def diagnosis_details(content: Content) -> list[str]:
    """The error before and after, and what else is known."""
    error, fits = content["error"], content["fits"]
    lines = [f"Mistake in the camera file: {m['text']}" for m in content.get("camera_file", ())]
    if error["before"] is not None and content["accepted"]:
        low, high = error["interval_after"] or (None, None)
        lines.append(
            f"Error on hold-out frames: {error['before']:.2g} with the camera file, {with_interval(error['after'], low, high)} "
            "with the added effects. 0 is as good as a second camera of the same type."
        )
    if content["accepted"]:
        lines.append(
            f"After adding, no significant difference is left ({p_text(fits['p_value_after'])})."
            if fits["adequate_after"]
            else f"After adding, a significant difference is left ({p_text(fits['p_value_after'])})."
        )
    if (outside := content.get("outside") or 0.0) > 0.5:
        lines.append(
            f"What is left makes a cause outside the catalogue likelier (probability {probability_text(outside)}): "
            "what is named resembles it, or explains a small part of it by chance."
        )
    for group in content["ambiguous"]:
        lines.append(
            f"These frames cannot tell apart: {', '.join(group['effects'])}. To separate them: {group['measure']}."
        )
    if content.get("form"):
        lines.append(content["form"])
    if content["unexplained"] and content["accepted"]:
        lines.append(f"Unexplained: {content['unexplained']['description']}")
    if (part := (content["unexplained"] or {}).get("component")) is not None:
        lines.append(_component(part))
    return lines


def _component(part: Content) -> str:
    """What the measured component of the unexplained difference holds, and what it gives."""
    if not part["parts"]:
        return "Of an empirical component no part is significant: none is written."
    named = f"Empirical component ({', '.join(part['parts'])})"
    if part["error_after"] is None:
        return f"{named}: these frames do not tell the error with it."
    after = with_interval(part["error_after"], *part["interval_after"])
    told = f"{named}: error on hold-out frames {after} with it, {part['error_before']:.2g} without"
    return f"{told}." if part["lowers"] else f"{told}. It does not lower the error and is not written."


def effect_texts(names: list[str]) -> list[str]:
    """What each effect is physically: summary, law and source."""
    from visaug.effects import catalogue

    known = catalogue()
    texts = []
    for name in names:
        if name in known:
            effect = known[name]
            law = f" Law: {effect.equation}." if effect.equation else ""
            source = f" Source: {effect.source}." if effect.source else ""
            texts.append(f"{name}: {effect.summary}{law}{source} More: visaug effects {name}")
    return texts


AMONG = "among the effects that were tried and a cause outside the catalogue"
COUNTED = (
    "of 48 names with a probability above 0.5 in 88 sets of ordinary size, 37 of them with a cause outside the catalogue, 39 were "
    "right"
)  # a sentence of docs/results.md
PROBABILITY = (
    "Probability: posterior probability among the effects that were tried and a cause outside the catalogue, which is judged by "
    f"what the accepted effects leave. Counted: {COUNTED} (docs/results.md). "
    "p-value: probability that a complete camera shows a difference at least as large."
)


def _named(name: str, entry: Content) -> str:
    numbers = [
        f"{key} = {with_interval(e['value'], e.get('low'), e.get('high'), e.get('unit', ''))}"
        for key, e in (entry.get("parameters") or {}).items()
    ]
    if entry.get("probability") is not None:
        numbers.append(f"probability {probability_text(entry['probability'])} {AMONG}")
    return f"{name} ({'; '.join(numbers)})" if numbers else name
