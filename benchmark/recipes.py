"""What the benchmark asks: one function a kind, each turning a seed into recipes."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from . import cameras, effects, foreign, further, local
from .randomness import stream
from .sets import Recipe
from .strengths import FACTOR, scaled

FEW = 40  # pixels of a large sensor that an effect of single pixels hides in, where it is plain


def _hidden(camera: int, kind: effects.Kind, form: str, word: str) -> tuple[str, float, str] | None:
    strength = scaled(camera, kind.name, form, word)
    return None if strength is None else (kind.name, strength, form)


def _one(
    seed: int,
    camera: int,
    word: str,
    of: str,
    form_of: Callable[[effects.Kind], str | None],
    kinds: tuple[effects.Kind, ...] = effects.KINDS,
) -> Iterator[Recipe]:
    for kind in kinds:
        form = form_of(kind)
        hidden = form and _hidden(camera, kind, form, word)
        if not hidden:
            continue
        yield Recipe(
            f"{of}-{kind.name}-{word}-{seed}", of, word, seed, camera, (hidden,), expect=(kind.name,),
            without=kind.name if of == "leave_out" else None,
            axis=kind.axis, grows=kind.grows, may_grow=kind.may_grow,
        )  # fmt: skip


def single(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """Every effect alone, in the form a catalogue would have."""
    yield from _one(seed, camera, word, "single", lambda kind: "default")


def other_form(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """Every effect alone, in its second form."""
    yield from _one(seed, camera, word, "other_form", lambda kind: kind.other_form)


def further_single(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """As `single`, of the effects in `further`."""
    yield from _one(seed, camera, word, "further", lambda kind: "default", further.KINDS)


def further_other_form(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """As `other_form`, of the effects in `further`."""
    yield from _one(seed, camera, word, "further_other_form", lambda kind: kind.other_form, further.KINDS)


def leave_out(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """Every effect alone, for a catalogue that lacks it."""
    yield from _one(seed, camera, word, "leave_out", lambda kind: "default")


def clean(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """Nothing hidden."""
    yield Recipe(f"clean-{seed}", "clean", "none", seed, camera)


def pairs(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """Two different effects drawn at random."""
    rng = stream(seed, "pair")
    while True:
        chosen = rng.choice(len(effects.KINDS), 2, replace=False)
        hidden = [_hidden(camera, effects.KINDS[i], "default", word) for i in chosen]
        found = tuple(entry for entry in hidden if entry)
        if len(found) == 2:
            break
    names = tuple(entry[0] for entry in found)
    yield Recipe(f"pairs-{'+'.join(names)}-{word}-{seed}", "pairs", word, seed, camera, found, expect=names)


def base_left_out(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """A part of the base chain that the maker does not mention."""
    heavy = {"tail": -0.2}
    cases = {
        "prnu": ({"prnu": 0.0}, {}),
        "dark_current": ({"dark_e_per_s": 0.0}, {}),
        "read_noise": ({"tail": 0.14}, heavy),
    }
    for name, (stated, actual) in cases.items():
        identity = f"base_left_out-{name}-{seed}"
        yield Recipe(
            identity, "base_left_out", "none", seed, camera, stated=stated, actual=actual, expect=(name,)
        )


def off_parameters(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """Nothing hidden, but the maker's numbers are 2 to 6 per cent off."""
    rng, sensor = stream(seed, "off"), cameras.sensor(camera)
    entries = {"e_per_dn": sensor.e_per_dn, "read_e": sensor.read_e, "dark_e_per_s": sensor.dark_e_per_s}
    stated = {n: v * (1 + rng.choice([-1, 1]) * rng.uniform(0.02, 0.06)) for n, v in entries.items()}
    yield Recipe(f"off_parameters-{seed}", "off_parameters", "none", seed, camera, stated=stated)


