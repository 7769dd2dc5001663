"""Which image of a set a name in a file of predictions means."""

from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path, PureWindowsPath

from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug_train.speed import PoseSet, listings


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
        self.names = {file.name: i for i, file in enumerate(poses.files)}
        stems = Counter(file.stem for file in poses.files)
        self.names |= {file.stem: i for i, file in enumerate(poses.files) if stems[file.stem] == 1}

    def find(self, text: object, file: Path, field: str) -> int | None:
        """The image's number; None for an image of another domain or split of the folder.

        Raises:
            InputError: no image of the folder has this name; it names `file` and `field`.
        """
        path = PureWindowsPath(text.strip() if isinstance(text, str) else "")
        folders = [part for part in path.parts[:-1] if part in self.domains] or [self.poses.domain]
        for name in (path.name, path.stem):
            if name in self.names and (name not in self.others or folders[-1] == self.poses.domain):
                return self.names[name]
            if name in self.others:
                return None
        raise InputError(
            f"{text!r} is no image of {self.poses.name}",
            file=file,
            field=field,
            expected=f"a name such as {self.poses.files[0].name}",
        )

    def none_found(self, file: Path) -> InputError:
        """What to raise for a file whose images are all of other domains."""
        return InputError(
            f"names no image of {self.poses.name}",
            file=file,
            expected=f"images such as {self.poses.files[0].name}",
        )


def names_elsewhere(root: str | Path, poses: PoseSet) -> dict[str, set[str]]:
    """Names of the images of all other domains and splits of a folder, by domain/split."""
    own = {file.name for file in poses.files}
    found = {}
    for name, (listing, _) in listings(Path(root)).items():
        records = read_json(listing)
        names = (
            {str(r.get("filename")) for r in records if isinstance(r, dict)}
            if isinstance(records, list)
            else set()
        )
        if name.split("/")[0] == poses.domain:
            names -= own  # a split of the same list
        if names and name != poses.name:
            found[name] = names
    return found
