"""Effects hidden in pictures of unknown scenes, and cameras that hide nothing, as tables for docs/target_studies.md.

python -m scripts.picture_effects RESULTS.jsonl [--clean 40] [--only clean] [--update docs/target_studies.md]

Each case is diagnosed once and appended to RESULTS.jsonl, so that an interrupted run goes on where it stopped. Strengths relative
to the read noise are those of the proof's cameras (train/render/independent_camera.py: banding 1.3, step between the halves
1.6, columns 0.65); row noise is as strong as the columns.
"""

import argparse
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

import visaug
from benchmark import pictures
from visaug.frames import FrameRecord, FrameSet

SIDE, SIZE, SCENES, SETS = (80, 128), 0.5, 60, 100
FEW, MANY = 24, 60  # pictures; many for what few pixels or the light of the scenes tell
READ = 14.0
BASE = pictures.PictureCamera(
    "small well", 3.5, READ, black_dn=12.0, column_fixed_e=2.0, pixel_fixed_e=4.0, prnu=0.01
)
STATED = {
    "name": "as its maker tells it",
    "resolution": list(SIDE),
    "bit_depth": 8,
    "gain_e_per_dn": 3.5,
    "black_level_dn": 12,
    "exposure_s": 0.1,
    "read_noise": {"sigma_e": READ},
    "dsnu": {"column_e": 2.0, "pixel_e": 4.0},
    "prnu": {"pixel": 0.01},
}
COLUMNS = ("dsnu", "fixed_pattern_structure")
TAPS = ("tap_mismatch", "column_parity")  # two blocks of the latter have the same law
HIDDEN = {
    "row noise, 9 e-": ({"row_e": 9.0}, ("row_noise",), FEW),
    "banding, 18 e- at 19 rows": ({"banding_e": 18.0}, ("periodic_banding",), FEW),
    "column pattern, 9 e-": ({"column_fixed_e": 9.0}, COLUMNS, FEW),
    "hot pixels, 0.3 % with 60 e-": ({"hot_share": 0.003, "hot_e": 60.0}, ("hot_pixels",), FEW),
    "blooming, 85 % go on": ({"bloom_share": 0.85}, ("blooming",), MANY),
    "vignetting, 30 % in the corner": ({"corner_loss": 0.3}, ("vignetting",), MANY),
    "step of 22 e- between the halves": ({"tap_e": 22.0}, TAPS, FEW),
}
CONTENTS = ("sunlit", "spacecraft", "natural")
BEGIN, END = "<!-- tables of picture_effects.py -->", "<!-- end of tables -->"


def scenes_of(content: str, seed: int, count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    size = {} if content == "natural" else {"size": SIZE}
    return [getattr(pictures, content)(rng, SIDE, **size) for _ in range(count)]


def as_frames(taken: list[np.ndarray]) -> FrameSet:
    return FrameSet.from_arrays([FrameRecord(i, f"{i}.png", "image") for i in range(len(taken))], taken)


def renders(content: str, seed: int) -> FrameSet:
    """Noiseless pictures of other scenes of the same kind, as a training set has them."""
    scenes = scenes_of(content, seed, SCENES)
    return as_frames([np.rint(255 * s.clip(0, 1)).astype(np.uint8) for s in scenes])


def diagnosed(change: dict[str, float], content: str, seed: int, count: int) -> dict:
    camera = visaug.Camera.load(STATED)
    if "column_fixed_e" in change:
        camera = camera.replace({"dsnu.column_e": 0.0})
    actual = replace(BASE, **change)  # pyrefly: ignore[bad-argument-type]
    taken = pictures.take(actual, scenes_of(content, seed, count), seed)
    found = visaug.diagnose(camera, as_frames(taken), scenes=renders(content, 10_000 + seed), sets=SETS)
    known = {entry.effect: entry for entry in found.ranking}
    numbers = {
        name: {key: e.to_json() for key, e in known[name].parameters.items()} for name in found.accepted
    }
    return {
        "accepted": list(found.accepted),
        "parameters": numbers,
        "p": [found.p_value_before, found.p_value_after],
        "unexplained": found.unexplained and found.unexplained.description,
        "cannot_show": list(found.cannot_show),
        "first": [entry.effect for entry in found.ranking[:3]],
    }


def cases(clean: int, seeds: int) -> dict[str, tuple[dict[str, float], str, int, int]]:
    found = {
        f"{name} #{seed}": (change, "sunlit", seed, count)
        for seed in range(1, seeds + 1)
        for name, (change, _, count) in HIDDEN.items()
    }
    for k in range(clean):
        content = CONTENTS[k % len(CONTENTS)]
        found[f"clean {content} #{k}"] = ({}, content, 100 + k, FEW)
    return found


def tables(results: dict[str, dict]) -> str:
    lines = ["| hidden | pictures | named | in |", "| --- | --- | --- | --- |"]
    right = 0
    for name, (_, expected, count) in HIDDEN.items():
        runs = [r for key, r in results.items() if key.startswith(f"{name} #")]
        if not runs:
            continue
        hits = sum(len(r["accepted"]) == 1 and r["accepted"][0] in expected for r in runs)
        right += hits == len(runs)
        named = sorted({", ".join(r["accepted"]) or "nothing" for r in runs})
        lines.append(f"| {name} | {count} | {'; '.join(named)} | {hits} of {len(runs)} |")
    clean = [r for key, r in results.items() if key.startswith("clean")]
    named = sum(bool(r["accepted"]) for r in clean)
    lines += ["", f"Of {len(clean)} pairs of sets without a hidden effect {named} were given a name."]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path)
    parser.add_argument("--clean", type=int, default=40)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--only", default="", help="cases whose name begins so")
    parser.add_argument("--update", type=Path)
    options = parser.parse_args()
    lines = options.results.read_text().splitlines() if options.results.exists() else []
    results = {key: value for line in lines for key, value in json.loads(line).items()}
    for name, case in cases(options.clean, options.seeds).items():
        if name in results or not name.startswith(options.only):
            continue
        results[name] = diagnosed(*case)
        with options.results.open("a") as file:
            file.write(json.dumps({name: results[name]}) + "\n")
        print(name, results[name]["accepted"], results[name]["p"], flush=True)
    print(tables(results))
    if options.update:
        text = options.update.read_text()
        body = "\n".join([BEGIN, "", tables(results), "", END])
        options.update.write_text(re.sub(f"{BEGIN}.*{END}", lambda _: body, text, flags=re.DOTALL))


if __name__ == "__main__":
    main()
