"""Callbacks of a training."""

import os
from typing import Any

import torch
from torch import nn

from visaug.core.cores import cores
from visaug.core.errors import InputError
from visaug.core.progress import Progress


def close_noise(clean_epochs: int, trainer: Any) -> None:
    """At the start of an epoch: no noise from here on, where it is one of the last `clean_epochs`."""
    if trainer.epoch >= trainer.epochs - clean_epochs:
        trainer.noise = nn.Identity()


def keep_batch(batch: int, trainer: Any) -> None:
    """Refuse to go on with the smaller batch that ultralytics takes where the memory ends: the arms would not be equal."""
    if trainer.batch_size != batch:
        raise InputError(
            f"{batch} images do not fit into the memory of this device",
            field="training.batch",
            expected="fewer",
        )


def follow(model: Any, title: str, progress: Progress | None) -> None:
    """A CPU training uses all cores; progress is reported per batch."""

    def use_all_cores(trainer: Any) -> None:
        # ultralytics leaves one core idle on a CPU, which costs a fifth of the speed on two.
        if trainer.device.type == "cpu" and "OMP_NUM_THREADS" not in os.environ:
            torch.set_num_threads(cores())

    model.add_callback("on_train_start", use_all_cores)
    if progress is None:
        return
    count = {"batches": 0}

    def started(trainer: Any) -> None:
        count["batches"] = trainer.start_epoch * len(trainer.train_loader)

    def advance(trainer: Any) -> None:
        count["batches"] += 1
        progress(title, count["batches"], trainer.epochs * len(trainer.train_loader))

    model.add_callback("on_train_start", started)
    model.add_callback("on_train_batch_end", advance)
