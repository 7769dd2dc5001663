"""What a characterization found: parameters with intervals, what stays open, curves and maps."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partialmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from visaug.camera import Camera
from visaug.camera.patterns import fit_pattern
from visaug.characterization import plots
from visaug.characterization.maps import camera_maps, with_maps
from visaug.characterization.nonuniformity import two_way
from visaug.core.errors import InputError
from visaug.core.files import whole_file
from visaug.effects.readout.read_noise import LEAST_SHAPE
from visaug.statistics.findings import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CAMERA_KEYS = (
    "bit_depth", "quantum_efficiency", "gain_e_per_dn", "gain_db", "black_level_dn", "full_well_e", "exposure_s",
    "temperature_c", "read_noise.sigma_e", "read_noise.shape", "dark_current.a_e_per_s", "dark_current.b_per_c",
    "prnu.column", "prnu.row", "prnu.pixel", "dsnu.column_e", "dsnu.row_e", "dsnu.pixel_e",
)  # fmt: skip
_NEEDED = tuple(k for k in CAMERA_KEYS if k != "full_well_e")
_SETTINGS = ("bit_depth", "gain_db", "exposure_s", "temperature_c")


@dataclass(frozen=True, slots=True)
class Warned:
    """A warning by its stable word, and the parameters whose value or interval is not to be trusted."""

    word: str
    text: str
    spoils: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        return {"word": self.word, "text": self.text, "spoils": list(self.spoils)}


@dataclass(frozen=True)
class Characterization:
    """Camera parameters measured from frames.

    Attributes:
        parameters: by the keys of camera.yaml with dots, and `emva.*`, `temporal.*`, `image.*` beside them.
        not_determined: parameters that the frames cannot tell, and what it would need.
        warnings: named sentences about the frames and the fits.
        warning_details: the same, each with the parameters that it puts in doubt.
        curves: arrays for plots, by name (see the `plot_*` methods).
        maps: (H, W) float32 arrays by name: `master_bias` (DN), `response` (over the mean), `read_noise` (e-),
            `dark_current` (e-/s), `defects` (bits: 1 hot, 2 dead, 4 unsteady); DN in place of e- without a gain.
        map_headers: FITS cards of the maps by name: BUNIT, and the temperature (CCD-TEMP, degC) of `dark_current`, which is that
            of the warmest dark frames of two exposures.
        dark_current_error: standard error of a usual pixel of the map `dark_current`, in its unit.
        assumed: settings of the frames, and what was taken from the camera given.
        base: content of the camera given, whose further effects stay.
        not_measured: further paths of the camera file that are assumptions.
        effects: effects beyond the base chain that were measured, as a camera file has them.
        planes: the same for each colour of a mosaic, by its name or place.
        left_out: keys of camera.yaml whose value lies outside of what a camera file can hold.
    """

    parameters: Mapping[str, Estimate]
    not_determined: Mapping[str, str]
    warning_details: tuple[Warned, ...] = ()
    curves: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict, repr=False)
    maps: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)
    dark_current_error: float = field(default=0.0, repr=False)
    assumed: Mapping[str, float] = field(default_factory=dict, repr=False)
    base: Mapping[str, Any] | None = field(default=None, repr=False)
    resolution: tuple[int, int] | None = None
    not_measured: tuple[str, ...] = ()
    effects: tuple[Mapping[str, Any], ...] = ()
    planes: "Mapping[str, Characterization]" = field(default_factory=dict, repr=False)
    method: str = "emva"
    left_out: tuple[str, ...] = ()
    map_headers: Mapping[str, Mapping[str, str | float]] = field(default_factory=dict, repr=False)

    @property
    def warnings(self) -> tuple[str, ...]:
        return tuple(w.text for w in self.warning_details)

    def __repr__(self) -> str:
        counts = f"{len(self.parameters)} parameters, {len(self.not_determined)} not determined"
        return f"Characterization({counts}, {len(self.warnings)} warnings)"

    @property
    def is_noiseless(self) -> bool:
        """Whether these are pictures without sensor noise, so that there is no camera to be found."""
        return any(w.word == "no_sensor_noise" for w in self.warning_details)

    @property
    def has_gain(self) -> bool:
        """Whether the gain is measured or given, without which nothing can be said in electrons."""
        return "gain_e_per_dn" in {**self.assumed, **self.parameters}.keys() - set(self.left_out)

    @property
    def transfer(self) -> str | None:
        """`srgb` where the pictures' values follow from light by a tone curve like it; None for linear values."""
        return "srgb" if any(w.word == "tone_curve" for w in self.warning_details) else None

    def __getitem__(self, name: str) -> Estimate:
        return self.parameters[name]

    def to_json(self) -> dict[str, Any]:
        """The content of `characterize --json`; every interval is 95 %."""
        return {
            "schema": 1,
            "parameters": {name: e.to_json() for name, e in self.parameters.items()},
            "not_determined": [{"parameter": p, "needs": n} for p, n in self.not_determined.items()],
            **({"effects": [dict(e) for e in self.effects]} if self.effects else {}),
            "warnings": list(self.warnings),
            "warning_details": [w.to_json() for w in self.warning_details],
            **({"planes": {name: p.to_json() for name, p in self.planes.items()}} if self.planes else {}),
        }

    def to_camera_dict(self) -> dict[str, Any]:
        """The content of a camera.yaml with what was measured, and what was assumed where nothing was.

        Raises:
            InputError: the gain is neither measured nor given, so nothing can be said in electrons.
        """
        found = {**self.assumed, **{k: e.value for k, e in self.parameters.items() if k in CAMERA_KEYS}}
        found = {k: v for k, v in found.items() if k not in self.left_out}
        if not self.has_gain:
            raise InputError(
                "the frames do not tell the gain, so there is no camera in electrons",
                field="gain_e_per_dn",
                expected=self.not_determined.get("gain_e_per_dn", "flats at several levels")
                + ("" if self.method == "pictures" else ", or a camera that gives the gain"),
            )
        fresh = {"name": "characterized camera", "resolution": list(self.resolution or (1, 1))}
        content: dict[str, Any] = copy.deepcopy(dict(self.base or fresh))
        _put(content, found)
        if effects := _effects(content, self):
            content["effects"] = effects
        if assumed := _assumptions(self, found):
            content["assumed"] = assumed
        if self.method == "pictures":
            measured = {k: e for k, e in self.parameters.items() if not k.startswith("image.")}
            content["source"] = {k: e.source for k, e in measured.items()}
        return content

    @cached_property
    def camera(self) -> Camera:
        """The camera that was found.

        Raises:
            InputError: the gain is neither measured nor given.
        """
        return Camera.load(self.to_camera_dict())

    def to_camera_yaml(self) -> str:
        """The text of a camera.yaml."""
        import yaml

        return yaml.safe_dump(self.to_camera_dict(), sort_keys=False, default_flow_style=None)

    def save_maps(self, folder: str | Path, suffix: str = ".fits") -> list[Path]:
        """Write every map as FITS or TIFF; returns the files. FITS headers have unit and temperature."""
        from visaug.frames.writers import write_frame

        if suffix not in (".fits", ".tif", ".tiff", ".npy"):
            problem = f"{suffix!r} is not a map format"
            raise InputError(problem, field="suffix", expected=".fits, .tif or .npy")
        written = []
        for name, values in self.maps.items():
            path = Path(folder) / f"{name}{suffix}"
            with whole_file(path) as temporary:
                write_frame(temporary, values, cards=self.map_headers.get(name))
            written.append(path)
        return written

    def save_camera(self, path: str | Path, maps: str | Path | None = None) -> list[Path]:
        """Write the camera.yaml; with `maps` it names measured maps of every pixel, .npy files in that folder.

        Maps take the place of drawn patterns: `prnu`, `dsnu`, and, where pixels differ in them, `read_noise` and
        `dark_current_nonuniformity`.

        Returns:
            The files of the maps.

        Raises:
            InputError: the gain is neither measured nor given, or the frames show a window of the sensor only.
        """
        if maps is None:
            self.camera.save(path)
            return []
        written = {}
        for name, values in camera_maps(self).items():
            written[name] = Path(maps) / f"{name}.npy"
            with whole_file(written[name]) as temporary, open(temporary, "wb") as handle:
                np.save(handle, values)
        Camera.load(with_maps(self.to_camera_dict(), written)).save(path)
        return list(written.values())

    def draw_dsnu(self, seed: int) -> np.ndarray:
        """Another sensor's dark pattern with this one's bands and spatial spectrum, (H, W) float32 in DN.

        The accurate DSNU of `visaug.camera.patterns`: rows and columns with the levels, trend and spectrum of the measured
        profiles; pixels white, of the measured strength without outliers.

        Raises:
            InputError: the frames gave no master bias.
        """
        if "master_bias" not in self.maps:
            problem = "the frames gave no master bias"
            raise InputError(problem, field="dsnu", expected="two or more bias frames")
        master = self.maps["master_bias"]
        _, _, pixels, _ = two_way(master)
        deviation = float(stats.median_abs_deviation(pixels.ravel(), scale="normal"))
        return replace(fit_pattern(master), pixel_e=deviation).draw(master.shape, seed)

    def plots(self) -> "dict[str, Figure]":
        """Every figure for which there are curves of more than one point, by name."""
        return plots.figures(self.curves)

    def _plot(self, name: str) -> "Figure":
        return plots.figure(self.curves, name)

    plot_photon_transfer = partialmethod(_plot, "photon_transfer")
    plot_linearity = partialmethod(_plot, "linearity")
    plot_read_noise = partialmethod(_plot, "read_noise")
    plot_dark_current = partialmethod(_plot, "dark_current")
    plot_nonuniformity = partialmethod(_plot, "nonuniformity")
    plot_gain_law = partialmethod(_plot, "gain_law")
    plot_noise_level = partialmethod(_plot, "noise_level")


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
    if (shape := content.get("read_noise", {}).get("shape")) is not None:
        content["read_noise"]["shape"] = max(shape, LEAST_SHAPE)


