"""The page of `characterize`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from visaug.report.headline import characterization_headline, entry_text
from visaug.report.html import Block, Page, Section, Table, Text, figure, footer, next_text, write_page
from visaug.report.next_step import Inputs, after_characterization
from visaug.report.pages import described, unit_text

if TYPE_CHECKING:
    from visaug.camera import Camera
    from visaug.characterization import Characterization
    from visaug.frames import FrameSet

FACTS = (("gain_e_per_dn", "gain"), ("read_noise.sigma_e", "read noise"),
         ("quantum_efficiency", "quantum efficiency"), ("emva.saturation_e", "saturation"))  # fmt: skip


def write_characterization(
    path: str | Path,
    result: "Characterization",
    frames: "FrameSet",
    camera_file: Path | None = None,
    camera: "Camera | None" = None,
) -> Path:
    """Parameters with intervals, what stays open, and a plot of each measurement.

    Args:
        camera_file: where the measured camera was written.
        camera: that was given beside the frames.
    """
    content = result.to_json()
    known = content["parameters"]
    pictured = frames.is_pictures
    inputs = replace(Inputs.of(camera, frames, camera_file), transfer=result.transfer or "linear")
    plots = result.plots().items()
    pictures = [figure(drawn, CAPTIONS[name], wide=drawn.get_figwidth() > 8) for name, drawn in plots]
    found: list[Block] = []
    if headline := characterization_headline(content, camera_file.name if camera_file else None):
        found.append(Text(headline, "finding"))
    if not pictured or "gain_e_per_dn" in known:  # else there is no camera to write
        step = after_characterization(inputs, pictured, result.has_gain, result.base is not None)
        found.append(next_text(step))
    tables = _parameter_tables(known)
    blocks: list[Block] = [*tables[:1]]
    if rows := [[entry["parameter"], entry["needs"]] for entry in content["not_determined"]]:
        blocks.append(Table(["not determined", "needs"], rows, caption="Not determined by these frames."))
    blocks += [Text(warning, "note") for warning in content["warnings"]]
    if rows := [[name, e["assumes"]] for name, e in known.items() if "assumes" in e]:
        blocks.append(Table(["parameter", "assumes"], rows, caption="What the figures assume."))
    sections = [
        Section("What was found", [*found, *pictures[:2]]),
        Section("Parameters", blocks),
        Section("Measurements", pictures[2:]),
        Section("EMVA 1288", tables[1:]),
    ]
    page = Page(
        "Camera characterization",
        f"What {described(frames)} tell of the camera that took them. Every interval is 95 %.",
        [section for section in sections if section.blocks],
        facts=[(entry_text(known[key]), name) for key, name in FACTS if key in known],
        footer=footer(None, frames),
    )
    return write_page(path, page)


def _parameter_tables(parameters: dict[str, dict[str, Any]]) -> list[Table]:
    """One table for the camera file, one for each release of the standard."""
    groups = {
        "": "Parameters in the camera file, and further measurements.",
        "emva": "EMVA 1288, release 3.",
        "emva4": "EMVA 1288, release 4.",
        "emva4_corrected": "EMVA 1288, release 4, corrected for noise that the pixels of a row or column share.",
    }
    rows: dict[str, list[list[str]]] = {group: [] for group in groups}
    for name, e in parameters.items():
        group = name.split(".")[0] if name.split(".")[0] in groups else ""
        rows[group].append([name, entry_text(e, ""), unit_text(e["unit"]), e["from"]])
    tables = []
    for group, caption in groups.items():
        head, shown = ["parameter", "value [95 % interval]", "unit", "from"], rows[group]
        # where the caption says the source already
        if all(row[-1].lower() in caption.replace(",", "").lower() for row in shown):
            head, shown = head[:-1], [row[:-1] for row in shown]
        tables += [Table(head, shown, caption)] if shown else []
    return tables


CAPTIONS = {
    "photon_transfer": "Photon transfer: temporal variance against the mean; its slope is the gain.",
    "linearity": "Linearity: how far the response departs from a straight line.",
    "read_noise": "Read noise: distribution of the dark temporal noise, and the Tukey-lambda that fits it.",
    "dark_current": "Dark current against temperature.",
    "nonuniformity": "Fixed pattern of the mean bias frame: means of its rows and columns, and their power spectra.",
    "gain_law": "Gain against its setting in dB.",
    "noise_level": "Noise-level function: noise of flat regions of ordinary pictures against their level.",
}
