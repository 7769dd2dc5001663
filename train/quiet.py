"""ultralytics without network, chatter or settings in the user's home."""

import logging
import os
from pathlib import Path


def quiet_ultralytics(folder: str | Path) -> None:
    """Set what ultralytics reads when it is first imported; its settings go to `folder` unless a place is
    set.
    """
    os.environ.setdefault("YOLO_OFFLINE", "1")
    os.environ.setdefault("YOLO_AUTOINSTALL", "0")
    os.environ.setdefault("YOLO_VERBOSE", "false")
    if "YOLO_CONFIG_DIR" not in os.environ:
        Path(folder).mkdir(parents=True, exist_ok=True)
        os.environ["YOLO_CONFIG_DIR"] = str(Path(folder).resolve())
    from ultralytics.utils import LOGGER

    LOGGER.setLevel(logging.CRITICAL)  # what matters is raised too
