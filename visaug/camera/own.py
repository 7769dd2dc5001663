"""The user's own cameras: a folder of camera files that every command knows by name."""

import os
from pathlib import Path


def own_folder() -> Path:
    """$XDG_DATA_HOME/visaug/cameras; ~/.local/share stands for $XDG_DATA_HOME where that is not set."""
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "visaug" / "cameras"


def own_cameras() -> dict[str, Path]:
    """Names and files of the user's own cameras."""
    return {file.stem: file for file in sorted(own_folder().glob("*.yaml"))}
