"""Runs on Ray: two nodes on this machine, one of which is killed; what fails by itself; bad addresses."""

import os
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from visaug.core.errors import InputError
from visaug_train.config import Cluster
from visaug_train.parallel import spread

ray = pytest.importorskip("ray")
os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
pytestmark = pytest.mark.slow


def work_in(folder):
    """Stands for training: leaves a file when begun and one when done; a fault for the arm `broken`."""

    def work(study, arm, seed):
        import ray

        if arm == "broken":
            raise ValueError("this arm fails")
        node = ray.get_runtime_context().get_node_id()
        (folder / f"{arm}-{seed}-{time.time_ns()}.begun").write_text(node)
        done = folder / f"{arm}-{seed}.done"
        deadline = time.monotonic() + 60
        while not (folder / "go").exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        done.write_text(node)

    return work


def wait_for(condition, seconds=120):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "in vain"
        time.sleep(0.1)


def test_a_killed_node_loses_no_run(tmp_path):
    from ray.cluster_utils import Cluster as LocalCluster

    local = LocalCluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        second = local.add_node(num_cpus=1)
        ray.init(address=local.address, logging_level="ERROR")
        runs = [("vis", 0), ("vis", 1), ("broken", 0)]
        study = SimpleNamespace(config=SimpleNamespace(output=tmp_path / "out"))
        ended: dict = {}
        driver = threading.Thread(
            target=lambda: ended.update(
                wrong=spread(study, runs, work_in(tmp_path), Cluster(cpus_per_run=1))  # type: ignore[arg-type]
            )
        )
        driver.start()
        begun = lambda: {f.read_text() for f in tmp_path.glob("*.begun")} - {""}  # noqa: E731
        wait_for(lambda: len(begun()) == 2)  # a run on each node
        lost = next(f for f in tmp_path.glob("*.begun") if f.read_text() == second.node_id)
        local.remove_node(second, allow_graceful=False)
        (tmp_path / "go").touch()
        driver.join(200)
        assert not driver.is_alive()
        run = lost.name.rsplit("-", 1)[0]
        assert len(list(tmp_path.glob(f"{run}-*.begun"))) == 2  # tried again
        assert (tmp_path / f"{run}.done").read_text() != second.node_id
        assert len(list(tmp_path.glob("*.done"))) == 2
        assert ended["wrong"] == {("broken", 0): "ValueError: this arm fails"}
        assert "this arm fails" in Path(tmp_path / "out" / "failures" / "broken-seed0.txt").read_text()
        too_much = Cluster(cpus_per_run=64)
        with pytest.raises(InputError, match="cpus_per_run"):
            spread(study, runs, work_in(tmp_path), too_much)  # type: ignore[arg-type]
    finally:
        ray.shutdown()
        local.shutdown()


def test_an_address_where_nothing_answers_is_refused():
    with pytest.raises(InputError, match=r"cluster\.address"):
        spread(SimpleNamespace(), [], print, Cluster(address="127.0.0.1:1"))  # type: ignore[arg-type]
