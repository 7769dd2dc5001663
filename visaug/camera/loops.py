"""Compiled loops over the rows of a batch, shared among threads: the loops let go of Python's lock."""

import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor


@cache
def kernel() -> Any:
    """The compiled loop's module, or None where numba cannot be imported."""
    try:
        from visaug.camera import fast_kernel
    except ImportError:
        return None
    return fast_kernel


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


def in_kernel(
    source: Tensor,
    out: Tensor,
    numbers: np.ndarray,
    keys: np.ndarray,
    lines: Sequence[np.ndarray],
    maps: Sequence[np.ndarray],
    origin: tuple[int, int],
    white: int = 0,
) -> None:
    """Calls the kernel, whose `expose` explains the arguments, in threads."""
    channels, height, width = source.shape[1:]
    flat = [x.detach().numpy().reshape(-1) for x in (source, out)]
    rows, maps = ([x.reshape(-1) for x in some] for some in (lines[:2], maps))
    k, same = kernel(), (channels, numbers, keys, *rows, *lines[2:], *maps, origin, np.float32(white))

    def share(first: int, last: int) -> None:
        k.expose(*flat, (height, width), first, last, *same, *k.scratch(width))

    in_threads(share, len(flat[0]) // width)


def ends(images: Tensor) -> tuple[float, float]:
    """Least and greatest value of images, missing ones aside; inf and -inf where all are missing.

    torch's own reduction starts its threads anew for each call, which costs a small image more than its noise.
    """
    if images.device.type != "cpu" or images.dtype != torch.float32:
        there = images.isnan()
        low, high = images.masked_fill(there, torch.inf).min(), images.masked_fill(there, -torch.inf).max()
        least, greatest = torch.stack([low, high]).tolist()  # one wait for the device
        return least, greatest
    rows = images.detach().contiguous().numpy().reshape(-1, images.shape[-1])
    found: list[tuple[float, float]] = []

    def share(first: int, last: int) -> None:
        some = rows[first:last]
        low, high = np.fmin.reduce(some, None, initial=np.inf), np.fmax.reduce(some, None, initial=-np.inf)
        found.append((float(low), float(high)))

    in_threads(share, len(rows))
    return min(low for low, _ in found), max(high for _, high in found)
