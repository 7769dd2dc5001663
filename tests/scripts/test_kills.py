"""A few kills of the commands that write many files; scripts/nightly has more, and of every command."""

import multiprocessing
import sys

import kills
import pytest


@pytest.mark.skipif(sys.platform != "linux", reason="forks servers")
@pytest.mark.parametrize("command", ["augment", "simulate"])
def test_what_is_killed_and_run_again_gives_the_same_bytes(command, tmp_path):
    multiprocessing.set_forkserver_preload(kills.PRELOAD)
    said = []
    assert kills.kill_often(command, 5, 1, tmp_path, said.append, frames=8) == 0, said
    assert said[-1].startswith(f"{command}: 5 kills")
