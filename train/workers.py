"""Work of a study side by side in processes of this machine.

A process computes with one thread, and a run draws its random numbers from its own seed. Results are thus the same bits for
any number of processes. They are in files, so that a later call only reads.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from visaug.core.progress import Progress
from visaug.core.wording import counted
from visaug_train.scoring import run_and_score
from visaug_train.training import Study, run_folder, train_run

_tell: Any = None  # in a worker: the queue to the process that shows the progress


class Workers:
    """Processes that do what is submitted, in this order; they end with the block, or with the process that made them.

    Args:
        processes: at a time.
        runs: that will be submitted, of which the progress tells.
        progress: called with (description, done, total); the steps of all runs are counted together.
    """

    def __init__(self, processes: int, runs: int = 0, progress: Progress | None = None):
        self.runs, self.progress = runs, progress
        context = get_context("spawn")  # a fork would copy locks that threads hold
        self._heard = context.SimpleQueue()
        alive, self._alive = context.Pipe(duplex=False)  # its end is the end of the workers
        self._pool = ProcessPoolExecutor(
            processes, context, initializer=_begin, initargs=(self._heard, alive)
        )
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
