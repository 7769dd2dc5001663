"""Caches simulated fingerprints for the next diagnosis with the same camera and plan; measured data are never cached."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from types import FunctionType

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.candidates.signatures import Signatures, scanned
from visaug.diagnosis.candidates.trials import Trial
from visaug.diagnosis.fitting.fit import Fitted, refit
from visaug.diagnosis.fitting.parameters import Coordinate
from visaug.diagnosis.fitting.reference import USES, Reference, Report, is_far, make_reference
from visaug.diagnosis.fitting.store import keep, load
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import catalogue

STAGE = 60  # sets that are simulated between two entries of a reference

ROOT = Path(__file__).parents[2]  # of the package


def key(lab: Laboratory, camera: Camera, *words: object) -> str:
    """Name of an entry that depends on the camera and its maps, the plan, the seed and the program's own code."""
    sources = [source_of(name) for name in camera.effect_names]
    maps = [(name, digest(values.numpy().tobytes())) for name, values in camera.maps.items()]
    return digest(
        camera.to_yaml(), maps, [part.identity() for part in lab.parts], lab.seed, _code(), sources, words
    )


def digest(*parts: object) -> str:
    """A name for parts that print as what they are."""
    return hashlib.blake2b(repr(parts).encode(), digest_size=12).hexdigest()


def _code() -> str:
    digest = hashlib.blake2b(digest_size=8)
    rooms = ("core/sampling", "effects", "camera", "frames", "statistics", "pictures", "diagnosis")
    files = [file for room in rooms for file in sorted((ROOT / room).rglob("*.py"))]
    for file in (*files, ROOT / "augment/light.py"):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def source_of(name: str) -> str:
    """Hash of the source of an effect from a user's file; empty for the catalogue's own."""
    for part in vars(catalogue()[name]).values():
        if isinstance(part, FunctionType):
            file = Path(part.__code__.co_filename)
            if file.is_relative_to(ROOT) or not file.is_file():
                return ""
            return hashlib.blake2b(file.read_bytes(), digest_size=8).hexdigest()
    return ""


def reference(
    lab: Laboratory,
    camera: Camera,
    coordinates: Sequence[Coordinate],
    sets: int,
    report: Report,
    known: Reference | None = None,
    begun: Reference | None = None,
) -> Reference:
    """`make_reference`, from the cache if it was computed before.

    Many sets are cached in stages, so that an interrupted diagnosis resumes.
    """
    taken = known and (
        [c.path for c in known.coordinates],
        [getattr(known, use).slopes.tobytes() for use in USES],
    )
    name = key(lab, camera, "reference", sets, list(coordinates), taken, begun and len(begun.sets))
    arrays = load(name)
    if arrays is not None:
        return Reference.from_arrays(camera, coordinates, arrays)
    if begun is None and sets > STAGE:
        earlier = STAGE * ((sets - 1) // STAGE)  # whole stages: the derivatives need the spread of the first
        begun = reference(lab, camera, coordinates, earlier, report, known)
    made = make_reference(lab, camera, coordinates, sets, report, known, begun)
    keep(name, made.arrays())
    return made


def signatures(lab: Laboratory, reference: Reference, tried: Sequence[Trial], report: Report) -> Signatures:
    """`scanned` signatures of the trials, cached by effect, so that a change of one effect keeps the others."""
    of: dict[str, list[Trial]] = {}
    for trial in tried:
        of.setdefault(trial.effect, []).append(trial)
    prefix = key(lab, reference.camera, "signatures", len(reference.sets))
    names = {effect: f"{prefix}-{digest(source_of(effect), own)}" for effect, own in of.items()}
    found = {
        effect: signed for effect, name in names.items() if (signed := _loaded(effect, name)) is not None
    }
    missing = [effect for effect in of if effect not in found]
    made = scanned(lab, reference, [t for effect in missing for t in of[effect]], report)
    for effect in missing:
        found[effect] = made.taken([i for i, t in enumerate(made.trials) if t.effect == effect])
        values = [[list(pair) for pair in t.values] for t in found[effect].trials]
        arrays = {"values": found[effect].values, "variances": found[effect].variances}
        keep(names[effect], {**arrays, "trials": np.array(json.dumps(values))})
    return sum((found[effect] for effect in of), made.taken([]))


def _loaded(effect: str, name: str) -> Signatures | None:
    arrays = load(name)
    if arrays is None:
        return None
    listed = json.loads(str(arrays["trials"]))
    tried = tuple(Trial(effect, tuple((path, value) for path, value in values)) for values in listed)
    return Signatures(tried, arrays["values"], arrays["variances"])


def settled(lab: Laboratory, fitted: Fitted, sets: int, report: Report) -> Fitted:
    """A fit; if it is far from its reference, the variance and derivatives are simulated anew at its end."""
    if not is_far(fitted.reference, fitted.camera):
        return fitted
    near = reference(lab, fitted.camera, fitted.reference.coordinates, sets, report)
    return refit(lab, near, report)
