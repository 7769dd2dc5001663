"""What the page says, in words and plain values, from the current camera."""

import math
from collections.abc import Mapping
from dataclasses import astuple
from typing import Any

from visaug.app.lab.bench import Bench, summary
from visaug.camera.paths import place_of
from visaug.characterization.alarms import all_warnings
from visaug.core.wording import number, p_text, share_text, statistic_text, with_interval
from visaug.diagnosis import Diagnosis, FittedValue
from visaug.effects import Parameter
from visaug.report.headline import diagnosis_headline, verdict_rows, view_title
from visaug.report.next_step import PICTURES, NextStep, after_comparison, after_diagnosis
from visaug.report.pages import described, unit_text
from visaug.statistics import VIEWS
from visaug.statistics.places import Place


def content(bench: Bench, wanted: Mapping[str, float]) -> dict[str, Any]:
    """Everything that changes on the page; `wanted`: numbers set by hand that no estimate has taken up yet."""
    views = _views(bench)
    candidates = _candidates(bench)
    effects, rows = _effects(bench), _numbers(bench, wanted)
    for effect in effects:
        effect["fields"] = [row for row in rows if row["path"].startswith(f"{effect['name']}.")]
    own = {effect["name"] for effect in effects}
    selection = bench.session.fits.lab.selection
    listed = {entry["name"] for entry in candidates}
    first = 4  # views that are shown before the others
    return {
        "camera": bench.given.name,
        "frames": described(bench.frames),
        "part": None if selection.is_all else str(selection),  # what of a large set is looked at
        "warnings": list(all_warnings(bench.frames)),
        "output": str(bench.output) if bench.output else None,
        "error": _error(bench),
        "verdict": verdict(bench),
        "notes": _notes(bench),
        "next": next_step(bench),
        "compared": bench.comparison is not None,
        "diagnosed": bench.diagnosis is not None,
        "changed": bench.now.fit is not None,
        "effects": effects,
        "candidates": candidates,
        "verdicts": verdict_rows([v.to_json() for v in bench.diagnosis.effects]) if bench.diagnosis else [],
        "addable": [name for name in bench.can_add() if name not in listed],
        "where": [_place(place) for place in _places(bench)],
        "views": views[:first],
        "other_views": views[first:],
        "numbers": [row for row in rows if row["path"].split(".")[0] not in own],
        "history": [action for action, _ in bench.past.entries],
        "at": bench.past.at,
        "own": bench.own_picture,
    }


def verdict(bench: Bench) -> str:
    """Whether the current camera explains the frames, and what is missing, in a few sentences."""
    fit = bench.now.fit
    if fit and bench.now.quick:
        estimate = "its error is estimated from a few simulated sets; the full estimate follows"
        return f"{_changes(bench)}: {estimate}."
    if fit:
        said = _judged(_changes(bench), fit.adequate, fit.p_value, fit.where)
        error = fit.error if bench.has_excess else None
        return f"{said} Its error is {with_interval(*astuple(error))}." if error else said
    if bench.diagnosis:
        return _diagnosed(bench.diagnosis)
    if c := bench.comparison:
        said = _judged("The camera as given", c.adequate, c.p_value, c.where)
        return said if c.adequate else f"{said} Diagnose finds out which effect is missing."
    return "The same frames are being simulated with this camera, many times over, to compare them with the measured ones."


def next_step(bench: Bench) -> NextStep | None:
    """What to do next with the current camera, on this page or in a terminal."""
    inputs = bench.inputs()
    if bench.comparison is None:
        return None
    if bench.now.fit:
        line = inputs.augmenting(inputs.better or "camera.yaml")
        return NextStep(f"Next: Save camera, then train with it. {PICTURES}", line)
    if bench.diagnosis and not bench.diagnosis.accepted:
        return after_diagnosis(bench.diagnosis.to_json(), inputs)
    if bench.diagnosis:
        names = " and ".join(f"Add {name}" for name in bench.diagnosis.accepted)
        text = f"Next: {names}, then Save camera. The current camera is still the file as given."
        return NextStep(text, "")
    step = after_comparison(bench.comparison.to_json(), inputs)
    if not bench.comparison.adequate:
        step = step._replace(text="Next: Diagnose. The same in a terminal:")
    return step


