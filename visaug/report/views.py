"""Every view of measured frames beside the same view of modelled ones."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from visaug.report.html import Figure, figure
from visaug.report.plots.view import plot_view

if TYPE_CHECKING:
    from visaug.camera import Camera
    from visaug.frames import FrameSet
    from visaug.statistics import View
    from visaug.statistics.view import Picture


class ViewGallery:
    """Pictures of measured frames beside those that a camera model makes of the same plan.

    Args:
        frames: the measured set.
        camera: the model; one set is simulated with it.
        seed: of that simulation.
    """

    def __init__(self, frames: "FrameSet", camera: "Camera", seed: int = 0) -> None:
        from visaug.diagnosis.laboratory import Laboratory
        from visaug.statistics import FrameData

        # full frames before windows: they show the whole sensor
        parts = sorted(Laboratory(frames, camera, seed).parts, key=lambda part: not part.place)
        taken = [(p, p.take(camera, seed)) for p in parts]
        self.parts: list[tuple[tuple[View, ...], FrameData, FrameData]] = [
            (p.views, FrameData(p.frames, place=p.place), FrameData(modelled, place=p.place))
            for p, modelled in taken
        ]
        self.sets: tuple[FrameSet, FrameSet] = (taken[0][0].frames, taken[0][1])

    def pair(self, name: str) -> "tuple[View, Picture, Picture | None] | None":
        """What a view shows of the measured and of the modelled frames; None where these frames do not show it."""
        shown = ((v, *data) for views, *data in self.parts for v in views if v.name == name)
        view, *data = next(shown, (None,))
        if view is None:
            return None
        measured, modelled = (view.picture(frames) for frames in data)
        return None if measured is None else (view, measured, modelled)

    def figure(self, name: str, caption: str = "", focus: str = "") -> Figure | None:
        """The picture of a view by its name; None where these frames do not show it."""
        found = self.pair(name)
        if found is None:
            return None
        view, measured, modelled = found
        text = f"{view.title}. {caption}".strip()
        drawn = plot_view(measured, modelled, focus=focus)
        wide = bool(measured.maps) or drawn.get_figwidth() > 6
        return figure(drawn, text, wide=wide, raster=bool(measured.maps) or _many_points(measured))

    def pictures(
        self,
        names: Sequence[str],
        captions: dict[str, str] | None = None,
        focus: dict[str, str] | None = None,
    ) -> dict[str, Figure]:
        """Pictures of several views by name, those that these frames show; `focus` names what each shows first."""
        found = {
            name: self.figure(name, (captions or {}).get(name, ""), (focus or {}).get(name, ""))
            for name in names
        }
        return {name: picture for name, picture in found.items() if picture is not None}


def all_views() -> list[str]:
    from visaug.statistics import OF_FULL_FRAMES, VIEWS

    return list(dict.fromkeys(view.name for view in (*VIEWS, *OF_FULL_FRAMES)))


def _many_points(picture) -> bool:
    return sum(len(curve.x) for curve in picture.curves) > 4000
