"""Several GPUs: the noise reaches ultralytics' workers by the very file that it writes for them, and each draws its own."""

import os
import subprocess
import sys

import pytest
import torch

import visaug
from visaug.ultralytics import vis_trainer
from visaug_train.convert import convert
from visaug_train.geometry import Keypoints
from visaug_train.speed import read_poses

CAMERA = {"resolution": [64, 64], "bit_depth": 12, "gain_e_per_dn": 0.1, "read_noise": {"sigma_e": 8.0}}
LEVEL = 40  # no gray that padding may have
CHECK = """import torch
    trainer.device = torch.device("cpu")
    batch = {"img": torch.full((2, 3, 64, 64), 40, dtype=torch.uint8)}
    torch.save(trainer.preprocess_batch(batch)["img"], sys.argv[1])
"""


@pytest.mark.slow
def test_workers_of_distributed_training_have_the_noise_each_its_own(rendered, tmp_path):
    from ultralytics.utils.dist import generate_ddp_file

    poses = read_poses(rendered, "synthetic", "train")
    data = convert({"train": poses, "val": poses}, Keypoints.load(), tmp_path / "set")
    arguments = {"model": "yolov8n-pose.yaml", "data": str(data), "imgsz": 64, "device": "cpu", "seed": 3}
    trainer = vis_trainer(visaug.Camera.load(CAMERA))(
        overrides=arguments | {"project": str(tmp_path), "name": "run", "plots": False, "amp": False}
    )
    file = generate_ddp_file(trainer)
    try:
        with open(file, encoding="utf-8") as written:
            script = written.read()
        assert script.count("trainer.train()") == 1
        (tmp_path / "worker.py").write_text(script.replace("trainer.train()", CHECK))
        seen = []
        for rank in ("0", "1"):
            environment = os.environ | {"RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": "2"}
            command = [sys.executable, str(tmp_path / "worker.py"), str(tmp_path / f"{rank}.pt")]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=280)
            assert done.returncode == 0, done.stderr[-2000:]
            seen.append(torch.load(tmp_path / f"{rank}.pt"))
    finally:
        for suffix in (".py", ".pt"):
            os.unlink(file.removesuffix(".py") + suffix)
    for images in seen:
        assert images.std() * 255 > 3  # 8 e- and more are 5 DN of 255
        assert images.mean() * 255 == pytest.approx(LEVEL, abs=1)
    assert (seen[0] != seen[1]).float().mean() > 0.5
