"""Effects put into real frames: the EMVA 1288 reference set of a 12-bit CCD (Basler, CC BY-SA 3.0).

Readout effects are added in electrons and rounded again; where an effect is zero every pixel keeps its
code. What the CCD itself hides stays in, so an answer is judged against the answer to the untouched frames.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from . import cameras, effects
from .camera import Hidden, Moment, Sensor, Shot
from .randomness import stream
from .sets import Recipe, write_taken
from .strengths import scaled

ROWS, COLUMNS = 200, 256
INJECTED = (
    "row_noise", "column_noise", "flicker_noise", "periodic_banding", "tap_mismatch", "row_parity",
    "rts_noise", "dead_pixels", "interpixel_crosstalk", "nonlinearity", "bit_truncation", "missing_codes",
)  # fmt: skip
LIKE = 6  # of the ten cameras, the one whose format and bit depth are nearest

# Published with the frames (release 3 of the standard): K 0.2808 DN/e-, 10.9 e- dark noise, PRNU 0.43 %,
# DSNU 0.55 e-.
CCD = Sensor(
    name="EMVA 1288 reference CCD", rows=ROWS, columns=COLUMNS, bits=12, efficiency=0.4514, e_per_dn=3.5616,
    pedestal_dn=0.0, well_e=13972.6, integration_s=0.00516, celsius=20.0, read_e=10.898, tail=0.14,
    dark_e_per_s=3.845, dark_per_c=0.1, prnu=(0.0, 0.0, 0.004327), dsnu_e=(0.0, 0.0, 0.5518),
)  # fmt: skip


def read(
    folder: Path, window: tuple[slice, slice], levels: int = 9, stack: int = 12
) -> tuple[list[Shot], np.ndarray]:
    """A plan and its frames.

    `levels` of the sweep with their dark frames, and `stack` of each of the two stacks.
    """
    blocks: list[tuple[str, float, float | None, list[str]]] = []
    for line in (folder / "EMVA1288_Data.txt").read_text(encoding="latin-1").splitlines():
        words = line.split()
        if words[:1] in (["b"], ["d"]):
            blocks.append((words[0], float(words[1]) * 1e-9, float(words[2]) if len(words) > 2 else None, []))
        elif words[:1] == ["i"] and blocks:
            blocks[-1][3].append(words[1].replace("\\", "/"))
    sweep = sorted({seconds for kind, seconds, _, names in blocks if kind == "b" and len(names) <= 4})
    chosen = {sweep[i] for i in np.linspace(0, len(sweep) - 1, levels).round().astype(int)}
    plan, frames = [], []
    for kind, seconds, photons, names in blocks:
        if len(names) <= 4 and seconds not in chosen:
            continue
        for name in names[:stack]:
            plan.append(Shot("flat" if kind == "b" else "dark", seconds, CCD.celsius, photons=photons))
            frames.append(np.asarray(Image.open(folder / name)).astype(np.uint16)[window])
    return plan, np.array(frames)


def inject(frames: np.ndarray, plan: list[Shot], sensor: Sensor, hidden: Hidden, seed: int) -> np.ndarray:
    """Put one readout or digital effect into frames."""
    memory: dict = {}
    out = np.empty_like(frames)
    for i, (shot, frame) in enumerate(zip(plan, frames, strict=True)):
        at = Moment(sensor, shot, i, hidden.form, seed, hidden.name, memory, 0.0)
        dn = frame.astype(float)
        if hidden.stage == "voltage":
            x = (dn - sensor.pedestal_dn) * sensor.e_per_dn
            dn = dn + np.rint((hidden.act(x, hidden.strength, at) - x) / sensor.e_per_dn + 1e-9)
        elif hidden.stage == "code":
            dn = hidden.act(dn, hidden.strength, at)
        out[i] = np.clip(dn, 0, 2**sensor.bits - 1)
    return out


def write_real_sets(source: Path, seeds: list[int], word: str, folder: Path, answers: Path) -> int:
    """One untouched set a seed (a window of its own), and one for each injected effect."""
    made = 0
    for seed in seeds:
        rng = stream(seed, "window")
        top, left = int(rng.integers(480 - ROWS)), int(rng.integers(640 - COLUMNS))
        plan, frames = read(source, (slice(top, top + ROWS), slice(left, left + COLUMNS)))
        darkest = min(shot.seconds for shot in plan if shot.kind == "dark")
        shortest = [shot.kind == "dark" and shot.seconds == darkest for shot in plan]
        sensor = replace(CCD, pedestal_dn=round(float(frames[shortest].mean()), 2))
        for name in ("nothing", *INJECTED):
            identity = f"real-{name}-{word}-{seed}" if name != "nothing" else f"real-nothing-{seed}"
            hidden: tuple[tuple[str, float, str], ...] = ()
            shown = frames
            if name != "nothing":
                kind = effects.BY_NAME[name]
                strength = scaled(LIKE, name, "default", word)
                if strength is None:
                    continue
                if kind.unit.startswith("e-"):
                    strength *= sensor.read_e / cameras.sensor(LIKE).read_e
                hidden = ((name, strength, "default"),)
                shown = inject(frames, plan, sensor, kind.at(strength), seed)
            recipe = Recipe(identity, "real", word, seed, -1, hidden, expect=tuple(h[0] for h in hidden))
            write_taken(recipe, shown, plan, {}, sensor, folder, answers)
            made += 1
    return made
