"""Runs of a study spread by Ray over the cores of this machine, or over the nodes of a cluster.

Ray only determines where a run takes place. Its results are in files, as without Ray, so the nodes of a
cluster need the output folder, the data and the cameras under the same paths. A run whose node or process is lost
is tried again elsewhere and goes on from its last epoch; a run that fails by itself is not.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from visaug.core.cluster import connected
from visaug.core.errors import InputError
from visaug.core.progress import Progress
from visaug_train.config import Cluster
from visaug_train.training import Study, note_failure

Work = Callable[[Study, str, int], Any]


def spread(
    study: Study,
    runs: Sequence[tuple[str, int]],
    work: Work,
    cluster: Cluster,
    progress: Progress | None = None,
) -> dict[tuple[str, int], str]:
    """Do `work(study, arm, seed)` for all runs; returns what went wrong, by run.

    Args:
        work: leaves its results in files; a function that can be imported, or pickled by value.
        progress: called when a run has ended.
    """
    with connected(cluster.address) as ray:
        total = ray.cluster_resources()
        for name, wanted in (("CPU", cluster.cpus_per_run), ("GPU", cluster.gpus_per_run)):
            if wanted > total.get(name, 0):
                raise InputError(
                    f"a run wants {wanted:g}, all nodes together have {total.get(name, 0):g}",
                    field=f"cluster.{name.lower()}s_per_run",
                    expected="no more than a node has",
                )
        task = ray.remote(
            num_cpus=cluster.cpus_per_run,
            num_gpus=cluster.gpus_per_run,
            max_retries=cluster.retries,  # of lost workers and nodes alone: an exception is no reason to try again
            scheduling_strategy="SPREAD",
        )(_in_folder)
        study_ref, here = ray.put(study), str(Path.cwd())
        waiting = {task.remote(study_ref, work, arm, seed, here): (arm, seed) for arm, seed in runs}
        wrong: dict[tuple[str, int], str] = {}
        while waiting:
            (ready,), _ = ray.wait(list(waiting), num_returns=1)
            run = waiting.pop(ready)
            try:
                error = ray.get(ready)
            except ray.exceptions.RayError as lost:  # tried as often as it may be
                error = note_failure(study, *run, lost)
            if error is not None:
                wrong[run] = error
            if progress:
                nodes = sum(bool(node["Alive"]) for node in ray.nodes())
                progress(f"runs on {nodes} nodes", len(runs) - len(waiting), len(runs))
        return wrong


def _in_folder(study: Study, work: Work, arm: str, seed: int, folder: str) -> str | None:
    """On a node: the work, in the driver's working folder, as a config's paths are relative to it; what failed."""
    os.chdir(folder)
    try:
        work(study, arm, seed)
    except Exception as error:
        return note_failure(study, arm, seed, error)
    return None