def wrong_file(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """Nothing hidden, and one figure of camera.yaml wrong in one of the usual ways.

    A figure in DN where electrons are due is left out where a DN is within 30 % of an electron.
    """
    sensor = cameras.sensor(camera)
    gain, long_s = sensor.e_per_dn, max(shot.seconds for shot in cameras.plan(camera) if shot.kind == "dark")
    cases: dict[tuple[str, str], dict[str, float]] = {
        ("gain_e_per_dn", "inverse"): {"e_per_dn": 1 / gain},
        ("read_noise.sigma_e", "unit"): {"read_e": sensor.read_e / gain},
        ("read_noise.sigma_e", "variance"): {"read_e": sensor.read_e**2},
        ("dark_current.a_e_per_s", "unit"): {"dark_e_per_s": sensor.dark_e_per_s / gain},
        ("dark_current.a_e_per_s", "per_frame"): {"dark_e_per_s": sensor.dark_e_per_s * long_s},
        ("dark_current.a_e_per_s", "kelvin"): {
            "dark_e_per_s": sensor.dark_e_per_s * float(np.exp(-273.15 * sensor.dark_per_c))
        },
        ("dsnu.pixel_e", "unit"): {"dsnu_e": 1 / gain},
        ("prnu.pixel", "per_cent"): {"prnu": 100.0},
        ("exposure_s", "time_unit"): {"integration_s": 1e3 * sensor.integration_s},
        ("black_level_dn", "black_level"): {"pedestal_dn": 0.0},
    }
    for (key, mistake), stated in cases.items():
        if mistake in ("unit", "inverse") and abs(np.log(gain)) < np.log(1.3):
            continue
        if mistake == "per_frame" and abs(np.log(long_s)) < np.log(1.3):
            continue
        identity = f"wrong_file-{key}-{mistake}-{seed}"
        yield Recipe(identity, "wrong_file", "none", seed, camera, stated=stated, mistake=(key, mistake))


def small(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """Bias, dark or flat frames alone, clean and with an effect that shows in them."""
    shown = {
        "bias": ("row_noise", "rts_noise"),
        "dark": ("hot_pixels", "amplifier_glow"),
        "flat": ("nonlinearity",),
    }
    for frames, names in shown.items():
        yield Recipe(f"small_{frames}-clean-{seed}", f"small_{frames}", "none", seed, camera)
        for name in names:
            hidden = _hidden(camera, effects.BY_NAME[name], "default", word)
            if hidden:
                identity = f"small_{frames}-{name}-{word}-{seed}"
                yield Recipe(identity, f"small_{frames}", word, seed, camera, (hidden,), expect=(name,))


def unlisted(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """An effect that no catalogue has; the user may bring it as a class of the same name."""
    for kind in foreign.KINDS:
        hidden = _hidden(camera, kind, "default", word)
        if hidden:
            yield Recipe(
                f"foreign-{kind.name}-{word}-{seed}", "foreign", word, seed, camera, (hidden,),
                expect=(kind.name,), axis=kind.axis, grows=kind.grows, may_grow=kind.may_grow,
            )  # fmt: skip


def mixed(seed: int, camera: int, word: str) -> Iterator[Recipe]:
    """An effect of the catalogue beside one that no catalogue has, drawn at random."""
    rng = stream(seed, "mixed")
    while True:
        kind, unknown = (of[rng.integers(len(of))] for of in (effects.KINDS, foreign.KINDS))
        found = [_hidden(camera, each, "default", word) for each in (kind, unknown)]
        if all(found):
            break
    yield Recipe(
        f"mixed-{kind.name}+{unknown.name}-{word}-{seed}", "mixed", word, seed, camera, tuple(filter(None, found)),
        expect=(kind.name,), axis=unknown.axis, grows=unknown.grows, may_grow=unknown.may_grow,
    )  # fmt: skip


def _large(number: int, of: str) -> Callable[[int, int, str], Iterator[Recipe]]:
    """Sets of real size of one camera, whichever the seed draws: clean, in a part of the sensor, in few pixels, with memory."""

    def large(seed: int, _: int, word: str) -> Iterator[Recipe]:
        yield Recipe(f"{of}-clean-{seed}", of, "none", seed, number)
        for kind in local.KINDS:
            hidden = _hidden(number, kind, "default", word)
            if hidden:
                yield Recipe(
                    f"{of}-{kind.name}-{word}-{seed}", of, word, seed, number, (hidden,),
                    expect=local.CATALOGUE[kind.name], axis=kind.axis, grows=kind.grows, may_grow=kind.may_grow,
                )  # fmt: skip
        few = FEW * FACTOR.get(word, 1.0) / np.prod(cameras.sensor(number).shape)
        spread = [(name, float(few), "default") for name in ("hot_pixels", "rts_noise")]
        kept = [("image_lag", "default"), ("black_level_drift", "slow walk")]
        spread += filter(None, (_hidden(number, effects.BY_NAME[name], form, word) for name, form in kept))
        for hidden in spread:
            yield Recipe(
                f"{of}-{hidden[0]}-{word}-{seed}", of, word, seed, number, (hidden,), expect=(hidden[0],)
            )

    return large


KINDS: dict[str, Callable[[int, int, str], Iterator[Recipe]]] = {
    "single": single,
    "clean": clean,
    "pairs": pairs,
    "other_form": other_form,
    "base_left_out": base_left_out,
    "off_parameters": off_parameters,
    "wrong_file": wrong_file,
    "further": further_single,
    "further_other_form": further_other_form,
    "leave_out": leave_out,
    "foreign": unlisted,
    "mixed": mixed,
    "small": small,
    "large_150": _large(cameras.COUNT, "large_150"),  # 150 frames of 200 x 256
    "large_1mpx": _large(cameras.COUNT + 1, "large_1mpx"),  # 60 frames of 1000 x 1000
}
