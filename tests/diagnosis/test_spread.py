"""Processes give what threads give, know what was loaded, and end with their parent."""

import gc
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from tests.diagnosis.small import RIPPLE, frame_set, stated_camera
from visaug.core.errors import user_line
from visaug.diagnosis import spread as spreads
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.spread import Forked, by_threads
from visaug.effects import load_file, registered

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="forks")


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(spreads, "workers", lambda: 2)
    return tmp_path


def laboratory(spread):
    return Laboratory(frame_set(5), stated_camera(), 0, spread=spread)


def jobs_of(stated):
    """A reference, whose first sets are kept, and cameras near it."""
    other = stated.with_effect("row_noise", sigma_e=2.0)
    lag = stated.with_effect("image_lag", share=0.02)
    return [(stated, k) for k in range(6)], [(c, k) for c in (other, lag, stated) for k in range(4)]


def test_processes_and_threads_give_the_same_bits(monkeypatch, place, stated):
    reference, near = jobs_of(stated)
    of = []
    for spread in (Forked(), by_threads()):
        lab = laboratory(spread)
        monkeypatch.setenv("VISAUG_CACHE", str(place / type(spread).__name__))
        of.append([lab.finding(reference), lab.finding(near), lab.finding([*near, *reference])])
    for one, other in zip(*of, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(np.unique(of[0][2][:, 0])) > 1


def test_an_effect_that_is_loaded_later_is_known(place, stated):
    lab = laboratory(Forked())
    lab.finding([(stated, k) for k in range(3)])
    with registered():
        (place / "ripple.py").write_text(RIPPLE.format(factor=1, line=""))
        load_file(place / "ripple.py")
        rippled = stated.with_effect("ripple", sigma_e=30.0)
        found = lab.finding([(rippled, 0), (stated, 0)])
    assert not np.array_equal(found[0], found[1])


def test_a_fault_of_a_users_effect_names_its_line(place, stated):
    lab = laboratory(Forked())
    with registered():
        (place / "ripple.py").write_text(
            RIPPLE.format(factor=1, line='assert signal.shape[-1] != 80, "a fault"')
        )
        load_file(place / "ripple.py")
        with pytest.raises(Exception, match="a fault") as fault:
            lab.finding([(stated, 0), (stated.with_effect("ripple", sigma_e=3.0), 0)])
    assert "ripple.py: line 11" in (user_line(fault.value) or "") + str(fault.value)


def test_processes_end_with_their_laboratory(stated):
    """And so does the thread that waits for them: one that is still closing its pipes disturbs the end of the interpreter."""

    def running() -> set[object]:
        return {*threading.enumerate(), *multiprocessing.active_children()}

    before = running()  # of other tests' laboratories

    forked = Forked()
    laboratory(forked).finding([(stated, k) for k in range(3)])
    assert running() - before
    del forked
    gc.collect()
    assert not running() - before


def test_processes_of_one_laboratory_run_at_a_time(stated, place, monkeypatch):
    """Those of the first end where a second forks, and are forked anew for more jobs, with the same numbers."""
    one, other = Forked(), Forked()
    jobs = [(stated, k) for k in range(3)]
    first, second = laboratory(one), laboratory(other)
    before = first.finding(jobs)
    monkeypatch.setenv("VISAUG_CACHE", str(place / "second"))
    np.testing.assert_array_equal(second.finding(jobs), before)
    assert one._pool is None
    assert other._pool is not None
    monkeypatch.setenv("VISAUG_CACHE", str(place / "third"))
    np.testing.assert_array_equal(first.finding(jobs), before)
    assert other._pool is None


def test_where_a_process_is_killed_threads_go_on(monkeypatch, stated):
    forked, whole = Forked(), laboratory(by_threads())
    lab = laboratory(forked)
    lab.finding([(stated, k) for k in range(3)])
    for process in list(forked._pool._processes.values()):
        os.kill(process.pid, signal.SIGKILL)
    monkeypatch.setenv("VISAUG_CACHE", "/dev/null/none")
    jobs = [(stated, k) for k in range(3)]
    np.testing.assert_array_equal(lab.finding(jobs), whole.finding(jobs))


def test_a_servers_thread_does_not_fork(stated, place, monkeypatch):
    forked, found = Forked(), []
    lab, whole = laboratory(forked), laboratory(by_threads())
    jobs = [(stated, k) for k in range(3)]
    asking = threading.Thread(target=lambda: found.append(lab.finding(jobs)))
    asking.start()
    asking.join()
    assert forked._pool is None
    monkeypatch.setenv("VISAUG_CACHE", str(place / "other"))  # simulated again
    np.testing.assert_array_equal(found[0], whole.finding(jobs))


def test_a_connection_of_the_parent_ends_with_it(stated):
    here, there = socket.socketpair()
    laboratory(Forked()).finding([(stated, k) for k in range(3)])
    here.close()
    there.settimeout(5)
    assert there.recv(1) == b""  # no process holds the other end


ORPHANS = """
import os, sys
sys.path[:0] = {path!r}
from tests.diagnosis.small import frame_set, stated_camera
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.spread import Forked
forked = Forked()
camera = stated_camera()
Laboratory(frame_set(5), camera, spread=forked).finding([(camera, k) for k in range(3)])
print(*forked._pool._processes, flush=True)
os.kill(os.getpid(), 9)
"""


def test_processes_end_with_their_parent(monkeypatch):
    code = ORPHANS.format(path=sys.path)
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    children = [int(word) for word in ended.stdout.split()]
    assert children, ended.stderr
    until = time.monotonic() + 20
    while any(_runs(child) for child in children) and time.monotonic() < until:
        time.sleep(0.2)
    assert not any(_runs(child) for child in children)


def _runs(process: int) -> bool:
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
