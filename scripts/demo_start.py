"""Train the network that the demonstration starts from and write it as safetensors, in half precision; prints its hash.

    python scripts/demo_start.py -o configs/demo_start.safetensors

About an hour of one CPU core. `--epochs` and `--images` try the steps.
"""

import argparse
import hashlib
import time
from pathlib import Path

import torch
from safetensors.torch import save

from visaug.core.documents import read_yaml
from visaug.core.files import write_bytes
from visaug_train.config import check_config
from visaug_train.evaluate import evaluate
from visaug_train.predictions import predict
from visaug_train.training import prepare, start_network

CONFIG = Path(__file__).resolve().parents[1] / "configs" / "demo_start.yaml"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument(
        "--runs", type=Path, help="folder of images and checkpoints; the config's where left out"
    )
    parser.add_argument("--epochs", type=int)
    parser.add_argument("--images", type=int)
    options = parser.parse_args()
    content = read_yaml(CONFIG, "the config")
    content["output"] = options.runs or content["output"]
    content["start"]["epochs"] = options.epochs or content["start"]["epochs"]
    if options.images:
        content["data"]["rendered"]["images"]["synthetic"]["train"] = options.images
        content["training"]["workers"] = 2
    config = check_config(content, CONFIG)
    began, said = time.monotonic(), [0.0]

    def progress(title: str, done: int, total: int) -> None:
        if done == total or time.monotonic() - said[0] > 10:
            said[0] = time.monotonic()
            print(f"{said[0] - began:6.0f} s  {title}: {done} of {total}", flush=True)

    study = prepare(config, progress)
    trained = start_network(study, progress)
    assert trained is not None
    network = torch.load(trained, map_location="cpu", weights_only=False)["model"]  # this process wrote it
    state = {
        name: value.half().contiguous() if value.is_floating_point() else value
        for name, value in network.state_dict().items()
    }
    write_bytes(options.output, save(state, {"made_by": "scripts/demo_start.py"}))
    digest = hashlib.sha256(options.output.read_bytes()).hexdigest()
    print(f"{options.output}: {options.output.stat().st_size / 1e6:.1f} MB, sha256 {digest}")
    poses = study.tests["synthetic"]
    found = predict(trained, poses, 160, config.output / "settings", config.training.get("device"))
    print(evaluate("synthetic", poses, study.keypoints, found).summary())


if __name__ == "__main__":
    main()
