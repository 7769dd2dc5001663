"""Simulations on Ray are the ones of this machine's threads."""

import numpy as np
import pytest

from tests.diagnosis.small import frame_set, stated_camera
from visaug import InputError
from visaug.core.cluster import connected
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.ray_executor import by_ray
from visaug.effects import Effect, Parameter, Stage, registered


class Hum(Effect):
    """A class that the nodes cannot import."""

    name = "hum_of_a_test"
    stage = Stage.READOUT
    offset_e = Parameter(3.0, unit="e-", strength=True)

    def apply(self, signal, p, stream, context):
        return signal + p.offset_e


Hum.__module__ = "a_file_of_the_users"


def test_ray_gives_the_same_numbers():
    pytest.importorskip("ray")
    camera, frames = stated_camera(), frame_set(1)
    with registered(Hum, alone=True), connected("local") as ray:
        jobs = [(camera, k) for k in range(5)] + [(camera.with_effect("hum_of_a_test"), 0)]
        here = Laboratory(frames, camera).simulated(jobs)
        there = Laboratory(frames, camera, spread=by_ray(ray)).simulated(jobs)
    for one, other in zip(here, there, strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.array_equal(here[0][0], here[0][5])


def test_nobody_answers():
    pytest.importorskip("ray")
    with pytest.raises(InputError, match="no Ray cluster answers"), connected("127.0.0.1:9"):
        pass
