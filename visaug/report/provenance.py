"""When, how and from what a report was made: its footer."""

import hashlib
import shlex
import sys
import time
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from visaug.camera import Camera
    from visaug.frames import FrameSet

STARTED = time.monotonic()


def footer(camera: "Camera | None", frames: "FrameSet | None", seed: int | None = None) -> str:
    """Date, version, command, seed, inputs with hashes, and the time since the program started.

    Args:
        camera: the camera file that was used.
        frames: the frames that were used; the hash covers their table, not their pixels.
        seed: of the simulations.
    """
    from visaug import __version__

    parts = [datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"), f"visaug {__version__}"]
    program = Path(sys.argv[0])
    if program.name == "visaug" or program.parts[-2:] == ("visaug", "__main__.py"):
        parts.append("visaug " + shlex.join(sys.argv[1:]))
    if seed is not None:
        parts.append(f"seed {seed}")
    if camera is not None:
        parts.append(f"camera {camera.name!r}, {_digest(camera.to_yaml())}")
    if frames is not None:
        table = "\n".join(str(record) for record in frames.records)
        parts.append(f"{len(frames.records)} frames, table {_digest(table)}")
    seconds = time.monotonic() - STARTED
    parts.append(f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min")
    return " · ".join(parts)


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "replace"), digest_size=6).hexdigest()
