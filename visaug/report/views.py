"""Every view of measured frames beside the same view of modelled ones."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from visaug.report.html import Figure, figure
from visaug.report.plots.view import plot_view

if TYPE_CHECKING:
    from visaug.camera import Camera
    from visaug.frames import FrameSet
    from visaug.statistics import View
    from visaug.statistics.view import ViewPlot


class ViewGallery:
    """Pictures of measured frames beside those that a camera model makes of the same plan.

    Args:
        frames: the measured set.
        camera: the model; one set is simulated with it.
        seed: of that simulation.
        after: the corrected camera, whose frames are shown beside those of `camera`.
    """

    def __init__(
        self, frames: "FrameSet", camera: "Camera", seed: int, after: "Camera | None" = None
    ) -> None:
        from visaug.diagnosis.laboratory import Laboratory
        from visaug.statistics import FrameData

        # full frames before windows: they show the whole sensor
        parts = sorted(Laboratory(frames, camera, seed).parts, key=lambda part: not part.place)
        cameras = [camera] if after is None else [camera, after]
        sets = [[p.frames, *(p.take(c, seed) for c in cameras)] for p in parts]
        self.parts: list[tuple[tuple[View, ...], list[FrameData]]] = [
            (p.views, [FrameData(frames, place=p.place) for frames in taken])
            for p, taken in zip(parts, sets, strict=True)
        ]
        self.sets: tuple[FrameSet, FrameSet] = (sets[0][0], sets[0][1])

    def shown(self, name: str, worst: str = "") -> "tuple[ViewPlot, list[ViewPlot | None]] | None":
        """What a view shows of the measured frames and of each modelled set; None where these frames do not show it.
        `worst`: the statistic that is to be seen, "NAME, FRAMES" as in `Place.worst`.
        """
        parts = [(v, data) for views, data in self.parts for v in views if v.name == name]
        here = [(v, d) for v, d in parts if worst and d[0].place and worst.endswith(d[0].place)]
        for view, data in [*here, *parts]:
            measured, *modelled = (view.picture(frames, worst) for frames in data)
            if measured is not None and _tells(measured):
                same = (measured.x_label, measured.y_label, len(measured.maps))
                # Other axes where flats of one set alone are saturated.
                shown = [p if p and (p.x_label, p.y_label, len(p.maps)) == same else None for p in modelled]
                return measured, shown
        return None

    def pictures(
        self,
        names: Sequence[str],
        captions: dict[str, str] | None = None,
        focus: dict[str, str] | None = None,
    ) -> dict[str, Figure]:
        """Pictures of several views by name, those that these frames show; `focus` names the statistic that each shows."""
        found = {}
        for name in names:
            worst = (focus or {}).get(name, "")
            if (shown := self.shown(name, worst)) is None:
                continue
            measured, (modelled, *after) = shown
            text = f"{measured.title}. {(captions or {}).get(name, '')}".strip()
            drawn = plot_view(measured, modelled, focus=worst, after=after[0] if after else None)
            wide = bool(measured.maps) or drawn.get_figwidth() > 6
            raster = bool(measured.maps) or sum(len(curve.x) for curve in measured.curves) > 4000
            found[name] = figure(drawn, text, wide=wide, raster=raster)
        return found


def all_views() -> list[str]:
    from visaug.statistics import OF_FULL_FRAMES, VIEWS

    return list(dict.fromkeys(view.name for view in (*VIEWS, *OF_FULL_FRAMES)))


def _tells(picture: "ViewPlot") -> bool:
    """Whether there is more to see than a single point or a line at one value."""
    return bool(picture.maps) or any(len(c.x) > 1 and len(np.unique(c.y)) > 1 for c in picture.curves)
