"""Which image of a set a name in a file of predictions means."""

from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path, PureWindowsPath

from visaug.core.errors import InputError
from visaug_train.datasets import names_of
from visaug_train.speed import PoseSet


class ImageNames:
    """Names of the images of a set, as networks write them: with or without folders and suffix, `/` or `\\` between.

    Args:
        poses: the set.
        elsewhere: names of the images of the folder's other domains and splits, by domain/split. A file of predictions
            may hold these too.
    """

    def __init__(self, poses: PoseSet, elsewhere: Mapping[str, Collection[str]] | None = None) -> None:
        self.poses = poses
        self.domains = {poses.domain, *(name.split("/")[0] for name in elsewhere or {})}
        self.others = {name for names in (elsewhere or {}).values() for name in names}
        self.others |= {Path(name).stem for name in self.others}
        self.names = {name: i for i, name in enumerate(poses.ids)}
        # folders that a name must have
        self.depth = len(PureWindowsPath(poses.ids[0]).parts) if poses.ids else 1
        stems = Counter(map(_stem, poses.ids))
        self.names |= {_stem(name): i for i, name in enumerate(poses.ids) if stems[_stem(name)] == 1}
        # as `convert` names its copies
        self.names |= {name.replace("/", "-"): i for i, name in enumerate(poses.ids)}

    def find(self, text: object, file: Path, field: str) -> int | None:
        """The image's number; None for an image of another domain or split of the folder.

        Raises:
            InputError: no image of the folder has this name; it names `file` and `field`.
        """
        path = PureWindowsPath(text.strip() if isinstance(text, str) else "")
        folders = [part for part in path.parts[:-1] if part in self.domains] or [self.poses.domain]
        whole = "/".join(path.parts[-self.depth :])
        for name in dict.fromkeys((whole, _stem(whole), path.name, path.stem)):
            if name in self.names and (name not in self.others or folders[-1] == self.poses.domain):
                return self.names[name]
            if name in self.others:
                return None
        raise InputError(
            f"{text!r} is no image of {self.poses.name}",
            file=file,
            field=field,
            expected=f"a name such as {self.poses.ids[0]}",
        )

    def none_found(self, file: Path) -> InputError:
        """What to raise for a file whose images are all of other domains."""
        return InputError(
            f"names no image of {self.poses.name}", file=file, expected=f"images such as {self.poses.ids[0]}"
        )


def _stem(name: str) -> str:
    """The name without its suffix, folders kept."""
    folders, slash, file = name.rpartition("/")
    return folders + slash + Path(file).stem


def names_elsewhere(root: str | Path, poses: PoseSet) -> dict[str, set[str]]:
    """Names of the images of all other domains and splits of a folder, by domain/split."""
    own = {file.name for file in poses.files}
    found = {}
    for name, names in names_of(root).items():
        if name.split("/")[0] == poses.domain:
            names = names - own  # a split of the same list
        if names and name != poses.name:
            found[name] = names
    return found
