"""The answer of a result in one sentence, what it means, and verdicts on effects: the same on pages, terminal and lab."""

from collections.abc import Mapping, Sequence
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
    `written`: the camera file that holds it.
    """
    if not content.get("effects"):
        return None
    named = [_measured(effect, content["parameters"]) for effect in content["effects"]]
    where = f"written to {written}" if written else "-o camera.yaml writes it"
    return f"This camera also has {' and '.join(named)}: {where}."


def _measured(effect: Content, parameters: Content) -> str:
    """An effect by name and numbers, with the interval of those that were measured as a parameter of temporal noise."""
    said = []
    temporal = [e for key, e in parameters.items() if key.startswith("temporal.")]
    for key, value in effect.items():
        if key == "name":
            continue
        if isinstance(value, str):
            said.append(f"{key} {value}")
            continue
        e = next((e for e in temporal if isclose(e["value"], value, rel_tol=1e-3)), None)
        number = entry_text(e) if e else f"{value:.3g}"
        said.append(number if key == "sigma_e" and e else f"{key} {number}")
    return ", ".join([effect["name"].replace("_", " "), *said])


def entry_text(entry: Content, unit: str | None = None) -> str:
    """A value of a result's JSON with its interval; `unit` takes the place of its own."""
    unit = entry.get("unit", "") if unit is None else unit
    return with_interval(entry["value"], entry.get("low"), entry.get("high"), unit)


def view_title(name: str) -> str:
    """The plain name of a view."""
    from visaug.statistics import VIEWS

    titles = {view.name: view.title for view in VIEWS}
    return titles.get(name, name.replace("_", " ").capitalize()).rstrip(".")


MUCH_LEFT = 0.5  # error with the added effects, of 1 without, above which they do not explain the frames
WHERE_HEAD = ["view", "share of the misfit", "worst statistic", "standard deviations"]


def where_rows(where: list[dict[str, Any]]) -> list[list[str]]:
    """Where model and frames differ, the ten largest shares, under `WHERE_HEAD`."""
    texts = {"view": view_title, "share": share_text, "worst": statistic_text, "z": deviation_text}
    return [[text(w[key]) for key, text in texts.items()] for w in where[:10]]


def where_captions(where: list[dict[str, Any]]) -> dict[str, str]:
    """The worst statistic of each view as a caption."""
    return {
        w["view"]: f"{share_text(w['share'])} of the misfit; {statistic_text(w['worst'])}: "
        f"{deviation_text(w['z'])} standard deviations from the model."
        for w in reversed(where)
    }


def comparison_headline(content: Content) -> str:
    """Whether the camera file explains the frames and, if not, where they differ most."""
    fits = content["fits"]
    p = p_text(fits["p_value_before"])
    of_pictures = "target" in content.get("pictures", ())
    if fits["adequate_before"]:
        if of_pictures:
            return f"The two sets agree: no difference of their cameras beyond chance ({p})."
        return f"The model holds: nothing differs beyond chance ({p})."
    said = f"The {'cameras of the two sets differ' if of_pictures else 'model does not hold: the frames differ from it'} ({p})."
    if not content["where"]:
        return said
    worst = content["where"][0]
    is_more = worst["z"] > 0
    size = f"{deviation_text(abs(worst['z']))} standard deviations"
    if of_pictures:
        side = "more" if is_more else "less"
        return f"{said} The largest difference: {worst['worst']}; the target has {side} ({size})."
    view, side = view_title(worst["view"]), "above" if is_more else "below"
    what = f"{view[0].lower()}{view[1:]} ({statistic_text(worst['worst'])})"
    return f"{said} The largest difference: {what}, {size} {side} the model."


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
        after = with_interval(error["after"], low, high)
        lines.append(
            f"Error on hold-out frames: {error['before']:.2g} with the camera file, {after} "
            "with the added effects. 0 is as good as a second camera of the same type."
        )
    if content["accepted"]:
        p, (low, _) = p_text(fits["p_value_after"]), error["interval_after"] or (0.0, 0.0)
        if not fits["adequate_after"]:
            lines.append(f"After adding, a significant difference is left ({p}).")
        elif low > MUCH_LEFT:
            lines.append(
                f"After adding, no single deviation is significant ({p}), as cameras with it can deviate far, but most of the "
                "error stays: it is not shown to be the cause."
            )
        else:
            lines.append(f"After adding, no significant difference is left ({p}).")
    if (outside := content.get("outside") or 0.0) > 0.5:
        lines.append(
            f"What is left makes a cause outside the catalogue likelier (probability {probability_text(outside)}): "
            "what is named resembles it, or explains a small part of it by chance."
        )
    for group in content["ambiguous"]:
        advice = f"To separate them: {group['measure']}."
        lines.append(f"These frames cannot tell apart: {', '.join(group['effects'])}. {advice}")
    if content.get("form"):
        lines.append(content["form"])
    if content["unexplained"] and content["accepted"]:
        lines.append(f"Unexplained: {content['unexplained']['description']}")
    if (part := (content["unexplained"] or {}).get("component")) is not None:
        lines.append(_component(part))
    return lines


