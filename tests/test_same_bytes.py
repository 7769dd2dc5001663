"""The same seed gives the same bytes, whatever the number of threads, the batch and Python's hash seed."""

import os
import subprocess
import sys

PROGRAM = """
import hashlib, sys
import numpy as np, torch
import visaug
from visaug.augment import SensorNoise
from visaug.frames import FrameRecord, FrameSet
from visaug.camera import simulation
threads, batch = int(sys.argv[1]), int(sys.argv[2])
torch.set_num_threads(threads)
simulation.BATCH_PIXELS = batch * 80 * 96
spec = {"resolution": [80, 96], "bit_depth": 12, "gain_e_per_dn": 2.0, "read_noise": {"sigma_e": 4.0, "shape": -0.1},
        "dark_current": {"a_e_per_s": 3.0}, "prnu": {"pixel": 0.01, "row": 0.002}, "dsnu": {"pixel_e": 2.0},
        "randomize": {"gain_db": {"std": 2.0}}}
further = [{"name": name} for name in ("row_noise", "flicker_noise", "hot_pixels", "rts_noise", "image_lag", "light_drift")]
made = hashlib.sha256()
for effects in ([], further):
    camera = visaug.Camera.load({**spec, "effects": effects})
    plan = [FrameRecord(i, f"{i}.npy", "flat", 0.5, photons=900.0 * i) for i in range(6)]
    unread = FrameSet.from_arrays(plan, np.zeros((6, 80, 96), np.uint16), bit_depth=12)
    taken = visaug.simulate(camera, unread, seed=4)
    for i in range(6):
        made.update(taken.read(i).tobytes())
    images = torch.linspace(0, 1, 4 * 3 * 80 * 96).view(4, 3, 80, 96)
    noise = SensorNoise(camera, seed=5)
    draws = noise.draw(4)
    for first in range(0, 4, batch):
        part = {name: value[first : first + batch] for name, value in draws.items()}
        made.update(noise.apply_draws(images[first : first + batch], part).numpy().tobytes())
print(made.hexdigest())
"""


def test_threads_batches_and_hash_seeds_change_no_byte():
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(threads), str(batch)],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONHASHSEED": hashing},
        )
        for threads, batch, hashing in ((1, 1, "1"), (2, 4, "2"))
    ]
    digests = {run.communicate(timeout=300)[0] for run in runs}
    assert all(run.returncode == 0 for run in runs)
    assert len(digests) == 1
