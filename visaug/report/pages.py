"""The pages of `characterize`, `compare` and `diagnose`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from visaug.report.html import Figure, Page, Section, Table, Text, figure, write_page
from visaug.report.plots.error import plot_error_steps, plot_ranking
from visaug.report.views import ViewGallery, all_views

if TYPE_CHECKING:
    from visaug.camera import Camera
    from visaug.characterization import Characterization
    from visaug.comparison import Comparison
    from visaug.diagnosis import Diagnosis
    from visaug.frames import FrameSet

INTERVALS = "Every interval is 95 %."
ERROR = (
    "Error: 1 is the camera file as given, 0 is as close as another set of the accepted camera would come,"
    " maps and drift drawn anew."
)


def write_characterization(path: str | Path, result: "Characterization", frames: "FrameSet") -> Path:
    """Parameters with intervals, what stays open, and a plot of each measurement."""
    content = result.to_json()
    rows = [
        [name, number(e["value"]), f"[{number(e['low'])}, {number(e['high'])}]", e["unit"], e["from"]]
        for name, e in content["parameters"].items()
    ]
    blocks: list[Text | Table | Figure] = [
        Table(["parameter", "value", "95 % interval", "unit", "from"], rows)
    ]
    if content["not_determined"]:
        open_rows = [[entry["parameter"], entry["needs"]] for entry in content["not_determined"]]
        blocks.append(Table(["not determined", "needs"], open_rows, caption="What these frames cannot tell."))
    blocks += [Text(warning, "note") for warning in content["warnings"]]
    pictures = [
        figure(drawn, CAPTIONS.get(name, name.replace("_", " ")), wide=drawn.get_figwidth() > 8)
        for name, drawn in result.plots().items()
    ]
    page = Page(
        "Camera characterization",
        f"What {described(frames)} tell of the camera that took them. {INTERVALS}",
        [Section("Parameters", blocks), Section("Measurements", pictures)],
        facts=_headline(content["parameters"]),
    )
    return write_page(path, page)


def write_comparison(
    path: str | Path, result: "Comparison", camera: "Camera", frames: "FrameSet", seed: int = 0
) -> dict[str, Path]:
    """Whether the model holds, where it fails, and every view measured beside modelled.

    Returns:
        The file of each view's picture, in a folder beside the page.
    """
    content = result.to_json()
    gallery = ViewGallery(frames, camera, seed)
    worst = list(dict.fromkeys(place["view"] for place in content["where"]))
    others = [name for name in all_views() if name not in worst]
    fits = content["fits"]
    verdict = _verdict(fits["adequate_before"], fits["p_value_before"])
    pictures = gallery.pictures([*worst, *others], _captions(content["where"]))
    sections = [
        Section("Where it fails", [Text(verdict, "finding"), where_table(content["where"])]),
        Section("These views differ", [pictures[name] for name in worst if name in pictures]),
        Section("The other views", [pictures[name] for name in others if name in pictures]),
    ]
    page = Page(
        "Model and measurement",
        f"{described(frames)} beside the same frames simulated with {camera.name}.",
        [section for section in sections if section.blocks],
    )
    folder = write_page(path, page).with_suffix("")
    folder = folder.with_name(f"{folder.name}_pictures")
    return {name: picture.save(folder / name) for name, picture in pictures.items()}


def write_diagnosis(
    path: str | Path, result: "Diagnosis", camera: "Camera", frames: "FrameSet", seed: int = 0
) -> Path:
    """What was missing, the error falling, the views before and after, and what is left."""
    content = result.to_json()
    error = content["error"]
    page = Page(
        "Diagnosis",
        f"{described(frames)} against {camera.name}: which physical effect does the model lack?",
        diagnosis_sections(content, camera, result.camera, frames, seed),
        facts=[
            (number(error["before"]), "error before"),
            (number(error["after"]), "error after"),
            (", ".join(content["accepted"]) or "nothing", "accepted"),
            (number(content["fits"]["p_value_after"]), "p value after"),
        ],
    )
    return write_page(path, page)


def diagnosis_sections(
    content: dict[str, Any], camera: "Camera", better: "Camera", frames: "FrameSet", seed: int = 0
) -> list[Section]:
    """The sections of a diagnosis, also part of the demo's page."""
    error = content["error"]
    found: list[Text | Table | Figure] = [Text(finding(content), "finding")]
    if any(step["error"] is not None for step in content["steps"]):
        steps = plot_error_steps(content["steps"], error["before"], error["floor"])
        found.append(figure(steps, f"The error falling, on frames that were not used for finding. {ERROR}"))
    if content["accepted"]:
        found.append(_accepted_table(content))
    sections = [Section("What is missing", found)]
    views = list(dict.fromkeys(place["view"] for place in content["where"]))[:4]
    if views:
        sections.append(
            Section(
                "Before",
                [where_table(content["where"]), *ViewGallery(frames, camera, seed).pictures(views).values()],
            )
        )
        if content["accepted"]:
            sections.append(
                Section("After", list(ViewGallery(frames, better, seed).pictures(views).values()))
            )
    if any(entry["error_after"] is not None for entry in content["ranking"]):
        picture = figure(plot_ranking(content["ranking"]), "What each effect alone would leave of the error.")
        sections.append(Section("Ranking", [picture]))
    left = [
        Text(f"{', '.join(a['effects'])} cannot be told apart here; {a['measure']}")
        for a in content["ambiguous"]
    ]
    if content.get("form"):
        left.append(Text(content["form"]))
    if content["unexplained"]:
        left.append(Text(content["unexplained"]["description"], "finding"))
        left.append(
            Text("If you know what it is, `visaug effects new NAME` writes a file to put it in.", "note")
        )
    if content.get("cannot_show"):
        left.append(
            Text("Frames like these could not show: " + ", ".join(content["cannot_show"]) + ".", "note")
        )
    if left:
        sections.append(Section("What is left", left))
    return sections


