"""Callbacks of a training, and the checkpoints from which an interrupted one resumes with the same result, whenever it was stopped.

ultralytics overwrites last.pt in place, in half precision and with the moving average in place of the network, and
strips it when training has ended. So a kill can leave it torn, a resumed training differs from an undisturbed one, and
one that is killed after its last epoch looks as if it had never been trained. Beside last.pt, a run therefore keeps

- ``resume.pt``: last.pt with network, moving average and optimizer in full precision, written whole after each epoch;
- ``resume-best.pt``: best.pt of the epochs up to then, written whole before it.

Random numbers are drawn anew at each epoch from seed and epoch, so that an epoch does not depend on whether the earlier
ones ran in the same process.
"""

import os
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from visaug.core.cores import cores
from visaug.core.errors import InputError
from visaug.core.files import whole_file, write_bytes, write_text

STATE, BEST = "resume.pt", "resume-best.pt"


def load_state(folder: Path) -> dict[str, Any] | None:
    """The checkpoint from which a run resumes; None if there is none that can be read."""
    from ultralytics.nn.tasks import torch_safe_load

    path = folder / "weights" / STATE
    if not path.is_file():
        return None
    try:
        state, _ = torch_safe_load(str(path), safe_only=True)  # as data: a file in a folder runs no code
        return state if {"exact", "ema", "optimizer", "epoch"} <= state.keys() else None
    except Exception:  # a damaged file raises whatever its bytes lead to
        return None


def restore(folder: Path, state: dict[str, Any]) -> Path:
    """Put best.pt and results.csv back to where the checkpoint was written; the checkpoint's path."""
    weights = folder / "weights"
    if (weights / BEST).is_file():
        write_bytes(weights / "best.pt", (weights / BEST).read_bytes())
    keep_epochs(folder / "results.csv", state["epoch"] + 1)
    return weights / STATE


def keep_epochs(results: Path, epochs: int) -> None:
    """Cut results.csv to its head and its first `epochs` epochs: a later line, which may be torn, comes again."""
    if results.is_file():
        lines = results.read_text(encoding="utf-8").splitlines(keepends=True)
        write_text(results, "".join(lines[: epochs + 1]))


def finish(folder: Path, state: dict[str, Any]) -> None:
    """What is left to do for a training that was stopped after its last epoch: weights without what only training needs."""
    from ultralytics.utils.torch_utils import strip_optimizer

    keep_epochs(folder / "results.csv", state["epoch"] + 1)
    weights = folder / "weights"
    best = weights / BEST if (weights / BEST).is_file() else weights / STATE
    for source, name in ((weights / STATE, "last.pt"), (best, "best.pt")):
        kept = {"train_results": state.get("train_results")}
        with whole_file(weights / name) as temporary:
            strip_optimizer(str(source), str(temporary), updates=kept)


def forget(folder: Path) -> None:
    for name in (STATE, BEST):
        (folder / "weights" / name).unlink(missing_ok=True)


class Checkpoints:
    """Callbacks of one training that keep its state, resume from the checkpoint `state`, and `tell` the batches done and all."""

    def __init__(
        self, seed: int, state: dict[str, Any] | None = None, tell: Callable[[int, int], None] | None = None
    ) -> None:
        self.seed, self.exact, self.tell = seed, (state or {}).get("exact"), tell
        self.seconds_before = self.exact["seconds"] if self.exact else 0.0
        self.began = time.monotonic()
        self.last_step, self.batch, self.epoch = -1, -1, -1

    def attach(self, model: Any) -> None:
        for event in filter(lambda name: name.startswith("on_"), dir(self)):
            model.add_callback(event, getattr(self, event))

    def on_train_start(self, trainer: Any) -> None:
        # ultralytics leaves one core idle on a CPU, which costs a fifth of the speed on two.
        if trainer.device.type == "cpu" and "OMP_NUM_THREADS" not in os.environ:
            torch.set_num_threads(cores())
        # ultralytics counts from the start of the process when to step; here the count outlives it.
        trainer.optimizer_step = lambda: None
        if self.exact is None:
            return
        _network(trainer).load_state_dict(self.exact["network"])
        trainer.ema.ema.load_state_dict(self.exact["average"])
        trainer.ema.updates = self.exact["updates"]
        trainer.optimizer.load_state_dict(self.exact["optimizer"])
        self.last_step = self.exact["last_step"]
        self.epoch = trainer.start_epoch - 1

    def on_train_epoch_start(self, trainer: Any) -> None:
        if trainer.epoch == self.epoch:  # ultralytics does the epoch again, with fresh gradients
            self.last_step = -1
        self.epoch, self.batch = trainer.epoch, -1
        rank = int(os.getenv("RANK", "-1"))
        words = np.random.SeedSequence([self.seed, trainer.epoch, rank + 1]).generate_state(4)
        random.seed(int(words[0]))
        np.random.seed(int(words[1]))  # noqa: NPY002 - what ultralytics' augmentation draws from
        torch.manual_seed(int(words[2]))
        loader, dataset = trainer.train_loader, trainer.train_loader.dataset
        loader.generator.manual_seed(int(words[3]))
        loader.reset()
        buffer = getattr(dataset, "buffer", [])  # images that mosaics are drawn from
        for index in buffer if buffer and dataset.cache != "ram" else ():
            dataset.ims[index] = None
        buffer.clear()
        parameters = dict(_network(trainer).named_parameters())
        for name, gradient in (self.exact or {}).get("gradients", {}).items():
            parameters[name].grad = gradient.to(parameters[name].device)
        self.exact = None

    def on_train_batch_end(self, trainer: Any) -> None:
        self.batch += 1
        number = self.batch + len(trainer.train_loader) * trainer.epoch
        if number - self.last_step >= trainer.accumulate:
            type(trainer).optimizer_step(trainer)
            self.last_step = number
        if self.tell:
            self.tell(number + 1, trainer.epochs * len(trainer.train_loader))

    def on_model_save(self, trainer: Any) -> None:
        weights = Path(trainer.wdir)
        if trainer.best_fitness == trainer.fitness:
            write_bytes(weights / BEST, Path(trainer.best).read_bytes())
        # this process wrote it just now
        checkpoint = torch.load(trainer.last, map_location="cpu", weights_only=False)
        checkpoint["exact"] = {
            "network": _network(trainer).state_dict(),
            "average": trainer.ema.ema.state_dict(),
            "updates": trainer.ema.updates,
            "optimizer": trainer.optimizer.state_dict(),
            "gradients": {n: p.grad for n, p in _network(trainer).named_parameters() if p.grad is not None},
            "last_step": self.last_step,
            "seconds": self.seconds_before + time.monotonic() - self.began,
            "over": bool(trainer.stop),
        }
        with whole_file(weights / STATE) as temporary:
            torch.save(checkpoint, temporary)


def _network(trainer: Any) -> torch.nn.Module:
    from ultralytics.utils.torch_utils import unwrap_model

    return unwrap_model(trainer.model)


def close_noise(clean_epochs: int, trainer: Any) -> None:
    """At the start of an epoch: no noise from here on, where it is one of the last `clean_epochs`."""
    if trainer.epoch >= trainer.epochs - clean_epochs:
        trainer.noise = nn.Identity()


def keep_batch(batch: int, trainer: Any) -> None:
    """Refuse to go on with the smaller batch that ultralytics takes where the memory ends: the arms would not be equal."""
    if trainer.batch_size != batch:
        problem = f"{batch} images do not fit into the memory of this device"
        raise InputError(problem, field="training.batch", expected="fewer")
