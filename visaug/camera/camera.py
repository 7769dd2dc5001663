"""A camera: its parameters, its chain of effects, and simulated exposures."""

import copy
import hashlib
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from importlib import resources
from math import exp, isinf
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from torch import Tensor

from visaug.camera import chain, paths
from visaug.camera.colour import ColourPath, colour_path
from visaug.camera.maps import effect_of, load_maps, moved, named_maps, set_map
from visaug.camera.spec import CameraSpec, check_spec, number, read_spec
from visaug.core.errors import InputError
from visaug.core.files import write_text
from visaug.core.nearest import did_you_mean
from visaug.core.sampling import Stream
from visaug.core.sampling.distributions import MOST_MEAN
from visaug.core.wording import first_of
from visaug.effects import Context, Stage, catalogue
from visaug.effects.effect import ends
from visaug.effects.parameter import check_value, unused


def shipped() -> dict[str, Path]:
    """The cameras in the package: names and files."""
    files = sorted(Path(str(file)) for file in (resources.files("visaug.camera") / "data").iterdir())
    return {file.stem: file for file in files if file.suffix == ".yaml"}


def own_folder() -> Path:
    """$XDG_DATA_HOME/visaug/cameras; ~/.local/share stands for $XDG_DATA_HOME where that is not set."""
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "visaug" / "cameras"


def own_cameras() -> dict[str, Path]:
    """Names and files of the user's own cameras."""
    return {file.stem: file for file in sorted(own_folder().glob("*.yaml"))}


def camera_file(source: str | Path) -> Path:
    """The camera.yaml at a path, or that of a camera in the package or of the user's own by its name, in any case, with spaces
    or hyphens.

    Raises:
        InputError: there is neither such a file nor such a camera, or the name is in the package and among the user's own.
    """
    path, package, own = Path(source), shipped(), own_cameras()
    if path.is_file():
        return path
    name = path.name.removesuffix(".yaml").lower().replace(" ", "_").replace("-", "_")
    if path.parent == Path() and name in package and name in own:
        raise InputError(f"{name} is in the package too", file=own[name], expected="another name of your own")
    known = {**package, **own}
    if path.parent == Path() and name in known:
        return known[name]
    is_folder = path.is_dir()
    folder = path if is_folder else path.parent
    there = sorted(file.name for file in folder.glob("*.yaml")) if folder != Path() else []
    problem = "no such camera" + did_you_mean(name, known)
    if there:
        problem = "is a folder; it has " if is_folder else "no such camera; its folder has "
        problem += first_of(there, 3)
    expected = "a camera.yaml, or a name that `visaug cameras` lists"
    raise InputError(problem, file=source, expected=expected)


