"""Which frames find an effect, and which confirm it."""

from dataclasses import dataclass

from visaug.frames import FrameSet

FIND, CONFIRM, WHOLE = "find", "confirm", "whole"  # uses of frames: discovery, hold-out, all


@dataclass(frozen=True)
class Folds:
    """Which frames do what, as positions in the set. Every group of equal conditions is shared out, never single pixels."""

    fit: tuple[int, ...]
    select: tuple[int, ...]
    confirm: tuple[int, ...]

    @property
    def find(self) -> tuple[int, ...]:
        """Frames that an effect is found on; the others only confirm it."""
        return tuple(sorted(self.fit + self.select))


def share_out(frames: FrameSet) -> Folds:
    """Of each group two frames in three find (one fits, one selects), the third confirms.

    Groups of one or two frames stay whole, or their temporal noise could not be seen: of a ladder of them every third confirms.
    A scene taken twice is found once and confirmed once.
    """
    fit: list[int] = []
    select: list[int] = []
    confirm: list[int] = []
    small: dict[str, int] = {}
    groups = frames.groups()
    ladder = {kind: sum(g.kind == kind and len(g.indices) < 3 for g in groups) for kind in ("dark", "flat")}
    for group in groups:
        members = sorted(group.indices)
        if len(members) >= 3:
            fit += members[::3]
            select += members[1::3]
            confirm += members[2::3]
        elif group.kind == "scene" and len(members) == 2:
            fit.append(members[0])
            confirm.append(members[1])
        else:
            place = small.setdefault(group.kind, 0)
            small[group.kind] += 1
            middle = 0 < place < ladder.get(group.kind, 0) - 1
            if middle and place % 3 == 1:
                confirm += members
            else:
                fit.append(members[0])
                select += members[1:]
    return Folds(tuple(sorted(fit)), tuple(sorted(select)), tuple(sorted(confirm)))
