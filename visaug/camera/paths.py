"""Parameters of a camera by their dotted path, as in camera.yaml: `gain_db`, `read_noise.sigma_e`."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from visaug.effects import Effect, Parameter, catalogue
from visaug.effects.effect import CONDITIONS

if TYPE_CHECKING:
    from visaug.camera.spec import CameraSpec

TOP_LEVEL = {
    "quantum_efficiency": ("quantum_efficiency", "value"),
    "gain_e_per_dn": ("system_gain", "gain_e_per_dn"),
    "gain_db": ("system_gain", "gain_db"),
    "black_level_dn": ("system_gain", "black_level_dn"),
    "full_well_e": ("saturation", "full_well_e"),
}
PARTS = ("read_noise", "dark_current", "prnu", "dsnu")


@dataclass(frozen=True)
class ResolvedPath:
    """Which effect and parameter a path means."""

    effect: type[Effect] | None
    parameter: Parameter


def path_of(effect: str, parameter: str) -> str:
    """The camera file's path of an effect's parameter."""
    for path, place in TOP_LEVEL.items():
        if place == (effect, parameter):
            return path
    return f"{effect}.{parameter}"


def place_of(path: str) -> ResolvedPath:
    """The effect and parameter behind a path; KeyError where there is none."""
    if path in ("exposure_s", "temperature_c"):
        return ResolvedPath(None, CONDITIONS[path])
    effect, _, parameter = path.partition(".")
    effect, parameter = TOP_LEVEL.get(path, (effect, parameter))
    known = catalogue()[effect]
    return ResolvedPath(known, known.parameters[parameter])


def numeric_values(spec: "CameraSpec") -> dict[str, float]:
    """Every number of a camera that can be randomised, fitted or differentiated, by path."""
    values = {name: getattr(spec, name) for name in (*TOP_LEVEL, "exposure_s", "temperature_c")}
    if values["full_well_e"] is None:
        values["full_well_e"] = float("inf")
    for part in PARTS:
        for key, value in getattr(spec, part).model_dump().items():
            if isinstance(value, float):
                values[f"{part}.{key}"] = value
    for entry in spec.effects:
        for key, parameter in catalogue()[entry["name"]].parameters.items():
            if not parameter.options:
                values[f"{entry['name']}.{key}"] = float(entry.get(key, parameter.default))
    return values


def words(spec: "CameraSpec") -> dict[str, str]:
    """All options of a camera by path."""
    chosen: dict[str, str] = {"read_noise.meaning": spec.read_noise.meaning}
    for entry in spec.effects:
        for key, parameter in catalogue()[entry["name"]].parameters.items():
            if parameter.options:
                chosen[f"{entry['name']}.{key}"] = entry.get(key, parameter.default)
    return chosen
