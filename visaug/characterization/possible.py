"""A result whose camera file can be written: what no camera can have is left out of it and said."""

from __future__ import annotations

from dataclasses import replace

from visaug.camera import Camera
from visaug.characterization.camera_content import CAMERA_KEYS, camera_content
from visaug.characterization.result import Characterization, Warned
from visaug.core.errors import InputError


def without_impossible(result: Characterization) -> Characterization:
    """The result with what no camera file can hold left out of its camera and named in its warnings."""
    while True:
        try:
            Camera.load(camera_content(result))
            return result
        except InputError as error:
            known = {**result.assumed, **result.parameters}
            key = next(
                (k for k in CAMERA_KEYS if k in known and k not in result.left_out and error.field == k), None
            )
            if key is None or key == "gain_e_per_dn":
                return result
            keys = tuple(
                k
                for k in known
                if k == key or (key.startswith("dark_current.") and k.startswith("dark_current."))
            )
            text = f"out_of_range: {' and '.join(keys)} cannot stand in a camera file and is left out of it: {error}"
            details = (*result.warning_details, Warned("out_of_range", text, keys))
            result = replace(result, warning_details=details, left_out=(*result.left_out, *keys))
