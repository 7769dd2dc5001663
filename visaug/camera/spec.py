"""Schema of camera.yaml; unknown keys and impossible values are refused with the key's path."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from visaug.core.constants import ZERO_C_K
from visaug.core.documents import read_yaml
from visaug.core.errors import InputError
from visaug.core.nearest import did_you_mean
from visaug.effects import Parameter, catalogue
from visaug.effects.parameter import bounds_text, check_value, plain
from visaug.effects.readout.read_noise import LEAST_SHAPE

MOST_PIXELS = 65535  # of a sensor's rows, and of its columns


class _Part(BaseModel):
    # frozen: a camera works its numbers out once
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


Gain = Annotated[float, Field(gt=0, le=100)]
Element = Annotated[float, Field(ge=-100, le=100)]
Row = tuple[Element, Element, Element]


class ReadNoiseSpec(_Part):
    """Read noise: standard deviation, Tukey-lambda shape, and the part after the gain stage."""

    sigma_e: float = Field(0.0, ge=0, le=1e4)
    shape: float = Field(0.14, ge=LEAST_SHAPE, le=1)
    after_gain_dn: float = Field(0.0, ge=0, le=65535)
    meaning: Literal["standard_deviation", "scale"] = "standard_deviation"
    map: str | None = Field(
        None,
        description="a file of the standard deviation in e- of every pixel: replaces sigma_e and meaning",
    )


class DarkCurrentSpec(_Part):
    """a exp(b T), or a datasheet's value at a reference temperature with its doubling interval.

    With the law `arrhenius`, exp(-E / k T_K) of one activation energy E: b is the growth at 0 degC, E = b k (273.15 K)^2.
    """

    a_e_per_s: float = Field(0.0, ge=0, le=1e7)
    b_per_c: float = Field(0.0866, ge=0, le=0.5)
    law: Literal["exponential", "arrhenius"] = "exponential"
    reference_e_per_s: float | None = Field(None, ge=0, le=1e7, exclude=True)
    reference_temperature_c: float | None = Field(None, ge=-150, le=150, exclude=True)
    doubling_c: float | None = Field(None, gt=1, le=100, exclude=True)

    @model_validator(mode="after")
    def _from_datasheet(self) -> "DarkCurrentSpec":
        rate, reference, doubling = self.reference_e_per_s, self.reference_temperature_c, self.doubling_c
        if rate is None and reference is None and doubling is None:
            return self
        if rate is None or reference is None or doubling is None or "a_e_per_s" in self.model_fields_set:
            raise ValueError(
                "expected either a_e_per_s and b_per_c, "
                "or all of reference_e_per_s, reference_temperature_c and doubling_c"
            )
        b_per_c = math.log(2) / doubling
        if self.law == "arrhenius":
            b_per_c *= (1 + reference / ZERO_C_K) ** 2
        a_e_per_s = rate * math.exp(-b_per_c * self.exponent(reference))
        return DarkCurrentSpec(a_e_per_s=a_e_per_s, b_per_c=b_per_c, law=self.law)

    def exponent(self, temperature_c: Any) -> Any:
        """What b is multiplied with: T, or T_0 (T_K - T_0) / T_K with T_0 = 273.15 K, in degrees.

        Examples:
            >>> DarkCurrentSpec(law="arrhenius").exponent(-40.0) < -40
            True
        """
        if self.law == "exponential":
            return temperature_c
        return temperature_c * ZERO_C_K / (temperature_c + ZERO_C_K)


class PRNUSpec(_Part):
    """Photo-response nonuniformity: relative standard deviations of columns, rows and pixels."""

    column: float = Field(0.0, ge=0, le=0.5)
    row: float = Field(0.0, ge=0, le=0.5)
    pixel: float = Field(0.0, ge=0, le=0.5)
    map: str | None = Field(
        None, description="a file of K per pixel (.npy, TIFF, FITS): replaces the three drawn parts"
    )


class DSNUSpec(_Part):
    """Dark-signal nonuniformity: standard deviations of columns, rows and pixels, in electrons."""

    column_e: float = Field(0.0, ge=0, le=1e4)
    row_e: float = Field(0.0, ge=0, le=1e4)
    pixel_e: float = Field(0.0, ge=0, le=1e4)
    map: str | None = Field(
        None, description="a file of offsets in e- per pixel: replaces the three drawn parts"
    )


class Colour(_Part):
    """The colour filters and what becomes of them; see visaug/camera/colour.py for the law."""

    cfa: Literal["RGGB", "BGGR", "GRBG", "GBRG"]
    white_balance: tuple[Gain, Gain, Gain] = (1.0, 1.0, 1.0)
    matrix: tuple[Row, Row, Row] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    demosaic: Literal["bilinear", "malvar"] = "bilinear"

    @field_validator("matrix")
    @classmethod
    def _keeps_white(cls, value: tuple[Row, Row, Row]) -> tuple[Row, Row, Row]:
        for row in value:
            if abs(sum(row) - 1) > 1e-3:
                raise ValueError(f"a row sums to {sum(row):g}; expected 1, so that white stays white")
        if abs(np.linalg.det(np.array(value))) < 1e-3:
            raise ValueError("has no inverse; expected three rows that are no mixtures of each other")
        return value


class CameraSpec(_Part):
    """The content of a camera.yaml. Units are in the names; docs/cameras.md describes each field."""

    name: str = "camera"
    source: str | dict[str, str] | None = None
    assumed: list[str] = Field(default_factory=list, description="paths of figures that no source gives")
    licence: str | None = None
    resolution: tuple[int, int]
    bit_depth: int = Field(16, ge=1, le=16)
    reading: Literal["physical", "paper"] = "physical"
    quantum_efficiency: float = Field(1.0, ge=1e-4, le=1)
    gain_e_per_dn: float = Field(ge=1e-6, le=1e6)
    gain_db: float = Field(0.0, ge=-60, le=120)
    black_level_dn: float = Field(0.0, ge=0, le=65535)
    full_well_e: float | None = Field(None, ge=1, le=1e9)
    exposure_s: float = Field(0.01, ge=0, le=1e5)
    temperature_c: float = Field(20.0, ge=-150, le=150)
    read_noise: ReadNoiseSpec = Field(default_factory=lambda: ReadNoiseSpec.model_validate({}))
    dark_current: DarkCurrentSpec = Field(default_factory=lambda: DarkCurrentSpec.model_validate({}))
    prnu: PRNUSpec = Field(default_factory=lambda: PRNUSpec.model_validate({}))
    dsnu: DSNUSpec = Field(default_factory=lambda: DSNUSpec.model_validate({}))
    colour: Colour | None = Field(None, description="left out: a monochrome camera")
    effects: list[dict[str, Any]] = Field(default_factory=list)
    randomize: dict[str, float | dict[str, float | list[float]]] = Field(default_factory=dict)
    correlated: list[tuple[str, str, float]] = Field(
        default_factory=list, description="pairs of randomized paths and the correlation of their draws"
    )

    @field_validator("resolution")
    @classmethod
    def _positive(cls, value: tuple[int, int]) -> tuple[int, int]:
        if min(value) < 1 or max(value) > MOST_PIXELS:
            raise ValueError(f"rows and columns are each from 1 to {MOST_PIXELS}")
        return value

    @property
    def range_e(self) -> float:
        """Electrons from the black level to the end of the converter."""
        return (2**self.bit_depth - 1 - self.black_level_dn) * self.gain_e_per_dn

    @property
    def saturation_photons(self) -> float:
        """Photons that fill a pixel, or the range of the converter where that is less."""
        return min(self.range_e, self.full_well_e or self.range_e) / self.quantum_efficiency


_TYPES = [field.annotation for field in CameraSpec.model_fields.values()]
_PARTS = [part for kind in _TYPES for part in (kind, *getattr(kind, "__args__", ()))]
_KEYS = sorted(
    {*CameraSpec.model_fields, *(key for part in _PARTS for key in getattr(part, "model_fields", ()))}
)


def read_spec(path: Path) -> CameraSpec:
    """The checked content of a camera file."""
    content = read_yaml(path, "a camera.yaml")
    if not isinstance(content, dict):
        expected = "a camera.yaml with name, resolution, gain_e_per_dn ..."
        raise InputError("holds no keys", file=path, expected=expected)
    return check_spec(content, path)


_PROBLEMS = {  # of pydantic's types, in words of a YAML file
    "tuple_type": "is not a list",
    "too_long": "has too many entries",
    "list_type": "is not a list",
    "model_type": "has no keys of its own",
    "dict_type": "has no keys of its own",
    "string_type": "is not a word",
    "float_type": "is not a number",
    "float_parsing": "is not a number",
}
_FORMS = {
    "read_noise": "for example {sigma_e: 6.0}",
    "dark_current": "for example {reference_e_per_s: 1.5, reference_temperature_c: 36, doubling_c: 8}",
    "prnu": "for example {pixel: 0.006}",
    "dsnu": "for example {pixel_e: 1.1}",
    "colour": "for example {cfa: RGGB}",
    "effects": "for example [{name: row_noise, sigma_e: 1.2}]",
    "assumed": "for example [quantum_efficiency]",
}


def check_spec(content: dict[str, Any], file: Path | None = None) -> CameraSpec:
    """A checked CameraSpec, or an InputError that names the first key at fault by its path."""
    _refuse_switches(content, "", file)
    try:
        spec = CameraSpec.model_validate(content)
    except ValidationError as error:
        errors = error.errors()  # a key that is not known explains one that is missing
        first = next((e for e in errors if e["type"] == "extra_forbidden"), errors[0])
        path = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            problem = "is not a key of a camera" + did_you_mean(str(first["loc"][-1]), _KEYS)
        elif first["type"] == "missing":
            problem = "is missing"
        else:
            problem = _PROBLEMS.get(first["type"], first["msg"].removeprefix("Value error, "))
            problem += f" (got {first['input']!r})"
        size = first["loc"][:1] == ("resolution",)
        is_share = first["type"] == "less_than_equal" and path.split(".")[0] in ("prnu", "quantum_efficiency")
        fraction = f"a fraction: {first['input'] / 100:g} for {first['input']:g} %" if is_share else None
        expected = "[rows, columns]" if size else fraction or _FORMS.get(path)
        raise InputError(problem, file=file, field=path, expected=expected) from error
    for i, entry in enumerate(spec.effects):
        _check_effect(entry, f"effects.{i}", file)
    names = [entry["name"] for entry in spec.effects]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"{twice} is listed twice", file=file, field="effects", expected="each effect once")
    if spec.black_level_dn >= (top := 2**spec.bit_depth - 1):
        problem = f"{spec.black_level_dn:g} leaves no range for the signal"
        expected = f"less than {top}, the highest code of {spec.bit_depth} bits"
        raise InputError(problem, file=file, field="black_level_dn", expected=expected)
    _check_randomize(spec, file)
    return spec


def _refuse_switches(content: Any, path: str, file: Path | None) -> None:
    """No key of a camera takes true or false, which pydantic would read as 1 or 0."""
    if isinstance(content, bool):
        raise InputError(f"{content} is not a value", file=file, field=path, expected="a number or a word")
    parts = (
        content.items()
        if isinstance(content, dict)
        else enumerate(content if isinstance(content, list) else ())
    )
    for key, value in parts:
        _refuse_switches(value, f"{path}.{key}" if path else str(key), file)


def _check_effect(entry: dict[str, Any], path: str, file: Path | None) -> None:
    name, every = entry.get("name"), catalogue()
    known = {key: effect for key, effect in every.items() if not effect.base}
    if not isinstance(name, str) or name not in known:
        expected = (
            "a name that `visaug effects` lists; an effect of your own is loaded first: --effects FILE.py, or "
            "visaug.effects.load_file in Python"
        )
        problem = f"{name!r} is not an effect{did_you_mean(str(name), known)}"
        if isinstance(name, str) and name in every:
            problem = f"{name} is part of every camera and has keys of its own"
        raise InputError(problem, file=file, field=f"{path}.name", expected=expected)
    for key, value in list(entry.items()):
        if key == "name":
            continue
        field = f"{path}.{key}"
        if key == "map" and known[name].map_unit:
            if not isinstance(value, str):
                expected = f"a map in {known[name].map_unit}"
                raise InputError(f"{value!r} is not a file", file=file, field=field, expected=expected)
            continue
        if key not in known[name].parameters:
            expected = f"one of {', '.join(known[name].parameters)}"
            raise InputError(f"is not a parameter of {name}", file=file, field=field, expected=expected)
        entry[key] = number(value)
        check_value(known[name].parameters[key], entry[key], field, file)


def number(value: Any) -> Any:
    """The number; YAML 1.1 reads 1e-3 as text."""
    try:
        return float(value) if isinstance(value, str) else plain(value)
    except ValueError:
        return value


def _check_randomize(spec: CameraSpec, file: Path | None) -> None:
    from visaug.camera.paths import numeric_values, place_of
    from visaug.camera.randomize import correlations

    known = numeric_values(spec)
    for path, spread in spec.randomize.items():
        field = f"randomize.{path}"
        if path not in known:
            expected = f"one of {', '.join(known)}"
            raise InputError(
                "is not a numeric parameter of this camera", file=file, field=field, expected=expected
            )
        parameter = place_of(path).parameter
        if path == "black_level_dn":  # as the value itself, it leaves a range for the signal
            parameter = replace(parameter, high=2.0**spec.bit_depth - 2)
        _check_spread(spread, parameter, field, file)
    for i, (one, other, coefficient) in enumerate(spec.correlated):
        field = f"correlated.{i}"
        for path in (one, other):
            if path not in known:
                raise InputError(
                    f"{path!r} is not a numeric parameter of this camera", file=file, field=field
                )
        if any({one, other} == {*pair[:2]} for pair in spec.correlated[:i]):
            expected = "one correlation of two paths"
            raise InputError(f"{one} and {other} are paired twice", file=file, field=field, expected=expected)
        if one == other or not -1 < coefficient < 1:
            expected = "two different paths and a correlation between -1 and 1"
            raise InputError("is not a correlation", file=file, field=field, expected=expected)
    matrix = correlations(spec.correlated, tuple(spec.randomize))
    if matrix is not None and np.linalg.eigvalsh(matrix)[0] < 1e-6:
        expected = "correlations that form a positive definite matrix"
        raise InputError("are inconsistent", file=file, field="correlated", expected=expected)


def _check_spread(spread: Any, parameter: Parameter, field: str, file: Path | None) -> None:
    laws = "a number, {std: x}, {half_normal: x}, {uniform: [a, b]} or {log_uniform: [a, b]}"
    kind, size = "std", spread
    if isinstance(spread, dict):
        if len(spread) != 1:
            raise InputError(f"{spread!r} is not a spread", file=file, field=field, expected=laws)
        kind, size = next(iter(spread.items()))
    if kind in ("std", "half_normal") and isinstance(size, int | float):
        if not 0 <= size < math.inf:
            expected = "a standard deviation, 0 or more"
            raise InputError(f"{size!r} is out of range", file=file, field=field, expected=expected)
    elif kind in ("uniform", "log_uniform") and isinstance(size, list) and len(size) == 2:
        low, high = size
        if not parameter.low <= low <= high <= parameter.high or not math.isfinite(high):
            expected = f"[a, b] with a <= b, each {bounds_text(parameter)}"
            raise InputError(f"{size!r} is out of range", file=file, field=field, expected=expected)
        if kind == "log_uniform" and low <= 0:
            raise InputError(f"{size!r} is out of range", file=file, field=field, expected="a above 0")
    else:
        raise InputError(f"{spread!r} is not a spread", file=file, field=field, expected=laws)