def _diagnosed(found: Diagnosis) -> str:
    said = diagnosis_headline(found.to_json())
    if not found.accepted or found.error_after is None:
        return said
    left = f"{'No' if found.adequate_after else 'A'} significant difference is left."
    return f"{said} Adding it takes the error on hold-out frames from 1 to {with_interval(*astuple(found.error_after))}. {left}"


def _judged(subject: str, holds: bool, p: float, places: tuple[Place, ...]) -> str:
    if holds:
        return f"{subject} explains these frames: nothing differs beyond chance ({p_text(p)})."
    worst = [view_title(place.view).lower() for place in places[:2]]
    said = f"{subject} does not explain these frames ({p_text(p)})."
    return f"{said} It differs most in: {'; '.join(worst)}." if worst else said


def _changes(bench: Bench) -> str:
    """The current camera as the subject of a sentence."""
    now = bench.now
    changes = (now.added, "with {}"), (now.without, "without {}"), (now.numbers, "with {} set by hand")
    return f"The camera {' and '.join(how.format(' and '.join(what)) for what, how in changes if what)}"


def _error(bench: Bench) -> dict[str, Any]:
    """The error of the current camera: a number, its interval, and what it means."""

    def shown(text: str, note: str, value: float | None = None, interval: str = "") -> dict[str, Any]:
        return {"text": text, "interval": interval, "value": value, "note": note}

    if bench.comparison is None:
        return shown("…", "not compared yet")
    if not bench.has_excess:
        return shown("–", "the camera as given shows no excess over chance that could be lowered")
    if not bench.now.fit:
        return shown("1.00", "lower is better", 1.0)
    error = bench.now.fit.error
    if error is None:
        return shown("–", "its own spread hides any difference")
    value, interval = min(max(error.value, 0.0), 1.0), f"[{error.low:.2f}, {error.high:.2f}]"
    if bench.now.quick:
        return shown(f"≈ {error.value:.1f}", "a quick estimate", value, interval)
    meaning = "of the camera file's error is left" if error.value < 1 else "no better than the camera file"
    meaning = "as good as a second camera of the same type" if error.low <= 0 else meaning
    return shown(f"{error.value:.2f}", meaning, value, interval)


def _notes(bench: Bench) -> list[str]:
    """What there is to add to the verdict."""
    found, notes = bench.diagnosis, []
    errors = [step.error for step in bench.now.steps[-2:] if step.error]
    noticeable = 0.01  # least reduction of the error that is worth an effect
    if bench.now.added and len(errors) == 2 and errors[1].value > errors[0].value - noticeable:
        notes.append(f"{bench.now.added[-1]} does not lower the error: without it the camera is as close.")
    if not found:
        return notes
    for group in found.ambiguous:
        names = ", ".join(group["effects"])
        notes.append(f"{names} cannot be distinguished with these frames; {group['measure']}.")
    if found.form:
        notes.append(found.form)
    if found.unexplained:
        notes.append(f"Unexplained: {found.unexplained.description}")
    if found.cannot_show:
        notes.append(f"Frames like these could not show {', '.join(found.cannot_show)}.")
    return notes


def _effects(bench: Bench) -> list[dict[str, Any]]:
    """Effects in the current camera that can be taken away, with their numbers."""
    fitted = bench.now.fit.parameters if bench.now.fit else {}
    values = bench.camera.values()
    entries = []
    for name in [name for name in bench.given.effect_names if name not in bench.now.without]:
        own = {path: value for path, value in values.items() if path.startswith(f"{name}.")}
        numbers = [f"{path.split('.', 1)[1]} {number(v)} {_unit(path)}".rstrip() for path, v in own.items()]
        entries.append({"name": name, "from": "in the file", "summary": summary(name), "numbers": numbers})
    for name in bench.now.added:
        numbers = [_said(key, estimate) for key, estimate in fitted.get(name, {}).items()]
        entries.append({"name": name, "from": "added", "summary": summary(name), "numbers": numbers})
    return entries


