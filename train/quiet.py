"""ultralytics without network, chatter or settings in the user's home, and with the tracking that was asked for."""

import logging
import os
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from visaug.core.errors import InputError

# ultralytics' names of its hooks, and what each needs to be installed.
TRACKERS = {name: name for name in ("tensorboard", "mlflow", "wandb", "clearml")}
TRACKERS |= {"comet": "comet_ml", "dvc": "dvclive"}
# The handler that tells what ultralytics says of trackers: one that cannot start is passed over with no more than a warning.
HEARD = "visaug: trackers"


def quiet_ultralytics(folder: str | Path) -> None:
    """Set what ultralytics reads when it is first imported; its settings go to `folder` unless a place is set."""
    switches = {"YOLO_OFFLINE": "1", "YOLO_AUTOINSTALL": "0", "YOLO_VERBOSE": "false"}
    switches["ULTRALYTICS_SAFE_LOAD"] = "1"  # networks and checkpoints are data, and run no code
    for name, value in switches.items():
        os.environ.setdefault(name, value)
    if "YOLO_CONFIG_DIR" not in os.environ:
        Path(folder).mkdir(parents=True, exist_ok=True)
        os.environ["YOLO_CONFIG_DIR"] = str(Path(folder).resolve())
    from ultralytics.utils import LOGGER

    LOGGER.setLevel(logging.CRITICAL)  # what matters is raised too


def check_tracking(names: Sequence[str]) -> None:
    """Refuses tracking by a tool that is not installed, which ultralytics would ignore silently."""
    for module in map(TRACKERS.__getitem__, names):
        if find_spec(module) is None:
            raise InputError(f"{module} is not installed", field="tracking", expected=f"pip install {module}")


def set_tracking(names: Sequence[str]) -> None:
    """Switch ultralytics' hooks on and off for the trainings that follow; that for Ray Tune, which would load all of
    Ray, is always off.
    """
    from ultralytics import settings
    from ultralytics.utils import LOGGER

    for old in [handler for handler in LOGGER.handlers if handler.name == HEARD]:
        LOGGER.removeHandler(old)
    LOGGER.setLevel(logging.WARNING if names else logging.CRITICAL)
    for handler in LOGGER.handlers:
        handler.setLevel(logging.CRITICAL)
    if names:
        heard = logging.StreamHandler()
        heard.set_name(HEARD)
        heard.setLevel(logging.WARNING)
        heard.addFilter(lambda record: any(name in record.getMessage().lower() for name in names))
        LOGGER.addHandler(heard)
    for name in (*TRACKERS, "raytune"):
        if settings.get(name) != (name in names):
            settings.update({name: name in names})
