"""Simulations on the nodes of a Ray cluster."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from visaug.camera import Camera
from visaug.camera.chain import is_own
from visaug.diagnosis.laboratory import Job, Work
from visaug.diagnosis.spread import forget
from visaug.effects import Effect, catalogue, register

AT_ONCE = 4  # sets in one task: a set takes tenths of a second, a task some milliseconds to place


def by_ray(ray: Any) -> Callable[[Work, Sequence[Job]], Iterator[tuple[np.ndarray, ...]]]:
    """Spreads a laboratory's simulations over Ray: the same numbers in the same order, whatever node they come from.

    The nodes need this package and nothing else: plan, cameras and effects of a user's own travel with the task.

    Args:
        ray: the connected module, see `visaug.core.cluster.connected`.
    """
    task = ray.remote(_several)

    def spread(work: Work, jobs: Sequence[Job]) -> Iterator[tuple[np.ndarray, ...]]:
        own = [effect for effect in catalogue().values() if is_own(effect)]
        shared = ray.put((work, own))
        cut = [list(jobs[i : i + AT_ONCE]) for i in range(0, len(jobs), AT_ONCE)]
        for waiting in [task.remote(shared, part) for part in cut]:
            yield from ray.get(waiting)

    return spread


def _several(
    shared: tuple[Work, list[type[Effect]]], jobs: list[tuple[Camera, int]]
) -> list[tuple[np.ndarray, ...]]:
    import torch

    torch.set_num_threads(1)
    work, own = shared
    for effect in own:
        if effect.name not in catalogue():
            register(effect)
    try:
        return [work(job) for job in jobs]
    finally:
        forget()  # the next task has a copy of the plan of its own
