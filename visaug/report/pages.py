"""The pages of `compare`, with a camera or a target, and `diagnose`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from visaug.core.wording import deviation_text, number, p_text, statistic_text
from visaug.report import headline
from visaug.report.html import Block, Page, Section, Table, Text, figure, footer, next_text, write_page
from visaug.report.next_step import Inputs, after_comparison, after_diagnosis, after_pictures, picture_inputs
from visaug.report.plots.error import plot_error_steps, plot_ranking
from visaug.report.plots.style import blank
from visaug.report.plots.view import plot_used
from visaug.report.views import ViewGallery, all_views

if TYPE_CHECKING:
    from visaug.camera import Camera
    from visaug.diagnosis import Diagnosis
    from visaug.diagnosis.comparison import Comparison
    from visaug.frames import FrameSet
    from visaug.pictures.comparison import PictureComparison

ERROR = "Error: 1 is the camera file as given, 0 is as good as a second camera of the same type."


def write_comparison(
    path: str | Path,
    result: "Comparison",
    camera: "Camera",
    frames: "FrameSet",
    seed: int = 0,
    inputs: Inputs | None = None,
) -> dict[str, Path]:
    """Whether the model holds, where it fails, and every view measured beside modelled.

    Args:
        inputs: the files for the next command; None takes those that camera and frames were loaded from.

    Returns:
        The file of each view's picture, in a folder beside the page.
    """
    content = result.to_json()
    gallery = ViewGallery(frames, camera, seed)
    worst = list(dict.fromkeys(place["view"] for place in content["where"]))
    others = [name for name in all_views() if name not in worst]
    fits = content["fits"]
    captions = headline.where_captions(content["where"])
    pictures = gallery.pictures([*worst, *others], captions, _worst_frames(content["where"]))

    def drawn(names: list[str]) -> list[Block]:
        return [pictures[name] for name in names if name in pictures]

    blocks: list[Block] = [Text(headline.comparison_headline(content), "finding")]
    blocks.append(next_text(after_comparison(content, inputs or Inputs.of(camera, frames))))
    if content["where"]:
        blocks += [*drawn(worst[:1]), where_table(content["where"])]
    sections = [
        Section("Where it fails" if content["where"] else "Answer", blocks),
        Section("These views differ", drawn(worst[1:])),
        Section("The other views" if worst else "Views", drawn(others)),
        used_section(content),
    ]
    facts = [
        ("yes" if fits["adequate_before"] else "no", "does the camera explain the frames?"),
        (p_text(fits["p_value_before"]), "probability of such a difference by chance"),
    ]
    for w in content["where"][:1]:
        size = f"{deviation_text(abs(w['z']))} standard deviations"
        facts.append((size, f"largest difference: {statistic_text(w['worst'])}"))
    page = Page(
        "Model and measurement",
        f"{described(frames)} beside the same frames simulated with {camera.name}.",
        [section for section in sections if section.blocks],
        facts=facts,
        footer=footer(camera, frames, seed),
    )
    folder = _pictures_folder(write_page(path, page))
    return {name: picture.save(folder / name) for name, picture in pictures.items()}


def possible_pictures(path: Path) -> list[Path]:
    """The files that `write_comparison` may write beside its page."""
    folder = _pictures_folder(path)
    return [folder / f"{name}{suffix}" for name in all_views() for suffix in (".svg", ".png")]


def _pictures_folder(path: Path) -> Path:
    return path.with_name(f"{path.stem}_pictures")


def write_picture_comparison(path: str | Path, result: "PictureComparison") -> Path:
    """Whether the cameras of two sets of pictures differ, and in what."""
    content = result.to_json()
    rows = []
    for d in content["differences"]:
        sizes = number(d["measured"]), number(d["modelled"]), d["unit"], deviation_text(d["z"])
        rows.append([headline.view_title(d["view"]), d["statistic"], *sizes])
    drawn = blank(6.5, 3.6)
    axes = drawn.subplots()
    for (name, c), marker in zip(result.curves.items(), "os", strict=True):
        look = {"fmt": marker, "ms": 4, "capsize": 2, "label": "target" if name == "target" else "other set"}
        axes.errorbar(c["level_dn"], c["noise_dn"], 1.96 * c["error_dn"], **look)
    axes.set(xlabel="level (1/255 of full scale)", ylabel="noise (1/255 of full scale)")
    axes.legend(frameon=False)
    head = ["view", "statistic", "target", "other set", "unit", "standard deviations"]
    caption = "Largest differences first. How bright the scenes are and how much sky they show do not enter."
    blocks: list[Block] = [
        Text(headline.comparison_headline(content), "finding"),
        next_text(after_pictures(content, picture_inputs(result))),
        figure(drawn, "Noise of flat regions against their level, both sets. Bars are 95 %."),
        Table(head, rows, caption=caption),
        *(Text(warning, "note") for warning in content["warnings"]),
    ]
    lead = f"{result.pictures[0]} pictures beside {result.pictures[1]} of the target."
    page = Page("Pictures and target", lead, [Section("Answer", blocks)], footer=footer(None, result.target))
    return write_page(path, page)


def used_section(content: dict[str, Any]) -> Section:
    """Which frames and pixels were used, and what of the set spoils which effects."""
    used = content.get("used")
    blocks: list[Block] = [Text(warning, "note") for warning in content.get("warnings", ())]
    if used:
        blocks.insert(0, Text(f"Used: {used['description']}."))
        if used["windows"] != [used["frame"]]:
            caption = "The sensor, and the window in which temporal noise is measured."
            blocks.append(figure(plot_used(used), caption, wide=False))
    return Section("Frames used", blocks)


def write_diagnosis(
    path: str | Path,
    result: "Diagnosis",
    camera: "Camera",
    frames: "FrameSet",
    seed: int = 0,
    inputs: Inputs | None = None,
) -> Path:
    """The missing effects, the error after each step, the views before and after, and the remaining residuals.

    Args:
        inputs: the files for the next command; None takes those that camera and frames were loaded from.
    """
    content = result.to_json()
    page = Page(
        "Diagnosis",
        f"{described(frames)} against {camera.name}: which physical effect does the model lack?",
        diagnosis_sections(content, camera, result.camera, frames, seed, inputs),
        facts=headline.diagnosis_facts(content),
        footer=footer(camera, frames, seed),
    )
    return write_page(path, page)


def diagnosis_sections(
    content: dict[str, Any],
    camera: "Camera",
    better: "Camera",
    frames: "FrameSet",
    seed: int = 0,
    inputs: Inputs | None = None,
) -> list[Section]:
    """The sections of a diagnosis, also part of the demo's page."""
    error = content["error"]
    found: list[Block] = [Text(headline.diagnosis_headline(content), "finding")]
    found += [Text(line) for line in headline.effect_texts(content["accepted"])]
    found += [Text(line) for line in headline.diagnosis_details(content)]
    if content["accepted"]:
        found.append(Text(headline.PROBABILITY, "note"))
    found.append(next_text(after_diagnosis(content, inputs or Inputs.of(camera, frames))))
    if any(step["error"] is not None for step in content["steps"]):
        steps = plot_error_steps(content["steps"], error["before"], error["floor"])
        found.append(figure(steps, f"The error on hold-out frames after each step. {ERROR}"))
    if content["accepted"]:
        found.append(_accepted_table(content))
    sections = [Section("What is missing", found)]
    if views := list(dict.fromkeys(place["view"] for place in content["where"]))[:4]:
        gallery = ViewGallery(frames, camera, seed, better if content["accepted"] else None)
        worst = _worst_frames(content["where"])
        pictures = list(gallery.pictures(views, headline.where_captions(content["where"]), worst).values())
        sections.append(Section("Evidence", [*pictures[:1], where_table(content["where"]), *pictures[1:]]))
    if any(entry["error_after"] is not None for entry in content["ranking"]):
        caption = "How much of the misfit each effect alone explains."
        sections.append(Section("Ranking", [figure(plot_ranking(content["ranking"]), caption)]))
    if content["unexplained"]:
        left = Text(content["unexplained"]["description"], "finding")
        model = Text("visaug effects new NAME writes a file in which you can model it.", "note")
        sections.append(Section("What is left", [left, model]))
    if content.get("effects"):
        strength, frames_for = "strength [95 % interval] or limit", "frames that would show or separate it"
        head = ["effect", "verdict", strength, frames_for]
        rows = headline.verdict_rows(content["effects"])
        table = Table(head, rows, caption="Of each effect, what these frames show. Limits are those of 95 %.")
        sections.append(Section("What these frames show, and what they cannot", [table]))
    looked_at = used_section(content)
    return [*sections, looked_at] if looked_at.blocks else sections


def unit_text(unit: str) -> str:
    return "" if unit == "1" else unit


def _worst_frames(where: list[dict[str, Any]]) -> dict[str, str]:
    """The worst statistic of each view, whose frames its picture shows first."""
    return {w["view"]: str(w["worst"]) for w in reversed(where)}


def where_table(where: list[dict[str, Any]]) -> Table:
    caption = "Where the model as given and the frames differ, the largest share first."
    return Table(headline.WHERE_HEAD, headline.where_rows(where), caption)


def _accepted_table(content: dict[str, Any]) -> Table:
    parameters = {entry["effect"]: entry.get("parameters") or {} for entry in content["ranking"]}
    fitted = [(name, key, e) for name in content["accepted"] for key, e in parameters.get(name, {}).items()]
    rows = [[name, key, headline.entry_text(e, ""), unit_text(e.get("unit", ""))] for name, key, e in fitted]
    return Table(["effect", "parameter", "value [95 % interval]", "unit"], rows, caption="Fitted parameters.")


def described(frames: "FrameSet") -> str:
    """Numbers of frames of each kind, as text."""
    kinds = [record.kind for record in frames.records]
    if frames.is_pictures:
        return f"{len(kinds)} pictures"
    return ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)) + " frames"