def diagnosis_facts(content: Content) -> list[tuple[str, str]]:
    """The effects, their strengths, and the error in a few facts: value, and what it is."""
    error = content["error"]
    known = {entry["effect"]: entry for entry in content["ranking"]}
    facts = [(", ".join(content["accepted"]) or "nothing", "missing effect")]
    for name in content["accepted"][:2]:
        entry = known.get(name, {})
        for key, e in list((entry.get("parameters") or {}).items())[:1]:
            facts.append((entry_text(e), f"{name}: {key}, 95 % interval"))
        if entry.get("probability") is not None:
            facts.append((probability_text(entry["probability"]), f"probability of {name} {AMONG}"))
    if error["before"] is not None:
        low, high = error["interval_after"] or (None, None)
        after = with_interval(error["after"], low, high)
        facts.append((f"{error['before']:.2g} → {after}", "error before and after"))
    return facts


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

    known, texts = catalogue(), []
    for name in names:
        if effect := known.get(name):
            law = f" Law: {effect.equation}." if effect.equation else ""
            source = f" Source: {effect.source}." if effect.source else ""
            texts.append(f"{name}: {effect.summary}{law}{source} More: visaug effects {name}")
    return texts


AMONG = "among the effects that were tried and a cause outside the catalogue"
COUNTED = (
    "of 369 names with a probability above 0.5 in 592 sets, 52 of them with a cause outside the catalogue, 340 were "
    "right"
)  # a sentence of docs/results.md
PROBABILITY = (
    f"Probability: posterior probability {AMONG}, which is judged by "
    f"what the accepted effects leave. Counted: {COUNTED} (docs/results.md). "
    "p-value: probability that a complete camera shows a difference at least as large."
)


def _named(name: str, entry: Content) -> str:
    numbers = [f"{key} = {entry_text(e)}" for key, e in (entry.get("parameters") or {}).items()]
    if entry.get("probability") is not None:
        numbers.append(f"probability {probability_text(entry['probability'])} {AMONG}")
    return f"{name} ({'; '.join(numbers)})" if numbers else name


def amount(value: float | None, unit: str | None) -> str:
    return "" if value is None else f"{value:.3g} {'' if unit in (None, '1') else unit}".strip()


def verdict_rows(effects: Sequence[Content]) -> list[list[str]]:
    """The rows of `effects`: named ones first, then what these frames do not tell, and absent ones last."""
    order = ("named", "not separable", "not testable", "absent")
    return [verdict_row(entry) for entry in sorted(effects, key=lambda one: order.index(one["verdict"]))]


def verdict_row(entry: Content) -> list[str]:
    """Effect, verdict, strength or limit, and frames that would tell, of one entry of `effects`."""
    unit, key = entry["unit"], (entry["parameter"] or "").rsplit(".", 1)[-1]
    if entry["verdict"] == "named":
        strength = f"{key} = {amount(entry['value'], unit)}"
        if entry["low"] is not None:
            strength += f" [{entry['low']:.3g}, {entry['high']:.3g}]"
    elif entry["limit"] is None:
        strength = ""
    else:
        falls = entry["parameter"] in ("read_noise.shape", "full_well_e")  # an effect makes these smaller
        sign = (">" if falls else "<") if entry["verdict"] == "absent" else "shown from"
        strength = f"{key} {sign} {amount(entry['limit'], unit)}"
    word = entry["verdict"]
    if entry["from"]:
        word += f" from {', '.join(entry['from'])}"
    return [entry["effect"], word, strength, "; ".join(entry["frames"] or [])]


def planned_text(entry: Content) -> str:
    """What a plan of frames would show of an effect."""
    key = (entry["parameter"] or "").rsplit(".", 1)[-1]
    if entry["verdict"] == "not testable":
        return f"{entry['effect']}: not testable by any frames of the plan at the strengths that a diagnosis tries"
    text = f"{entry['effect']}: shown from {key} = {amount(entry['limit'], entry['unit'])}"
    if entry["frames"]:
        text += f", at the least by {entry['frames'][0]}"
    if entry["from"]:
        text += f"; not separable from {', '.join(entry['from'])} by these frames"
    return text
