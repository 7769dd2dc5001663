"""The command that follows from an answer, with the files at hand: the same on pages, terminal and lab."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from visaug.camera import Camera
    from visaug.frames import FrameSet
    from visaug.pictures.comparison import PictureComparison

PICTURES = "Replace IMAGES by the pictures that you train with."


class NextStep(NamedTuple):
    """A sentence, and the command lines for it."""

    text: str
    command: str


@dataclass(frozen=True)
class Inputs:
    """Inputs of a command as they were loaded. Names in capitals are placeholders for unknown files."""

    frames: str = "FRAMES"  # the folder of the measured frames
    camera: str = "CAMERA"  # the camera file, or the name of a camera in the package
    # the file of the camera that a diagnosis or characterization wrote; None where it wrote none
    better: str | None = None
    bit_depth: int | None = None  # of the converter, where the caller gave it
    effects: tuple[str, ...] = ()  # files of the user's own effects
    transfer: str = "linear"  # how the values of pictures follow from light, `linear` or `srgb`
    options: tuple[str, ...] = ()  # further options of the diagnosis, as on the command line
    # whether the frames are ordinary pictures, whose black level an image that is to look like them keeps
    pictured: bool = False

    @classmethod
    def of(
        cls, camera: "Camera | None", frames: "FrameSet | None", better: str | Path | None = None
    ) -> "Inputs":
        """The files that a camera and frames were loaded from."""
        from visaug.effects.catalogue import loaded_files

        here = Path.cwd()  # paths below it are given from it
        return cls(
            str(frames.loaded_from) if frames and frames.loaded_from else cls.frames,
            (camera and camera.loaded_from) or cls.camera,
            None if better is None else str(better),
            frames.told_bits if frames else None,
            tuple(str(p.relative_to(here) if p.is_relative_to(here) else p) for p in loaded_files()),
            pictured=bool(frames and frames.is_pictures),
        )

    def measuring(self, command: str, camera: str | None, *words: str) -> str:
        """`visaug COMMAND FRAMES --camera CAMERA` with what these frames and effects need."""
        base = (command, self.frames, "--camera", camera or self.camera)
        chosen = self.options if command == "diagnose" else ()
        return _line(*base, *self._depth(), *self._own(), *self._transfer(), *chosen, *words)

    def characterizing(self, on_camera: bool = False) -> str:
        """Args: on_camera: whether the numbers that the frames do not tell come from `camera`."""
        base = ("--camera", self.camera, *self._own()) if on_camera else ()
        return _line("characterize", self.frames, *base, *self._depth(), "-o", "camera.yaml")

    def augmenting(self, camera: str) -> str:
        look = ("--transfer", self.transfer, "--black-level", "keep")
        look = look if self.pictured else self._transfer()
        return _line("augment", "IMAGES", "-o", "noisy/", "--camera", camera, *self._own(), *look)

    def _depth(self) -> tuple[str, ...]:
        return () if self.bit_depth is None else ("--bit-depth", str(self.bit_depth))

    def _transfer(self) -> tuple[str, ...]:
        return () if self.transfer == "linear" else ("--transfer", self.transfer)

    def _own(self) -> tuple[str, ...]:
        return tuple(word for file in self.effects for word in ("--effects", file))


def after_characterization(
    inputs: Inputs, of_pictures: bool = False, has_gain: bool = True, on_camera: bool = False
) -> NextStep:
    """After `visaug characterize`; pictures of an unknown camera cannot be compared with it.
    `has_gain`: whether the gain is known, without which there is no camera file.
    `on_camera`: whether a camera was given beside the frames.
    """
    if not has_gain:
        return NextStep("Next: list the frames that determine the gain, and take them.", "visaug plan")
    if inputs.better is None:
        return NextStep("Next: write the camera file.", inputs.characterizing(on_camera))
    if of_pictures:
        return NextStep(f"Next: train with this camera. {PICTURES}", inputs.augmenting(inputs.better))
    text = "Next: test whether the measured camera explains these frames."
    return NextStep(text, inputs.measuring("compare", inputs.better))


def picture_inputs(result: "PictureComparison") -> Inputs:
    """The target's pictures, and the camera that gave the others its noise."""
    return replace(Inputs.of(result.camera, result.target), transfer=result.transfer, pictured=True)


def after_pictures(content: Mapping[str, Any], inputs: Inputs) -> NextStep:
    """After `visaug compare --target`; the frames of `inputs` are the target's pictures."""
    if content["fits"]["adequate_before"]:
        if inputs.camera != Inputs.camera:
            return NextStep(f"Next: train with this camera. {PICTURES}", inputs.augmenting(inputs.camera))
        return NextStep("Next: train with these pictures, which show no difference from the target.", "")
    text = "Next: measure an effective camera from the target's pictures, to train with its noise."
    return NextStep(text, inputs.characterizing())


def after_comparison(content: Mapping[str, Any], inputs: Inputs) -> NextStep:
    """After `visaug compare` of a camera with frames."""
    if content["fits"]["adequate_before"]:
        return NextStep(f"Next: train with this camera. {PICTURES}", inputs.augmenting(inputs.camera))
    line = inputs.measuring("diagnose", None, "-o", "better.yaml", "--report", "diagnosis.html")
    return NextStep("Next: find the effect that is missing.", line)


def after_diagnosis(content: Mapping[str, Any], inputs: Inputs) -> NextStep:
    if content["fits"]["adequate_before"] and not content.get("camera_file"):
        return NextStep(f"Next: train with this camera. {PICTURES}", inputs.augmenting(inputs.camera))
    interval = content["error"]["interval_after"]
    is_farther = interval is not None and interval[0] > 1  # from the frames than the file as it was given
    # a cause that the catalogue lacks is likelier than what is named
    is_outside = (content.get("outside") or 0.0) > 0.5
    if (content["unexplained"] and not content["accepted"]) or is_farther or is_outside:
        text = "Next: model the difference in a file of your own, and diagnose again with it."
        again = inputs.measuring("diagnose", None, "--effects", "my_effect.py")
        return NextStep(text, f"{_line('effects', 'new', 'my_effect')}\n{again}")
    if inputs.better is None:
        text = "Next: write the corrected camera to a file. Simulated sets are kept, so this takes less time."
        return NextStep(text, inputs.measuring("diagnose", None, "-o", "better.yaml"))
    return NextStep(f"Next: train with the corrected camera. {PICTURES}", inputs.augmenting(inputs.better))


def _line(*words: str) -> str:
    return shlex.join(("visaug", *words))
