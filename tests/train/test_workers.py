"""Work in processes side by side: the bits of one process, one progress, and an end with the block."""

import os
import time
from typing import Any

import pytest
import torch
from ultralytics import YOLO

from visaug_train.config import check_config
from visaug_train.parallel import Workers
from visaug_train.training import prepare, run_folder

RUNS = (("baseline", 0), ("baseline", 1))


def study(rendered, output):
    return prepare(
        check_config(
            {
                "name": "small",
                "output": str(output),
                "data": {"root": str(rendered)},
                "training": {"epochs": 1, "imgsz": 64, "batch": 8, "amp": False, "device": "cpu"},
                "arms": {"baseline": {"gaussian": {"p": 1.0}}},
                "bootstrap": 0,
            }
        )
    )


def network(file) -> Any:
    return YOLO(str(file)).model


def networks(study):
    return [network(run_folder(study, *run) / "weights" / "last.pt").state_dict() for run in RUNS]


def wait_for(seconds, file, _progress):
    file.write_text(str(os.getpid()))
    time.sleep(seconds)


@pytest.mark.slow
def test_results_are_the_same_bits_for_any_number_of_processes(rendered, tmp_path):
    found = []
    for processes in (1, 2):
        seen: list[tuple[str, int, int]] = []
        here = study(rendered, tmp_path / str(processes))
        with Workers(processes, len(RUNS), lambda *step, seen=seen: seen.append(step)) as workers:
            for run in RUNS:
                workers.train(here, *run)
        assert seen[-1] == ("training, 2 runs", 2, 2)
        assert all(list((run_folder(here, *run) / "predictions").iterdir()) for run in RUNS)
        found.append(networks(here))
        assert not torch.equal(*(next(iter(state.values())) for state in found[-1]))
        with Workers(processes, len(RUNS)) as workers:
            for run in RUNS:
                workers.train(here, *run)
            assert workers.runs == 0
    for one, two in zip(*found, strict=True):
        assert one.keys() == two.keys()
        assert all(torch.equal(value, two[name]) for name, value in one.items())


def test_workers_end_with_an_error_in_the_block(tmp_path):
    file, began = tmp_path / "pid", time.monotonic()
    with pytest.raises(KeyboardInterrupt), Workers(1) as workers:
        workers.submit(wait_for, 300, file)
        while not (file.is_file() and file.read_text()):
            time.sleep(0.1)
        raise KeyboardInterrupt
    assert time.monotonic() - began < 120
    with pytest.raises(ProcessLookupError):
        os.kill(int(file.read_text()), 0)


def test_an_error_of_the_work_is_that_of_the_result(tmp_path):
    with Workers(1) as workers:
        failed = workers.submit(wait_for, 0, tmp_path)  # writing to a folder fails
        assert isinstance(failed.exception(), IsADirectoryError)
