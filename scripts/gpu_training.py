"""Train and score configs/gpu_check.yaml on this machine within a time; prints what it wrote.

    python scripts/gpu_training.py --seconds 420 -o runs/gpu_check

A run of two epochs tells the seconds of an epoch; both arms then get the epochs that fit. `--tiny` tries the steps on a CPU.
"""

import argparse
import time
from pathlib import Path

from visaug.core.documents import read_yaml
from visaug.core.files import write_json
from visaug_train.config import Config, check_config
from visaug_train.results import ablate
from visaug_train.training import prepare, train_run

CONFIG = Path(__file__).resolve().parents[1] / "configs" / "gpu_check.yaml"
TINY = {"synthetic": {"train": 16, "validation": 4, "test": 4}, "lightbox": {"test": 4}}


def tiny(content: dict) -> dict:
    """The same steps in a minute of a CPU."""
    content["data"]["rendered"] |= {"width": 160, "height": 100, "images": TINY}
    content["data"]["test"] = {
        "synthetic": {"domain": "synthetic", "split": "test"},
        "lightbox": {"domain": "lightbox"},
    }
    content["training"] |= {"imgsz": 160, "batch": 4, "nbs": 4, "workers": 0}
    return content | {"model": "yolov8n-pose.yaml"}


def with_epochs(config: Config, epochs: int) -> Config:
    return config.model_copy(update={"training": {**config.training, "epochs": epochs}})


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=420.0, help="for all of it")
    parser.add_argument("--render", action="store_true", help="render the images and stop")
    parser.add_argument("--tiny", action="store_true")
    options = parser.parse_args()
    began = time.monotonic()
    content = read_yaml(CONFIG, "the config")
    config = check_config(tiny(content) if options.tiny else content, CONFIG)
    config = config.model_copy(update={"output": options.output})
    said: dict[str, float] = {}

    def progress(title: str, done: int, total: int) -> None:
        if done == total or time.monotonic() - said.get("at", 0) > 10:
            said["at"] = time.monotonic()
            print(f"{time.monotonic() - began:6.0f} s  {title}: {done} of {total}", flush=True)

    study = prepare(with_epochs(config, 2), progress)
    if options.render:
        return
    trial = train_run(study, "vis", 0, progress)
    at = trial.curves["time"]  # seconds since the start of the training, by epoch
    epoch = at[-1] - at[-2] if len(at) > 1 else at[-1]
    left = options.seconds - (time.monotonic() - began) - 60  # scoring and start-up of two runs
    epochs = max(2, int(left / (2 * epoch)))
    print(f"an epoch takes {epoch:.1f} s: {epochs} epochs for each arm", flush=True)
    ablation = ablate(with_epochs(config, epochs), progress, lambda text: print(text, flush=True))
    write_json(options.output / "scores.json", ablation.to_json() | {"epochs": epochs, "epoch_s": epoch})
    for table in ablation.tables().values():
        print(table.to_markdown(), flush=True)


if __name__ == "__main__":
    main()