def finding(content: dict[str, Any]) -> str:
    """The diagnosis in a sentence or two."""
    error, fits = content["error"], content["fits"]
    if not content["accepted"]:
        if fits["adequate_before"]:
            return "Nothing is missing: the camera as given explains these frames."
        return "No effect of the catalogue was accepted" + (
            ", but what is left is described below."
            if content["unexplained"]
            else "; refitting the camera was enough."
        )
    names = " and ".join(content["accepted"])
    low, high = error["interval_after"] or (None, None)
    left = (
        "and nothing significant is left"
        if fits["adequate_after"]
        else "and something is left that is described below"
    )
    return (
        f"The model lacked {names}. Adding it takes the error from {number(error['before'])} to "
        f"{number(error['after'])} [{number(low)}, {number(high)}] on frames that were not used for "
        f"finding it, {left}."
    )


def where_table(where: list[dict[str, Any]], most: int = 10) -> Table:
    rows = [
        [w["view"].replace("_", " "), f"{w['share']:.0%}", str(w["worst"]), number(w["z"])]
        for w in where[:most]
    ]
    head = ["view", "share of the misfit", "worst statistic", "standard deviations"]
    return Table(
        head, rows, caption="Where the model as given and the frames differ, the largest share first."
    )


def _accepted_table(content: dict[str, Any]) -> Table:
    parameters = {entry["effect"]: entry.get("parameters") or {} for entry in content["ranking"]}
    rows = [
        [effect, key, number(e["value"]), f"[{number(e.get('low'))}, {number(e.get('high'))}]"]
        for effect in content["accepted"]
        for key, e in parameters.get(effect, {}).items()
    ]
    return Table(["effect", "parameter", "value", "95 % interval"], rows, caption="How strong it is.")


def _verdict(adequate: bool | None, p_value: float | None) -> str:
    says = "holds: nothing differs beyond chance" if adequate else "does not hold"
    return f"The model {says} (p = {number(p_value)})."


def _captions(where: list[dict[str, Any]]) -> dict[str, str]:
    return {
        w[
            "view"
        ]: f"{w['share']:.0%} of the misfit; {w['worst']} is off by {number(w['z'])} standard deviations."
        for w in reversed(where)
    }


def _headline(parameters: dict[str, dict[str, Any]]) -> list[tuple[str, str]]:
    wanted = {
        "gain_e_per_dn": "gain",
        "read_noise.sigma_e": "read noise",
        "quantum_efficiency": "quantum efficiency",
        "emva.saturation_e": "saturation",
    }
    found = [(parameters[key], name) for key, name in wanted.items() if key in parameters]
    return [(f"{number(entry['value'])} {entry['unit']}".removesuffix(" 1"), name) for entry, name in found]


CAPTIONS = {
    "photon_transfer": "Photon transfer: temporal variance against the mean; its slope is the gain.",
    "linearity": "Linearity: how far the response departs from a straight line.",
    "read_noise": "Read noise: distribution of the dark temporal noise, and the Tukey-lambda that fits it.",
    "dark_current": "Dark current: dark signal against exposure and temperature.",
    "nonuniformity": "Nonuniformity: fixed patterns in the dark and in light.",
    "gain_law": "Gain against its setting in dB.",
    "noise_level": "Noise-level function: noise of flat regions of ordinary pictures against their level.",
}


def described(frames: "FrameSet") -> str:
    """How many frames of which kind, in words."""
    kinds = [record.kind for record in frames.records]
    return ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)) + " frames"


def number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