def _effects(content: Mapping[str, Any], result: Characterization) -> list[dict[str, Any]]:
    """Effects of the camera given, with the values of those that were measured."""
    effects = {e["name"]: e for e in content.get("effects", [])}
    for effect in result.effects:
        rounded = {k: v if isinstance(v, str) else float(f"{v:.4g}") for k, v in effect.items()}
        effects[effect["name"]] = effects.get(effect["name"], {}) | rounded
    return list(effects.values())


def _assumptions(result: Characterization, found: Mapping[str, float]) -> list[str]:
    """Paths of the camera file that nothing measured: taken from elsewhere, or left at their default."""
    paths = [k for k in result.assumed if k not in result.parameters and k not in _SETTINGS]
    paths += [k for k in _NEEDED if k not in found and result.base is None]
    paths += list(result.not_measured)
    paths += [k for w in result.warning_details if w.word == "bit_depth_assumed" for k in w.spoils]
    return list(dict.fromkeys(paths))


def without_impossible(result: Characterization) -> Characterization:
    """The result with what no camera file can hold left out of its camera and named in its warnings."""
    while True:
        try:
            Camera.load(result.to_camera_dict())
            return result
        except InputError as error:
            known = {**result.assumed, **result.parameters}
            key = error.field or ""
            if key not in CAMERA_KEYS or key not in known or key in (*result.left_out, "gain_e_per_dn"):
                return result
            is_dark = key.startswith("dark_current.")
            keys = tuple(k for k in known if k == key or (is_dark and k.startswith("dark_current.")))
            text = f"out_of_range: {' and '.join(keys)} cannot stand in a camera file and is left out of it: {error}"
            details = (*result.warning_details, Warned("out_of_range", text, keys))
            result = replace(result, warning_details=details, left_out=(*result.left_out, *keys))