class Camera:
    """A camera model: a chain of effects with nominal parameters.

    Immutable: `replace`, `with_effect` and `without_effect` return a new camera. Use `Camera.load` to make one.

    Args:
        spec: the validated content of a camera.yaml.
        folder: folder of the file; paths of measured maps are relative to it.
        maps: the measured maps by effect; None reads them from the files.

    Attributes:
        effects: the chain, base terms and further effects, in the order in which they act.
        loaded_from: the file or name given to `load`; None for a camera that no file holds as it is.

    Examples:
        >>> import visaug
        >>> camera = visaug.Camera.load("sony_imx174").with_effect("row_noise", sigma_e=1.5)
        >>> camera.effect_names
        ['row_noise']
    """

    def __init__(self, spec: CameraSpec, folder: Path | None = None, maps: dict[str, Tensor] | None = None):
        self.spec = spec
        self.folder = folder
        self.loaded_from: str | None = None
        self.maps = load_maps(spec, folder) if maps is None else maps
        # The rest is worked out here, once, so that `torch.compile` meets only numbers and effects in `expose`.
        base = [name for name, effect in catalogue().items() if effect.base]
        further = [entry["name"] for entry in spec.effects]
        self.effects = chain.ordered([catalogue()[name]() for name in (*base, *further)], spec.reading)
        self._values = paths.numeric_values(spec)
        self._arrays = {path: np.array([value]) for path, value in self._values.items()}
        on_picture = {effect.name for effect in self.effects if effect.stage == Stage.PICTURE}
        self._finishes = bool(on_picture)
        self._sensor_effects = [name for name in self.effect_names if name not in on_picture]
        self._choices = paths.words(spec)

    @classmethod
    def load(cls, source: "str | Path | Mapping[str, Any] | Camera") -> "Camera":
        """Loads a camera from a camera.yaml, the name of a camera in the package, or a mapping with the content of such a file.

        Raises:
            InputError: the file or name does not exist, a key is unknown, a value is out of range, or a measured map cannot
                be read.
        """
        if isinstance(source, Camera):
            return source
        if isinstance(source, Mapping):
            return cls(_with_all_used(check_spec(dict(source))))
        if not isinstance(source, str | Path):
            raise InputError(
                f"{source!r} is not a camera", field="camera", expected="a camera.yaml, a name, or a Camera"
            )
        path = camera_file(source)
        camera = cls(
            _with_all_used(read_spec(path)),
            path.parent if path == Path(source) or path.parent == own_folder() else None,
        )
        camera.loaded_from = str(source)
        return camera

    @property
    def name(self) -> str:
        return self.spec.name

    @property
    def resolution(self) -> tuple[int, int]:
        """Rows and columns of the sensor."""
        return self.spec.resolution

    @property
    def bit_depth(self) -> int:
        return self.spec.bit_depth

    @property
    def effect_names(self) -> list[str]:
        """Names of the effects beyond the base chain."""
        return [entry["name"] for entry in self.spec.effects]

    def values(self) -> dict[str, float]:
        """All numeric parameters by their path in camera.yaml. An unspecified full well is infinite."""
        return dict(self._values)

    def arrays(self) -> dict[str, np.ndarray]:
        """The values of `values` as (1,) float64 arrays, which must not be changed."""
        return dict(self._arrays)

    def choices(self) -> dict[str, str]:
        """All categorical parameters by their path."""
        return dict(self._choices)

    def replace(self, values: Mapping[str, Any]) -> "Camera":
        """Returns the camera with other parameter values, given by path.

        With `gain_db` only, `gain_e_per_dn` is adjusted: 20 dB more is a tenth of the electrons per DN. With
        `gain_e_per_dn` only, it is the gain at the present `gain_db`. Both together are a new reference.

        Raises:
            InputError: the camera has no such parameter, or the value is out of bounds.

        Examples:
            >>> import visaug
            >>> camera = visaug.Camera.load({"resolution": [8, 8], "gain_e_per_dn": 0.5})
            >>> camera.replace({"gain_db": 20.0}).values()["gain_e_per_dn"]
            0.05
        """
        content, values = self.to_dict(), {path: _one(value) for path, value in values.items()}
        if "gain_db" in values and "gain_e_per_dn" not in values:
            gain_db = number(values["gain_db"])
            check_value(paths.place_of("gain_db").parameter, gain_db, "gain_db")
            values = {**values, "gain_e_per_dn": self.gain_at(gain_db)}
        for path, value in values.items():
            effect, _, key = path.partition(".")
            if path == "full_well_e" and value == float("inf"):
                content.pop(path, None)
            elif path in CameraSpec.model_fields and not key:
                content[path] = value
            elif effect in paths.PARTS:
                content.setdefault(effect, {})[key] = value
            else:
                entry = next((entry for entry in content.get("effects", ()) if entry["name"] == effect), None)
                if entry is None or key not in catalogue()[effect].parameters:
                    expected = f"one of {', '.join(self.values())}"
                    raise InputError("is not a parameter of this camera", field=path, expected=expected)
                entry[key] = value
        try:
            return self.with_content(content)
        except InputError as mistake:
            raise _by_name(mistake, content.get("effects", ())) from None

    def with_effect(self, name: str, **parameters: Any) -> "Camera":
        """Returns the camera with one more effect. An effect that it has already is replaced.

        Args:
            name: an effect of the catalogue.
            parameters: numbers or options by name. A pair (low, high) is drawn uniformly for each image (`randomize`); the
                nominal value is its middle.
        """
        content = self.without_effect(name).to_dict()
        ranges = {key: both for key, value in parameters.items() if (both := ends(value)) is not None}
        middles = {key: (low + high) / 2 for key, (low, high) in ranges.items()}
        known = catalogue()[name].parameters if name in catalogue() else {}
        middles |= {
            key: round(value) for key, value in middles.items() if key in known and known[key].integer
        }
        content.setdefault("effects", []).append({"name": name, **parameters, **middles})
        for key, both in ranges.items():
            content.setdefault("randomize", {})[f"{name}.{key}"] = {"uniform": list(both)}
        return self.with_content(content)

    def without_effect(self, name: str) -> "Camera":
        """Returns the camera without one of its further effects and its entries in `randomize`."""
        content = self.to_dict()
        content["effects"] = [entry for entry in content.get("effects", ()) if entry["name"] != name]
        own = f"{name}."
        randomize, pairs = content.get("randomize", {}), content.get("correlated", ())
        content["randomize"] = {path: law for path, law in randomize.items() if not path.startswith(own)}
        content["correlated"] = [
            (a, b, c) for a, b, c in pairs if not (a.startswith(own) or b.startswith(own))
        ]
        return self.with_content(content)

    def with_content(self, content: dict[str, Any]) -> "Camera":
        """The camera of another content of its file; measured maps stay what and where they are."""
        spec = check_spec(content)
        names, old = ({e: name for e, (name, _) in named_maps(s).items()} for s in (spec, self.spec))
        same = names == old and spec.resolution == self.resolution
        return Camera(spec, self.folder, self.maps if same else None)

    def to_dict(self) -> dict[str, Any]:
        """The content of a camera.yaml: the keys that differ from the defaults."""
        return copy.deepcopy(self.spec.model_dump(exclude_defaults=True, mode="json"))

    def to_yaml(self) -> str:
        """The text of a camera.yaml."""
        return _as_yaml(self.to_dict())

    def save(self, path: str | Path) -> None:
        """Writes a camera.yaml. Measured maps are not copied; their paths are adjusted to the new folder."""
        path = Path(path)
        content = self.to_dict()
        for name, key in named_maps(self.spec).values():
            set_map(content, key, moved(name, self.folder, path.parent))
        write_text(path, _as_yaml(content))

    def colour_path(self, origin: tuple[int, int] = (0, 0)) -> ColourPath | None:
        """From pictures to the plane behind the colour filters and back, for images that begin at `origin` of the sensor; None
        for a monochrome camera.
        """
        colour = self.spec.colour
        if colour is None:
            return None
        return colour_path(
            colour.cfa, colour.white_balance, colour.matrix, colour.demosaic, (origin[0] % 2, origin[1] % 2)
        )

    def gain_at(self, gain_db: float) -> float:
        """Electrons per DN at a gain in dB; 20 dB more is a tenth of the electrons per DN."""
        return self.spec.gain_e_per_dn * 10 ** ((self.spec.gain_db - gain_db) / 20)

    def dark_rate_at(self, temperature_c: float | None = None) -> float:
        """Dark current in e-/s at a temperature in degrees Celsius; None is that of the file."""
        dark = self.spec.dark_current
        at = self.spec.temperature_c if temperature_c is None else temperature_c
        return dark.a_e_per_s * exp(dark.b_per_c * dark.exponent(at))

    def expose(
        self,
        photons: Tensor,
        stream: Stream,
        values: Mapping[str, Tensor | float] | None = None,
        sequence: bool = False,
        memory: dict[str, Tensor] | None = None,
        watch: Any = None,
        resolution: tuple[int, int] | None = None,
        mosaic: Callable[[Tensor], Tensor] | None = None,
        shared: chain.SharedSignals | None = None,
    ) -> Tensor:
        """Simulates frames in DN with the exact, differentiable chain, up to the converter.

        Args:
            photons: (B, C, H, W) float32, mean photons per pixel and exposure.
            stream: the random numbers; its window is the part of the sensor that the images show.
            values: parameters that differ from the nominal values, by path: scalars, (B,) or (B, 1, 1, 1); may require gradients.
            sequence: True if the batch consists of consecutive frames, for lag and drift; `memory` carries state from batch
                to batch.
            watch: called with (effect, signal) after each effect.
            resolution: rows and columns of the whole sensor, where they are not this camera's own.
            mosaic: of a colour camera, what lets one of three planes of photons through to each pixel, after the optics.
            shared: signals that this exposure has in common with those of other cameras.

        Returns:
            (B, C, H, W) float32, DN in [0, 2^bit_depth - 1]. Effects of stage PICTURE act on pictures: see `finish`.
        """
        under = self._conditions(values, stream, photons.device, sequence, memory, resolution)
        return chain.expose(self.effects, photons, under, watch, mosaic, shared)

    @cached_property
    def base(self) -> str:
        """A name for all that the camera is but for its further effects, with its measured maps."""
        content = self.to_dict()
        for key in ("effects", "randomize", "correlated"):
            content.pop(key, None)
        digest = hashlib.blake2b(repr(content).encode(), digest_size=12)
        for name, values in sorted(self.maps.items()):
            digest.update(name.encode() + values.numpy().tobytes())
        return digest.hexdigest()

    @cached_property
    def further(self) -> dict[str, str]:
        """The parameters of each further effect, as text."""
        return {entry["name"]: repr(entry) for entry in self.spec.effects}

    @property
    def has_own_effects(self) -> bool:
        """Whether any effect is of a user's own."""
        return any(map(chain.is_own, self.effects))

    @property
    def finishes(self) -> bool:
        """Whether any effect acts on the developed picture."""
        return self._finishes

    @property
    def sensor_effects(self) -> list[str]:
        """Names of the further effects up to the converter: all but those that act on the developed picture."""
        return self._sensor_effects

    @property
    def sensor_maps(self) -> dict[str, Tensor]:
        """The measured maps that are patterns of the sensor."""
        return {n: value for n, value in self.maps.items() if not catalogue()[effect_of(n)].map_is_table}

    def finish(
        self,
        picture: Tensor,
        stream: Stream | None = None,
        values: Mapping[str, Tensor | float] | None = None,
    ) -> Tensor:
        """The picture after the camera's effects of stage PICTURE: tone curve, sharpening, compression.

        Args:
            picture: (B, C, H, W) float32 in [0, 1].
            stream: the random numbers, for effects of this stage that have any; None: those of seed 0.
            values: numbers that differ from the nominal ones, as of `expose`.

        Returns:
            The same shape, in [0, 1].
        """
        if stream is None:
            batch, channels, rows, columns = picture.shape
            window, numbers = (range(rows), range(columns)), range(batch)
            stream = Stream(numbers, numbers, channels, window, picture.device)
        return chain.finish(self.effects, picture, self._conditions(values, stream, picture.device))

    def _conditions(
        self,
        values: Mapping[str, Tensor | float] | None,
        stream: Stream,
        device: torch.device,
        sequence: bool = False,
        memory: dict[str, Tensor] | None = None,
        resolution: tuple[int, int] | None = None,
    ) -> chain.Conditions:
        for path in values or ():
            if path not in self._values:
                expected = f"one of {', '.join(self._values)}"
                raise InputError("is not a parameter of this camera", field=path, expected=expected)
        every = {**self._values, **(values or {})}
        tensors = {path: torch.as_tensor(v, dtype=torch.float32, device=device) for path, v in every.items()}
        full = {path: tensor.reshape(-1, 1, 1, 1) for path, tensor in tensors.items()}
        boost = (self.spec.gain_db - full["gain_db"]) * (torch.log(torch.tensor(10.0, device=device)) / 20)
        heat = torch.exp(
            full["dark_current.b_per_c"] * self.spec.dark_current.exponent(full["temperature_c"])
        )
        context = Context(
            exposure_s=full["exposure_s"],
            temperature_c=full["temperature_c"],
            gain_e_per_dn=full["gain_e_per_dn"] * torch.exp(boost),
            black_level_dn=full["black_level_dn"],
            full_well_e=full["full_well_e"],
            quantum_efficiency=full["quantum_efficiency"],
            dark_current_e=(full["exposure_s"] * full["dark_current.a_e_per_s"] * heat).clamp_max(MOST_MEAN),
            bit_depth=self.bit_depth,
            reading=self.spec.reading,
            resolution=resolution or self.resolution,
            window=stream.window,
            sequence=sequence,
            memory={} if memory is None else memory,
            maps=self.maps,
        )
        return chain.Conditions(full, self.choices(), stream, context)

    def __repr__(self) -> str:
        rows, columns = self.resolution
        further = ", ".join(self.effect_names) or "no further effects"
        return f"Camera({self.name!r}, {rows}x{columns}, {self.bit_depth} bit, {further})"


