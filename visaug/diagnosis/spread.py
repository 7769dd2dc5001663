"""Simulations spread over the cores of this machine."""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import os
import pickle
import signal
import stat
import sys
import threading
import time
import warnings
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from visaug.camera import Camera
from visaug.core.cores import cores
from visaug.core.errors import with_user_line
from visaug.core.memory import keep_freed
from visaug.diagnosis.part import MeasuredFrames, Shared
from visaug.effects import catalogue
from visaug.pictures.part import PicturePart

Job = tuple[Camera, int]  # and the number of the simulation
Part = MeasuredFrames | PicturePart
Spread = Callable[["Work", Sequence[Job]], Iterable[tuple[np.ndarray, ...]]]
MOST = 16  # workers: each needs 100 to 200 MB of its own
_of_thread = threading.local()


@dataclass(frozen=True)
class Work:
    """Simulates sets and takes their fingerprints, for some uses of the frames."""

    parts: Sequence[Part]
    seed: int
    uses: tuple[str, ...]

    def __call__(self, job: Job) -> tuple[np.ndarray, ...]:
        """Of one simulated set: one array of values for each use of its frames."""
        camera, number = job
        seed, shared = self.seed * 1_000_003 + number, self._shared(number)
        found = [part.simulated(camera, seed, self.uses, shared) for part in self.parts]
        return tuple(np.concatenate(values) for values in zip(*found, strict=True))

    def _shared(self, number: int) -> Shared:
        """What simulated sets of this number have in common, in this thread; that of another number is dropped."""
        last = getattr(_of_thread, "last", None)
        if last is None or last[0] is not self.parts or last[1] != number:
            last = _of_thread.last = self.parts, number, Shared.empty()
        return last[2]


def forget() -> None:
    """Drops what sets that this thread simulated last have in common."""
    vars(_of_thread).clear()


def on_this_machine() -> Spread:
    """By processes where they can be forked, else by threads, which hold one another up."""
    is_child = multiprocessing.current_process().daemon  # of a DataLoader, for instance
    return by_threads() if workers() == 1 or is_child or sys.platform != "linux" else Forked()


def workers() -> int:
    """Sets that are simulated at a time."""
    return min(cores(), MOST)


def by_threads() -> Spread:
    """The results in the order of the jobs, from threads of this process."""

    def spread(work: Work, jobs: Sequence[Job]) -> Iterator[tuple[np.ndarray, ...]]:
        with _single_threads(), ThreadPoolExecutor(workers()) as pool:
            yield from pool.map(work, jobs)

    return spread


class _single_threads:
    """One torch thread per set: whole sets run in parallel."""

    def __enter__(self) -> None:
        self.before = torch.get_num_threads()
        torch.set_num_threads(1)

    def __exit__(self, *_: object) -> None:
        torch.set_num_threads(self.before)


class Forked:
    """The results in the order of the jobs, from processes that are forked for the first ones and wait for more.

    Plan and effects are inherited, so that only cameras and results travel. Where effects were loaded since, the processes are
    forked anew; those of another object end when this one forks, as each set of processes has its own memory. If one is
    killed, threads of this process do what is left, and all where not its main thread asks: a server's connections and locks
    are not to be copied.
    """

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._effects: dict = {}
        self._threads: Spread | None = None
        weakref.finalize(self, forget)  # of the sets that this process simulated itself

    def __call__(self, work: Work, jobs: Sequence[Job]) -> Iterator[tuple[np.ndarray, ...]]:
        done = 0
        if self._pool is None and threading.current_thread() is not threading.main_thread():
            self._threads = self._threads or by_threads()
        if self._threads is None:
            try:
                for result in self._by_processes(work, jobs):
                    yield result
                    done += 1
                return
            except BrokenProcessPool:
                self._threads = by_threads()
        yield from self._threads(work, jobs[done:])

    def _by_processes(self, work: Work, jobs: Sequence[Job]) -> Iterator[tuple[np.ndarray, ...]]:
        if self._pool is None and jobs:  # compiled loops that this process has loaded are inherited
            with _single_threads():
                yield work(jobs[0])
            jobs = jobs[1:]
        if not jobs:
            return
        pool = self._forked(work)
        last: list = [None, b""]

        def submitted(camera: Camera, number: int) -> Future:
            if camera is not last[0]:
                last[:] = camera, pickle.dumps((camera.spec, camera.folder, camera.maps))
            return pool.submit(_in_process, work.uses, last[1], number)

        coming = itertools.starmap(submitted, jobs)
        waiting = deque(itertools.islice(coming, 2 * workers()))  # each process has its next job at hand
        try:
            while waiting:
                result = waiting.popleft().result()
                waiting.extend(itertools.islice(coming, 1))
                yield result
        finally:
            for future in waiting:
                future.cancel()

    def rest(self) -> None:
        """Ends the processes, whose memory is free then; those of the next jobs are forked anew."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def _forked(self, work: Work) -> ProcessPoolExecutor:
        global _latest
        if self._pool is None or self._effects != dict(catalogue()):
            other = None if _latest is None else _latest()
            if other is not None:
                other.rest()
            self.rest()
            _latest = weakref.ref(self)
            self._effects = dict(catalogue())
            self._pool = ProcessPoolExecutor(
                workers(), multiprocessing.get_context("fork"), _begin, (work, os.getpid())
            )
            # waits for its thread, which would else close a pipe while the interpreter ends and writes to it
            weakref.finalize(self, self._pool.shutdown)
            with warnings.catch_warnings():
                # of threads that a fork does not copy: the children use none of them
                warnings.simplefilter("ignore", DeprecationWarning)
                self._pool.submit(int).result()
        return self._pool


_latest: weakref.ref[Forked] | None = None  # that has forked
_work: Work | None = None  # of a forked process


def _begin(work: Work, parent: int) -> None:
    global _work
    keep_freed()
    for name in os.listdir("/proc/self/fd"):  # an open connection ends with the parent's
        with contextlib.suppress(OSError):
            if stat.S_ISSOCK(os.fstat(int(name)).st_mode):
                os.close(int(name))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends the work
    torch.set_num_threads(1)
    threadpool_limits(1, user_api="blas")
    _work = work
    threading.Thread(target=_with_parent, args=(parent,), daemon=True).start()


def _with_parent(parent: int) -> None:
    """Ends this process with the one that forked it, however that ends: looks every two seconds whether it is still there."""
    while os.getppid() == parent:
        time.sleep(2.0)
    os._exit(1)


def _in_process(uses: tuple[str, ...], camera: bytes, number: int) -> tuple[np.ndarray, ...]:
    assert _work is not None
    try:
        has_maps = len(camera) > 2**16  # bytes
        made = _camera if has_maps else _small_camera
        return replace(_work, uses=uses)((made(camera), number))
    except Exception as error:
        raise with_user_line(error) from None


@lru_cache(maxsize=1)
def _camera(packed: bytes) -> Camera:
    """A camera with the effects of this process; made once for sets of one camera that follow one another."""
    return Camera(*pickle.loads(packed))


_small_camera = lru_cache(maxsize=64)(_camera.__wrapped__)  # for sets of many cameras in turn