def _candidates(bench: Bench) -> list[dict[str, Any]]:
    """Ranked effects, then those of the user's own and those taken out of the file."""
    there = {*bench.given.effect_names, *bench.now.added} - {*bench.now.without}
    found = bench.diagnosis
    entries: dict[str, dict[str, Any]] = {}
    for ranked in found.ranking if found else ():
        numbers = [_said(key, estimate) for key, estimate in ranked.parameters.items()]
        entries[ranked.effect] = {
            "probability": ranked.probability,
            "error": None if ranked.error_after is None else f"{ranked.error_after:.2f}",
            "numbers": [*numbers, *(f"{key} {word}" for key, word in ranked.forms.items())],
            "missing": found is not None and ranked.effect in found.accepted,
        }
    for name in (*bench.loaded, *bench.now.without):
        entries.setdefault(name, {"probability": None, "error": None, "numbers": [], "missing": False})
    return [
        {"name": name, "summary": summary(name), "there": name in there} | entry
        for name, entry in entries.items()
    ]


def _said(key: str, estimate: FittedValue) -> str:
    """A number with its interval, where it has one."""
    return f"{key} {with_interval(estimate.value, estimate.low, estimate.high, estimate.unit)}"


def _places(bench: Bench) -> tuple[Place, ...]:
    """Where the current camera fails; nowhere, where it holds."""
    judged = bench.comparison if bench.now.quick else bench.now.fit or bench.comparison
    return judged.where if judged and not judged.adequate else ()


def _place(place: Place) -> dict[str, Any]:
    said = {"percent": share_text(place.share), "worst": statistic_text(place.worst), "z": f"{place.z:.1f}"}
    return {"title": view_title(place.view), "share": place.share, **said}


def _views(bench: Bench) -> list[Mapping[str, str]]:
    """Views, those first in which the file as given fails most: adding an effect does not move the pictures about."""
    worst = [place.view for place in bench.comparison.where] if bench.comparison else []
    names = list(dict.fromkeys([*worst, *(view.name for view in VIEWS)]))
    return [{"name": name, "title": view_title(name)} for name in names]


def _numbers(bench: Bench, wanted: Mapping[str, float]) -> list[dict[str, Any]]:
    """The camera's numbers, each with what an input field and a slider need."""
    before, after = bench.given.values(), bench.camera.values()
    after |= {path: value for path, value in wanted.items() if path in after}
    rows = []
    for path, value in after.items():
        parameter = place_of(path).parameter
        if path == "gain_db" or not math.isfinite(value):
            continue
        low, high = _reach(parameter, before.get(path, value), value)
        given = before.get(path)
        row: dict[str, Any] = {"path": path, "unit": _unit(path), "low": low, "high": high}
        row["value"] = f"{value:.5g}"
        row["least"] = parameter.low if math.isfinite(parameter.low) else ""
        row["most"] = parameter.high if math.isfinite(parameter.high) else None
        row["step"] = float(f"{(high - low) / 400:.1g}")
        row["before"] = number(given)
        row["change"] = f"{value / given - 1:+.1%}" if given and value != given else ""
        row["by_hand"] = path in bench.now.numbers or path in wanted
        rows.append(row)
    return rows


def _reach(parameter: Parameter, given: float, value: float) -> tuple[float, float]:
    """Ends of a slider: wide about the value, within the parameter's bounds."""
    scale = max(abs(given), abs(value)) or max((abs(t) for t in parameter.trials), default=1.0)
    signed = parameter.low < 0 and not parameter.low < -1e3 * scale and given <= 0
    low = max(parameter.low, -2 * scale if signed else 0.0)
    high = min(parameter.high, 1.0 if parameter.unit == "fraction" and scale > 0.4 else 2 * scale)
    return float(f"{low:.4g}"), float(f"{max(high, value):.4g}")


def _unit(path: str) -> str:
    return unit_text(place_of(path).parameter.unit)