def _one(value: Any) -> Any:
    """The number in an array or a tensor of one, whether or not its gradient is wanted; anything else as it is."""
    try:
        return value.item()
    except (AttributeError, ValueError, RuntimeError):
        return value


def _by_name(mistake: InputError, effects: Sequence[Mapping[str, Any]]) -> InputError:
    """The mistake with `effects.0.sigma_e`, the place in a file, as `row_noise.sigma_e`, the path that the caller gave."""
    first, _, rest = (mistake.field or "").partition(".")
    number, _, key = rest.partition(".")
    if first != "effects" or not number.isdigit():
        return mistake
    field = f"{effects[int(number)]['name']}.{key}"
    return InputError(mistake.problem, file=mistake.file, field=field, expected=mistake.expected)


def _with_all_used(spec: CameraSpec) -> CameraSpec:
    """The same; says which given parameters have no effect beside the chosen options, and which spreads have none."""
    idle = [
        (entry["name"], key, entry[key], option)
        for entry in spec.effects
        for key, option in unused(catalogue()[entry["name"]].parameters, entry).items()
    ]
    values = paths.numeric_values(spec)
    for path, spread in spec.randomize.items():
        around = spread if not isinstance(spread, dict) else spread.get("std", spread.get("half_normal"))
        if around and (isinf(values[path]) or (values[path] == 0 and around is spread)):
            expected = f"another law, such as {{uniform: [a, b]}}: the value is {values[path]:g}"
            idle.append(("randomize", path, spread, expected))
    for each in idle:
        logging.getLogger("visaug").warning("%s.%s = %s has no effect; expected %s", *each)
    return spec


def _as_yaml(content: dict[str, Any]) -> str:
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110)
