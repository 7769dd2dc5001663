"""Long work, one piece after the other in one thread, so that the page stays usable meanwhile."""

import sys
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

from visaug.core.errors import InputError
from visaug.core.progress import Progress, phase_of

Work = Callable[[Progress], str | None]


class _Stopped(Exception):
    """The work was told to stop."""


@dataclass
class _Job:
    """One piece of work and how far it is; the last of its phases is going on."""

    title: str
    work: Work
    began: float = 0.0
    stopped: bool = False
    replaced: bool = False
    phases: list[tuple[str, float, float]] = field(default_factory=list)  # name, began, ended
    step: tuple[str, int, int] = ("", 0, 0)  # description, done, total

    def tell(self, description: str, done: int, total: int) -> None:
        """The `progress` of the work."""
        if self.stopped:
            raise _Stopped
        now = time.monotonic()
        name = phase_of(description)
        if not self.phases or self.phases[-1][0] != name:
            self.phases.append((name, now, now))
        self.phases[-1] = (*self.phases[-1][:2], now)
        self.step = (description, done, total)

    def as_json(self) -> dict[str, Any]:
        step = dict(zip(("step", "done", "total"), self.step, strict=True))
        phases = [{"name": name, "seconds": ended - began} for name, began, ended in self.phases[:-1]]
        return {"title": self.title, **step, "seconds": time.monotonic() - self.began, "phases": phases}


class JobQueue:
    """A queue with one worker. `version` goes up whenever there is something new to show; `message` is one line on what came of the
    work, until something else is asked, and `failed` says whether that is a mistake or failure.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="lab")
        self._lock = Lock()
        self._waiting: list[_Job] = []
        self._now: _Job | None = None
        self.version = 0
        self.message: str | None = None
        self.failed = False

    def ask(self, title: str, work: Work, instead_of: tuple[str, ...] = ()) -> None:
        """Put work in the queue, with a title as the page says it; refused where the same waits or runs already.

        `work` is called with `progress(description, done, total)` and may return a line to show. Work of the titles `instead_of` is
        dropped, or stopped without a word, because this takes its place.
        """
        job = _Job(title, work)
        with self._lock:
            self._waiting = [other for other in self._waiting if other.title not in instead_of]
            if self._now and self._now.title in instead_of:
                self._now.stopped = self._now.replaced = True
            there = [other for other in (self._now, *self._waiting) if other and not other.replaced]
            if title in [other.title for other in there]:
                raise InputError(f"{title} is under way already")
            self._waiting.append(job)
            self.message = None
        self._pool.submit(self._run, job)

    def stop(self) -> None:
        """End what runs at its next step, and drop what waits."""
        with self._lock:
            self._waiting.clear()
            if self._now:
                self._now.stopped = True

    def changed(self) -> None:
        """There is something new to show that no work brought."""
        with self._lock:
            self.version += 1

    def close(self) -> None:
        self.stop()
        self._pool.shutdown(wait=True, cancel_futures=True)

    def wait(self) -> None:
        """Until everything that was asked so far is done."""
        self._pool.submit(lambda: None).result()

    def as_json(self) -> dict[str, Any]:
        with self._lock:
            said = {"version": self.version, "message": self.message, "failed": self.failed}
            job = self._now.as_json() if self._now else None
            return {**said, "job": job, "waiting": [waiting.title for waiting in self._waiting]}

    def _run(self, job: _Job) -> None:
        with self._lock:
            if job not in self._waiting:  # dropped meanwhile
                return
            self._waiting.remove(job)
            self._now, job.began = job, time.monotonic()
        message, failed = None, True
        try:
            message, failed = job.work(job.tell), False
        except _Stopped:
            message, failed = None if job.replaced else f"{job.title}: stopped", False
        except (InputError, OSError) as mistake:
            message = " ".join(str(mistake).split())
        except BaseException as failure:  # a user's effect may raise anything, SystemExit too
            traceback.print_exc(file=sys.stderr)
            message = f"{job.title} failed: {type(failure).__name__}: {' '.join(str(failure).split())}"
        with self._lock:
            self._now = None
            if message:
                self.message, self.failed = message, failed
            self.version += 1
