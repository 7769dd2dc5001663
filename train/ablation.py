"""Train the arms of a config with all else equal, score them on all test sets, and say what differs and how
surely.

Everything that is finished is kept: runs by their folders, predictions beside them. A run that fails is noted
and the others go on; the same command tries it again.
"""

import shutil
from collections.abc import Callable

from visaug.core.errors import InputError
from visaug.core.files import write_text
from visaug.core.progress import Progress
from visaug_train.checks import check_arms
from visaug_train.cluster import spread
from visaug_train.config import Config
from visaug_train.results import Ablation, Failure
from visaug_train.scoring import run_and_score
from visaug_train.strength import strengths
from visaug_train.training import note_failure, prepare, start_network


def ablate(
    config: Config, progress: Progress | None = None, announce: Callable[[str], None] | None = None
) -> Ablation:
    """Runs the unfinished part of a study and scores it.

    Args:
        config: the study.
        progress: called with (description, done, total).
        announce: gets, before any training, what this device does otherwise than asked, the hours that it costs, and how strong
            the arms' noise is (also in noise.md).
    """
    check_arms(config, announce)
    shutil.rmtree(config.output / "failures", ignore_errors=True)  # of an earlier try
    study = prepare(config, progress, announce)
    config = study.config
    noise = strengths(study)
    write_text(config.output / "noise.md", noise.text() + "\n")
    if announce is not None:
        announce(noise.text())
    runs = [(arm, seed) for seed in config.seeds for arm in config.arms]
    try:
        start_network(study, progress)  # before the runs are spread, for all start from it
    except Exception as error:
        said = note_failure(study, "start", config.start.seed if config.start else 0, error)
        where = config.output / "failures"
        raise InputError(
            f"the network that all runs start from could not be trained ({said})", file=where
        ) from error
    lost = spread(study, runs, run_and_score, config.cluster, progress) if config.cluster else {}
    scored, failures, others = {}, [], {}
    for arm, seed in runs:
        if (arm, seed) in lost:
            failures.append(Failure(arm, seed, lost[arm, seed]))
            continue
        try:
            run, scored_sets, others[arm, seed] = run_and_score(study, arm, seed, progress)
            scored[arm, seed] = run, scored_sets
        except Exception as error:
            failures.append(Failure(arm, seed, note_failure(study, arm, seed, error)))
    if not scored:
        first = failures[0].error if failures else "no arm"
        raise InputError(f"no run ended well ({first})", file=config.output / "failures")
    return Ablation(study, scored, tuple(failures), noise, {k: v for k, v in others.items() if v})
