"""Distributed training: two gloo processes on a CPU, each with sensor noise of its own."""

import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from torch import Tensor, distributed, multiprocessing, nn

from visaug import VISNoise
from visaug.ultralytics import add_callback, vis_trainer

CAMERA = {
    "resolution": [32, 32],
    "bit_depth": 12,
    "gain_e_per_dn": 0.5,
    "black_level_dn": 200,
    "read_noise": {"sigma_e": 8.0},
    "dsnu": {"pixel_e": 4.0},
    "randomize": {"gain_db": {"std": 2.0}},
}
PATTERN_ALONE = {
    "resolution": [32, 32],
    "gain_e_per_dn": 0.5,
    "black_level_dn": 200,
    "dsnu": {"pixel_e": 9.0},
}
IMAGES = torch.full((2, 3, 32, 32), 60, dtype=torch.uint8)


def ultralytics_trainer(base: type):
    """A trainer as far as the preprocessing of batches goes: it has no data and no network."""

    class Preprocessing(base):
        def __init__(self):
            self.device = torch.device("cpu")
            self.args = SimpleNamespace(multi_scale=0.0, hsv_v=0.0)
            self.train_loader = SimpleNamespace(dataset=())  # as of a classifier: no padding is known
            self.build_dataset, self.save_dir = None, tempfile.mkdtemp()

    return Preprocessing()


def through_trainer() -> Tensor:
    return ultralytics_trainer(vis_trainer(CAMERA)).preprocess_batch({"img": IMAGES})["img"]


def through_callback() -> Tensor:
    from ultralytics.models.yolo.pose import PoseTrainer

    trainer, callbacks = ultralytics_trainer(PoseTrainer), {"on_train_start": []}
    add_callback(SimpleNamespace(callbacks=callbacks), CAMERA, transfer="linear")
    for callback in callbacks["on_train_start"]:
        callback(trainer)
    return trainer.preprocess_batch({"img": IMAGES})["img"]


WAYS = {
    "plain": lambda: VISNoise(CAMERA)(IMAGES / 255),
    "seeded": lambda: VISNoise(CAMERA, seed=7)(IMAGES / 255),
    "trainer": through_trainer,
    "callback": through_callback,
}


def train(rank: int, folder: str) -> None:
    """One rank: what the network sees twice from the same seed, and a step of it under DDP."""
    torch.set_num_threads(1)
    meeting = (Path(folder) / "meeting").as_uri()
    distributed.init_process_group("gloo", init_method=meeting, rank=rank, world_size=2)
    seen = {}
    for name, way in WAYS.items():
        for run in ("first", "again"):
            torch.manual_seed(0)  # on either rank
            seen[f"{name} {run}"] = way()
    kept = VISNoise(PATTERN_ALONE, fixed_pattern="camera", black_level="keep", seed=7)
    seen["pattern"] = kept(torch.zeros(1, 1, 32, 32))
    torch.manual_seed(0)
    network = nn.Conv2d(3, 1, 3)
    shared = nn.parallel.DistributedDataParallel(network)
    images = seen["trainer first"]
    (seen["own gradient"],) = torch.autograd.grad(network(images).square().mean(), [network.weight])
    shared(images).square().mean().backward()
    seen["gradient"] = network.weight.grad
    torch.save(seen, Path(folder) / f"{rank}.pt")
    distributed.destroy_process_group()


@pytest.fixture(scope="module")
def ranks(tmp_path_factory) -> list[dict[str, Tensor]]:
    folder = tmp_path_factory.mktemp("ranks")
    multiprocessing.spawn(train, (str(folder),), nprocs=2)
    return [torch.load(folder / f"{rank}.pt") for rank in (0, 1)]


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_ranks_have_noise_of_their_own_which_a_seed_repeats(ranks, way):
    """The correlation of 2048 pixels' noise is beyond 0.11 by chance once in a million."""
    for seen in ranks:
        assert torch.equal(seen[f"{way} first"], seen[f"{way} again"])
        assert seen[f"{way} first"].std() > 1e-3
    noise = torch.stack([seen[f"{way} first"][:, 0].flatten() for seen in ranks])
    assert abs(torch.corrcoef(noise)[0, 1]) < 0.11


@pytest.mark.slow
def test_ranks_share_the_camera_and_the_step(ranks):
    """A kept fixed pattern is one camera's on all ranks; the gradient is the mean of those of their noises."""
    first, second = ranks
    assert torch.equal(first["pattern"], second["pattern"])
    assert first["pattern"].std() > 0
    assert torch.equal(first["gradient"], second["gradient"])
    assert not torch.equal(first["own gradient"], second["own gradient"])
    mean = (first["own gradient"] + second["own gradient"]) / 2
    torch.testing.assert_close(first["gradient"], mean)
