"""Runs of a study side by side: in processes of this machine, or by Ray over its cores or over the nodes of a cluster.

Where a run takes place changes nothing of its result, which is in files: a process computes with one thread, a run draws its
random numbers from its own seed, and a later call only reads. So the nodes of a cluster need the output folder, the data and
the cameras under the same paths. A run whose node or process is lost is tried again elsewhere and goes on from its last epoch;
a run that fails by itself is not.
"""

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from visaug.core.cluster import connected
from visaug.core.errors import InputError
from visaug.core.progress import Progress
from visaug.core.wording import counted
from visaug.effects.catalogue import load_file, loaded_files
from visaug_train.config import Cluster
from visaug_train.training import Study, note_failure, run_and_score, run_folder, train_run

Work = Callable[[Study, str, int], Any]
_tell: Any = None  # in a worker: the queue to the process that shows the progress


def spread(
    study: Study, runs: list[tuple[str, int]], work: Work, cluster: Cluster, progress: Progress | None = None
) -> dict[tuple[str, int], str]:
    """Do `work(study, arm, seed)`, which leaves its results in files, for all runs; returns what went wrong, by run."""
    with connected(cluster.address) as ray:
        total = ray.cluster_resources()
        for name, wanted in (("CPU", cluster.cpus_per_run), ("GPU", cluster.gpus_per_run)):
            if wanted > total.get(name, 0):
                problem = f"a run wants {wanted:g}, all nodes together have {total.get(name, 0):g}"
                field = f"cluster.{name.lower()}s_per_run"
                raise InputError(problem, field=field, expected="no more than a node has")
        task = ray.remote(
            num_cpus=cluster.cpus_per_run,
            num_gpus=cluster.gpus_per_run,
            max_retries=cluster.retries,  # of lost workers and nodes alone: an exception is no reason to try again
            scheduling_strategy="SPREAD",
        )(_in_folder)
        study_ref, surroundings = ray.put(study), (str(Path.cwd()), loaded_files())
        waiting = {task.remote(study_ref, work, arm, seed, *surroundings): (arm, seed) for arm, seed in runs}
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


def _in_folder(
    study: Study, work: Work, arm: str, seed: int, folder: str, effects: Sequence[Path]
) -> str | None:
    """On a node: the work, in the driver's working folder, as a config's paths are relative to it, with the files of effects
    that the driver has loaded; what failed.
    """
    os.chdir(folder)
    try:
        for file in effects:
            load_file(file)
        work(study, arm, seed)
    except Exception as error:
        return note_failure(study, arm, seed, error)
    return None


class Workers:
    """Processes that do what is submitted, in this order; they end with the block, or with the process that made them.

    The progress tells of the `runs` that will be submitted; the steps of all are counted together.
    """

    def __init__(self, processes: int, runs: int = 0, progress: Progress | None = None):
        self.runs, self.progress = runs, progress
        context = get_context("spawn")  # a fork would copy locks that threads hold
        self._heard = context.SimpleQueue()
        alive, self._alive = context.Pipe(duplex=False)  # its end is the end of the workers
        self._pool = ProcessPoolExecutor(processes, context, _begin, (self._heard, alive))
        self._teller = threading.Thread(target=self._show, daemon=True)

    def __enter__(self) -> "Workers":
        self._teller.start()
        return self

    def __exit__(self, kind: Any, *_: object) -> None:
        if kind is not None:
            self._alive.close()
        self._pool.shutdown(cancel_futures=kind is not None)
        self._heard.put(None)
        self._teller.join()
        self._alive.close()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        """`function(*arguments, progress)`, a function that can be imported."""
        return self._pool.submit(_call, function, arguments)

    def train(self, study: Study, arm: str, seed: int) -> None:
        """Submit a run, unless it is finished, and its scores."""
        if (run_folder(study, arm, seed) / "run.json").is_file():
            self.runs -= 1
        else:
            self._pool.submit(_run, study, arm, seed)

    def _show(self) -> None:
        steps: dict[tuple[str, int], int] = {}
        for run, title, done, total in iter(self._heard.get, None):
            if run is not None:
                steps[run] = done
                title = f"training, {counted(self.runs, 'run')}"
                done, total = sum(steps.values()), self.runs * total
            if self.progress:
                self.progress(title, done, total)


def _begin(tell: Any, alive: Connection) -> None:
    """In a worker, before anything else."""
    global _tell
    _tell = tell
    threading.Thread(target=_end_with, args=(alive,), daemon=True).start()
    os.environ["OMP_NUM_THREADS"] = "1"  # else a training takes all cores
    import torch

    torch.set_num_threads(1)


def _end_with(alive: Connection) -> None:
    with suppress(EOFError, OSError):
        alive.recv()
    os._exit(1)


def _call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    return function(*arguments, lambda *step: _tell.put((None, *step)))


def _run(study: Study, arm: str, seed: int) -> None:
    train_run(study, arm, seed, lambda *step: _tell.put(((arm, seed), *step)))
    run_and_score(study, arm, seed)
