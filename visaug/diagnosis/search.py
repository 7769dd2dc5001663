"""Finds missing effects: fit, match, refine, simulate, accept, until the camera is adequate or no effect explains the rest."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from visaug.camera import Camera
from visaug.characterization.alarms import found_by_checks
from visaug.characterization.usable import usable
from visaug.core.cluster import connected
from visaug.core.errors import InputError
from visaug.core.nearest import did_you_mean
from visaug.core.progress import beside
from visaug.core.wording import counted
from visaug.diagnosis.adding import SETS_AFTER, Adding
from visaug.diagnosis.camera_file import corrected, with_enough_photons
from visaug.diagnosis.candidates.selection import candidates
from visaug.diagnosis.candidates.signatures import scanned
from visaug.diagnosis.candidates.trials import looked, trials
from visaug.diagnosis.chance import Chance, chance
from visaug.diagnosis.choice import Accepted, accepted, odds_between
from visaug.diagnosis.criterion import ODDS
from visaug.diagnosis.fitting.errors import Errors
from visaug.diagnosis.fitting.fit import Fitted, refit, settled
from visaug.diagnosis.fitting.parameters import base_coordinates
from visaug.diagnosis.fitting.reference import FAR, STAGES, Reference, Report, is_far, make_reference
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.outcome import outcome
from visaug.diagnosis.ranking import chosen_ranks, ranks
from visaug.diagnosis.ray_executor import by_ray
from visaug.diagnosis.result import Diagnosis
from visaug.diagnosis.stage import History, SearchStage, Setting
from visaug.diagnosis.state import State
from visaug.diagnosis.swap import reconsidered
from visaug.effects import catalogue, load_file
from visaug.frames import FrameSet
from visaug.pictures.part import with_a_well

SETS = 200  # largest number of simulated sets of the camera file
FEWEST = 50  # of fewer no p-value is below the rate of false alarms
MOST = 4  # largest number of steps that add an effect
SMOOTHED = (
    "The frames were smoothed, demosaiced or filtered after they were read: noise of light and of dark frames correlates "
    "alike with that of the next pixels. No effect of the catalogue does that, and none was searched for; diagnose raw frames."
)
STANDS_OUT = 30.0  # deviation, in standard deviations, above which a second starting point is tried


def diagnose(
    camera: Camera | str | Path,
    frames: FrameSet | str | Path,
    effects: Sequence[str | Path] | str | Path = (),
    without: Sequence[str] | str = (),
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
    sets: int = SETS,
    cluster: str | None = None,
    transfer: Literal["linear", "srgb"] = "linear",
    scenes: FrameSet | str | Path | None = None,
) -> Diagnosis:
    """Finds the physical effects that a camera model lacks.

    Args:
        camera: the camera model to test, or its file or name.
        frames: measured bias, dark, flat or scene frames, or the path of a frame set; or ordinary pictures, see
            `visaug.pictures.part`.
        effects: files with your own effects, tried together with those of the catalogue.
        without: effects of the catalogue that are not tried.
        seed: of all simulations. The same seed gives the same result on the same type of processor; others round sums
            differently, which can change a borderline decision.
        progress: called with (description, done, total).
        sets: simulated sets of the camera, 50 or more; fewer are faster and less certain.
        cluster: address of a Ray cluster that runs the simulations, or `local`; None uses the cores of this machine.
        transfer: of ordinary pictures, how their values follow from light.
        scenes: for ordinary pictures, others with such scenes, e.g. the training images; without them scenes are taken to
            have no preferred axis and no centre.

    Returns:
        The accepted effects with their parameters, the error before and after, and what remains unexplained.

    Raises:
        InputError: too few frames or pictures, unknown effects, or fewer than 50 sets.

    Examples:
        >>> import visaug
        >>> result = visaug.diagnose(camera, frames)  # doctest: +SKIP
        >>> result.accepted  # doctest: +SKIP
        ('row_noise',)
    """
    effects = (effects,) if isinstance(effects, str | Path) else effects
    without = (without,) if isinstance(without, str) else without
    for file in effects:
        load_file(file)
    if sets < FEWEST:
        expected = f"at least {FEWEST}: p-values are counted among them"
        raise InputError(f"{sets} simulated sets", field="sets", expected=expected)
    for name in without:
        if name not in catalogue():
            raise InputError(
                f"{name!r} is not an effect" + did_you_mean(name, catalogue()),
                field="without",
                expected="a name that `visaug effects` lists",
            )
    camera = Camera.load(camera)
    frames = FrameSet.of(frames, camera.resolution)
    camera, frames = (
        (with_a_well(camera), frames) if frames.is_pictures else (camera, usable(frames, camera.resolution))
    )
    report = progress or (lambda *_: None)
    of_pictures = {"transfer": transfer, "scenes": None if scenes is None else FrameSet.of(scenes)}
    # linear algebra of a few hundred statistics is slower in several threads, which wait for one another
    one_thread = threadpool_limits(1, user_api="blas")
    with one_thread, nullcontext() if cluster is None else connected(cluster) as ray:
        spread = None if cluster is None else by_ray(ray)
        frames, of_light = with_enough_photons(camera, frames)
        lab = Laboratory(frames, camera, seed, spread=spread, report=report, **of_pictures)
        check_usable(lab)
        right, mistakes = corrected(camera, frames, lab)
        if mistakes:
            lab = Laboratory(frames, right, seed, spread=spread, report=report)
        checks = None if frames.is_pictures else found_by_checks(frames)
        smoothed = checks is not None and checks.smoothed
        found = diagnosed(lab, right, frozenset(without), report, sets, 0 if smoothed else MOST)
    if smoothed and found.unexplained is not None:
        residue = replace(found.unexplained, description=f"{SMOOTHED} {found.unexplained.description}")
        found = replace(found, unexplained=residue)
    return replace(found, given=camera, frame_set=frames, seed=seed, camera_file=(*of_light, *mistakes))


def diagnosed(
    lab: Laboratory, camera: Camera, without: frozenset[str], report: Report, sets: int, most: int = MOST
) -> Diagnosis:
    """The diagnosis of frames that are split already.

    Args:
        most: largest number of steps that add an effect.
    """
    setting, plain, test = tested(lab, camera, without, report, sets)
    history: History = (SearchStage(plain, test.p_value, setting.errors.told(plain.fitted)),)
    nearest: str | None = None
    for _ in range(most):  # steps and not effects, since a step can replace two effects by one
        if not history[-1].is_missing:
            break
        setting, found, nearest = one_more(setting, history)
        history = history if found is None else reconsidered(setting, (*history, found))
        if found is None:
            break
        setting = setting.telling(beside(report, history[-1].state.accepted))
    return outcome(setting, history, nearest)


def check_usable(lab: Laboratory) -> None:
    """Raises InputError where the frames are too few for a split, or each holds one value in all its pixels."""
    if len(lab.folds.find) < 2:
        expected = "at least 4 under some conditions"
        problem = f"{counted(len(lab.frames), 'frame')} cannot be split into frames that find and frames that confirm"
        raise InputError(problem, field="frames", expected=expected)
    if not any(np.ptp(lab.frames.read(i)) for i in range(len(lab.frames))):
        problem = "each holds one value in all its pixels: it has no noise, or is saturated"
        raise InputError(problem, field="frames", expected="frames as the camera gives them")


def tested(
    lab: Laboratory, camera: Camera, without: frozenset[str], report: Report, sets: int
) -> tuple[Setting, State, Chance]:
    """The camera file, simulated and refitted, and whether it is adequate; with as many simulated sets as that takes."""
    first, *more = [stage for stage in STAGES if stage < sets] + [sets]
    null = given_reference(lab, camera, first, report)
    fitted = settled(lab, refit(lab, null, report), min(first, SETS_AFTER), report)
    state = State.plain(fitted, lab.views)
    signs = scanned(lab, null, trials(camera, without), report)
    adding = Adding(lab, null, signs.trials, report)
    test = chance(lab, signs, state)
    for stage in more:
        if test.is_decided:
            break
        is_first = state.fitted.reference is null
        state = adding.grown(state, stage)
        null = state.fitted.reference if is_first else null
        test = chance(lab, signs, state)
    errors = Errors(lab, null, state.fitted)
    return Setting(lab, null, signs, without, adding, errors, report), state, test


def given_reference(lab: Laboratory, camera: Camera, sets: int, report: Report) -> Reference:
    """Simulated sets of the camera file and their derivatives."""
    return make_reference(lab, camera, base_coordinates(camera, lab.frames, lab.calibrated), sets, report)


def one_more(setting: Setting, history: History) -> tuple[Setting, SearchStage | None, str | None]:
    """The stage with one more effect; None, with the name of the nearest effect, if none is accepted.

    If the camera with an effect found from one starting point is not adequate, the other starting point is tried too.
    """
    stage = history[-1]
    state, lab = stage.state, setting.lab
    setting = setting.with_looks(looked)
    taken = setting.without | set(state.accepted)
    nearest, ranked, refined, chosen = None, stage.ranked, dict(stage.refined), []
    for fitted in starts(setting, state):
        if chosen and fitted is not state.fitted and is_fallback(setting, state):
            break
        allowance = state.find.allowance
        found, signs = candidates(lab, setting.signs, fitted, taken, allowance, setting.report, stage.refined)
        setting = replace(setting, signs=signs)
        if not found:
            continue
        if fitted is state.fitted:
            refined |= {r.effect: r for r in found}
            ranked = ranks(setting, state, found, [r.gain for r in found], ranked)
            nearest = found[0].effect if found[0].gain > ODDS else None
        if chosen and found[0].effect == chosen[0].best.refined.effect:
            break  # the same effect again: no further starting point is needed
        one = accepted(state, found, setting.adding)
        if one is not None:
            chosen.append(one)
            if one.best.state.is_adequate:
                break
    if not chosen:
        return setting, None, nearest
    best = likeliest(state, chosen)
    after, test = setting.tested(best.best.state)
    error = stage.error and setting.errors.told(after.fitted)
    ranked, ambiguous = chosen_ranks(setting, state, best, after, error, ranked)
    found = SearchStage(after, test, error, best.standing, refined, ranked, (*stage.ambiguous, *ambiguous))
    return setting, found, None


def likeliest(state: State, chosen: Sequence[Accepted]) -> Accepted:
    """Of what was accepted from different starting points, the most probable."""
    first, *later = chosen
    for one in later:
        if odds_between(state, one.best, first.best) > 0:
            first = one
    return first


def starts(setting: Setting, state: State) -> list[Fitted]:
    """Starting points of the search: the refitted camera, preceded by the given camera if the refit is far from it.

    A strong effect biases the fit of the nuisance parameters until its signature is no longer recognised there. If deviations
    are large without that, the full well may be in a region from which refinement does not converge: the given camera is
    then tried if nothing else is accepted.
    """
    if state.accepted:
        return [state.fitted]
    if is_far(setting.first, state.fitted.camera, 0.5 * FAR):
        return [setting.unfitted, state.fitted]
    return [state.fitted, setting.unfitted] if is_fallback(setting, state) else [state.fitted]


def is_fallback(setting: Setting, state: State) -> bool:
    """Whether the given camera is tried only where nothing is accepted from the refitted one."""
    is_near = not is_far(setting.first, state.fitted.camera, 0.5 * FAR)
    return is_near and float(abs(state.find.z).max()) > STANDS_OUT
