"""How often is a mistake in a camera file named, and is none named in a right file?

    python -m benchmark make 34001-34010 -o files --kinds wrong_file
    python -m scripts.camera_files files             (about 3 s of a core for a set)

Looks at the file and the frames of each set as `diagnose` does first, and goes no further. Sets of other kinds count as right
files, whatever effects are hidden in their frames. The folder of answers lies beside that of the sets.
"""

import argparse
import json
from collections import Counter
from pathlib import Path

from benchmark.judge import beside, names_mistake, share
from visaug import Camera, FrameSet
from visaug.characterization.usable import usable
from visaug.core.errors import InputError
from visaug.diagnosis.camera_file import corrected
from visaug.diagnosis.laboratory import Laboratory


def named(folder: Path) -> list[tuple[str, str]]:
    """Key and kind of the mistakes that are named for a set; a file that is refused names a value in per cent."""
    try:
        camera = Camera.load(folder / "camera.yaml")
    except InputError as error:
        return [(str(error.field), "per_cent")] if "a fraction" in str(error) else []
    frames = usable(FrameSet.of(folder, camera.resolution), camera.resolution)
    return [(m.key, m.mistake) for m in corrected(camera, frames, Laboratory(frames, camera))[1]]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+")
    counts: Counter[tuple[str, bool]] = Counter()
    for folder in parser.parse_args().folders:
        for file in sorted(beside(folder, "answers").glob("*.json")):
            answer = json.loads(file.read_text())
            told = named(folder / answer["identity"])
            mistake = answer["mistake"]
            is_right = names_mistake(mistake, told) if mistake else not told
            counts[mistake[1] if mistake else "none", is_right] += 1
            if not is_right:
                print(f"{answer['identity']}: {told or 'nothing named'}", flush=True)
    print("\n| mistake | right |\n| --- | --- |")
    wrong = sorted({kind for kind, _ in counts} - {"none"})
    for kind in wrong:
        print(f"| {kind} | {counts[kind, True]} of {counts[kind, True] + counts[kind, False]} |")
    hits = sum(counts[kind, True] for kind in wrong)
    print(f"| all mistakes | {share(hits, hits + sum(counts[kind, False] for kind in wrong))} |")
    print(f"| no mistake | {share(counts['none', True], counts['none', True] + counts['none', False])} |")


if __name__ == "__main__":
    main()
