"""The content of a camera file from what a characterization found."""

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from visaug.core.errors import InputError
from visaug.effects.readout.read_noise import LEAST_SHAPE

if TYPE_CHECKING:
    from visaug.characterization.result import Characterization

CAMERA_KEYS = (
    "bit_depth", "quantum_efficiency", "gain_e_per_dn", "gain_db", "black_level_dn", "full_well_e", "exposure_s",
    "temperature_c", "read_noise.sigma_e", "read_noise.shape", "dark_current.a_e_per_s", "dark_current.b_per_c",
    "prnu.column", "prnu.row", "prnu.pixel", "dsnu.column_e", "dsnu.row_e", "dsnu.pixel_e",
)  # fmt: skip
_NEEDED = tuple(k for k in CAMERA_KEYS if k != "full_well_e")
_SETTINGS = ("bit_depth", "gain_db", "exposure_s", "temperature_c")


def camera_content(result: "Characterization") -> dict[str, Any]:
    """The content of a camera.yaml with what was measured, and what was assumed where nothing was.

    Raises:
        InputError: the gain is neither measured nor given, so nothing can be said in electrons.
    """
    found = {**result.assumed, **{k: e.value for k, e in result.parameters.items() if k in CAMERA_KEYS}}
    found = {k: v for k, v in found.items() if k not in result.left_out}
    if not result.has_gain:
        raise InputError(
            "the frames do not tell the gain, so there is no camera in electrons",
            field="gain_e_per_dn",
            expected=result.not_determined.get("gain_e_per_dn", "flats at several levels")
            + ("" if result.method == "pictures" else ", or a camera that gives the gain"),
        )
    fresh = {"name": "characterized camera", "resolution": list(result.resolution or (1, 1))}
    content: dict[str, Any] = copy.deepcopy(dict(result.base or fresh))
    _put(content, found)
    effects = _effects(content, result)
    if effects:
        content["effects"] = effects
    assumed = _assumptions(result, found)
    if assumed:
        content["assumed"] = assumed
    if result.method == "pictures":
        measured = {k: e for k, e in result.parameters.items() if not k.startswith("image.")}
        content["source"] = {k: e.source for k, e in measured.items()}
    return content


def _put(content: dict[str, Any], found: Mapping[str, float]) -> None:
    """Write values into the parts of the file that their keys name."""
    for key in (k for k in CAMERA_KEYS if k in found):
        part, _, name = key.partition(".")
        value = int(found[key]) if key == "bit_depth" else float(f"{found[key]:.6g}")
        if key == "black_level_dn":  # of frames cut at 0 it may lie below 0, which a file cannot hold
            value = max(value, 0.0)
        if name:
            content.setdefault(part, {})[name] = value
        else:
            content[key] = value
    shape = content.get("read_noise", {}).get("shape")
    if shape is not None:
        content["read_noise"]["shape"] = max(shape, LEAST_SHAPE)


def _effects(content: Mapping[str, Any], result: "Characterization") -> list[dict[str, Any]]:
    """Effects of the camera given, with the values of those that were measured."""
    effects = {e["name"]: e for e in content.get("effects", [])}
    for effect in result.effects:
        rounded = {k: v if isinstance(v, str) else float(f"{v:.4g}") for k, v in effect.items()}
        effects[effect["name"]] = effects.get(effect["name"], {}) | rounded
    return list(effects.values())


def _assumptions(result: "Characterization", found: Mapping[str, float]) -> list[str]:
    """Paths of the camera file that nothing measured: taken from elsewhere, or left at their default."""
    paths = [k for k in result.assumed if k not in result.parameters and k not in _SETTINGS]
    paths += [k for k in _NEEDED if k not in found and result.base is None]
    paths += list(result.not_measured)
    paths += [k for w in result.warning_details if w.word == "bit_depth_assumed" for k in w.spoils]
    return list(dict.fromkeys(paths))
