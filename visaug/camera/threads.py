"""A batch's rows shared among threads, for compiled loops that let go of Python's lock."""

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
import torch


def in_threads(work: Callable[[int, int], None], rows: int) -> None:
    """Calls `work(first, last)` until all rows are done, by as many threads as torch has: one in a DataLoader worker."""
    rows_per_task = 64
    threads = min(torch.get_num_threads(), max(1, rows // rows_per_task))
    if threads == 1:
        return work(0, rows)
    tasks_per_thread = 4
    bounds = np.linspace(0, rows, tasks_per_thread * threads + 1).astype(int).tolist()
    tasks = iter(list(itertools.pairwise(bounds)))

    def share() -> None:
        for first, last in tasks:  # shared: who is free takes the next
            work(first, last)

    helpers = [_pool(os.getpid(), threads - 1).submit(share) for _ in range(threads - 1)]
    share()
    for helper in helpers:
        if not helper.cancel():  # one that has not begun finds nothing left to do
            helper.result()
    return None


@lru_cache(maxsize=1)
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """The pool of this process: threads do not survive a fork."""
    return ThreadPoolExecutor(threads, thread_name_prefix=f"visaug-{process}")
