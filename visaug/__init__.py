"""Physical image-sensor noise: augment images, characterize a camera, find the effect its model lacks.

Everything here loads when first used, so `import visaug` costs next to nothing.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from visaug.core import __version__
from visaug.core.reporting import set_writer

if TYPE_CHECKING:
    from visaug.augment import VISNoise
    from visaug.camera import Camera
    from visaug.camera.simulation import simulate
    from visaug.characterization import Characterization, characterize
    from visaug.core.errors import InputError
    from visaug.diagnosis import Diagnosis, diagnose
    from visaug.diagnosis.comparison import Comparison, compare
    from visaug.diagnosis.session import Session
    from visaug.effects.effect import Effect, Parameter, Stage
    from visaug.frames import FrameSet
    from visaug.inspection import Inspection, inspect

_HOME = {
    "Camera": "visaug.camera",
    "Characterization": "visaug.characterization",
    "Comparison": "visaug.diagnosis",
    "Diagnosis": "visaug.diagnosis",
    "Effect": "visaug.effects.effect",
    "FrameSet": "visaug.frames",
    "InputError": "visaug.core.errors",
    "Inspection": "visaug.inspection",
    "Parameter": "visaug.effects.parameter",
    "Session": "visaug.diagnosis.session",
    "Stage": "visaug.effects.effect",
    "VISNoise": "visaug.augment",
    "characterize": "visaug.characterization",
    "compare": "visaug.diagnosis",
    "diagnose": "visaug.diagnosis",
    "inspect": "visaug.inspection",
    "simulate": "visaug.camera.simulation",
}
_ROOMS = frozenset(
    {
        "augment",
        "camera",
        "characterization",
        "core",
        "data",
        "diagnosis",
        "effects",
        "frames",
        "inspection",
        "report",
        "pictures",
        "statistics",
        "ultralytics",
    }
)

__all__ = [
    "Camera",
    "Characterization",
    "Comparison",
    "Diagnosis",
    "Effect",
    "FrameSet",
    "InputError",
    "Inspection",
    "Parameter",
    "Session",
    "Stage",
    "VISNoise",
    "__version__",
    "characterize",
    "compare",
    "diagnose",
    "inspect",
    "simulate",
]


def _write_report(path: Path, result: Any) -> None:
    from visaug.report import write_report

    write_report(path, result)


set_writer(_write_report)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
    elif name in _ROOMS:
        value = import_module(f"visaug.{name}")
    else:
        raise AttributeError(f"module 'visaug' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *_ROOMS})
