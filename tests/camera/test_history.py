"""A share of a sequence has the frames that the whole sequence has: the state of the camera before them is the true one.

The random numbers of a frame belong to its number and to the place on the sensor: the two agree pixel by pixel, not in law alone.
"""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from visaug.camera import Camera
from visaug.camera.history import Reach
from visaug.camera.simulation import simulate
from visaug.effects import Effect, Parameter, Stage, catalogue, register
from visaug.frames import FrameRecord, FrameSet

CAMERA = {
    "resolution": [40, 56],
    "bit_depth": 14,
    "gain_e_per_dn": 0.8,
    "black_level_dn": 150,
    "quantum_efficiency": 0.6,
    "full_well_e": 9500,
    "read_noise": {"sigma_e": 3.0},
    "prnu": {"pixel": 0.006},
    "dsnu": {"pixel_e": 1.2},
}
KEPT = [4, 12, 13, 20, 31, 33, 35, 41, 45, 52, 58]


@pytest.fixture(scope="module")
def sequence() -> FrameSet:
    """Bias, darks, two flats, bright frames with dark ones between, bias again."""
    settings = [("bias", 1e-5, None)] * 8 + [("dark", 1.0, None)] * 8 + [("flat", 0.01, 900.0)] * 7
    settings += [("flat", 0.01, 9000.0)] * 8
    settings += [("flat", 0.01, 13000.0), ("dark", 0.01, None)] * 10 + [("bias", 1e-5, None)] * 9
    records = [
        FrameRecord(i, "", kind, t, 20.0, 0.0, photons) for i, (kind, t, photons) in enumerate(settings)
    ]
    return FrameSet.from_arrays(records, [np.zeros((1, 1), np.uint16)] * len(records))


def apart(camera: Camera, sequence: FrameSet, keep: list[int]) -> np.ndarray:
    """Mean distance in DN of each frame of a share from the same frame out of the whole sequence."""
    whole, share = simulate(camera, sequence, 5), simulate(camera, sequence, 5, keep=keep)
    return np.array([np.abs(whole.read(i) - share.read(k)).mean() for k, i in enumerate(keep)])


class Persistence(Effect):
    """A user's own: traps fill with a share of the charge, release it slowly, and the frame's mean is remembered beside."""

    name = "persistence_of_a_test"
    stage = Stage.CHARGE
    share = Parameter(0.02, unit="fraction", strength=True)

    def apply(self, signal, p: SimpleNamespace, stream, context):
        trapped = context.memory.get("traps", signal[:1] * 0)
        mean = context.memory.get("mean", signal[:1].mean((-1, -2), keepdim=True) * 0)
        frames = []
        for k in range(len(signal)):
            frames.append(signal[k : k + 1] + 0.3 * trapped + 0.001 * mean)
            trapped = 0.7 * trapped + p.share[0] * signal[k : k + 1]
            mean = 0.9 * mean + signal[k : k + 1].mean((-1, -2), keepdim=True)
        context.memory.update(traps=trapped, mean=mean)
        return torch.cat(frames)


@pytest.fixture
def persistence():
    register(Persistence)
    yield Persistence.name
    catalogue().pop(Persistence.name, None)


@pytest.mark.parametrize(
    ("effect", "numbers"),
    [
        ("image_lag", {"share": 0.025}),
        ("image_lag", {"share": 0.03, "decay": 0.55}),
        ("rts_noise", {"density": 0.05, "kept": 0.6}),
        ("dark_current_rts", {"density": 0.05, "kept": 0.97, "amplitude_e_per_s": 2000.0}),
        ("light_drift", {"sigma": 0.02, "correlation": 0.93}),
        ("black_level_drift", {"sigma_e": 4.0, "correlation": 0.97}),
    ],
)
def test_a_share_has_the_history_of_the_whole_sequence(sequence, effect, numbers):
    """Held charge within a fiftieth of what the frames alone, one after the other, are off; numbers of a frame to the last bit."""
    camera = Camera.load(CAMERA).with_effect(effect, **numbers)
    whole = simulate(camera, sequence, 5)
    alone = simulate(camera, sequence.subset(KEPT), 5)
    without = np.array([np.abs(whole.read(i) - alone.read(k)).mean() for k, i in enumerate(KEPT)])
    assert without.max() > 0.1
    left = apart(camera, sequence, KEPT)
    assert left.max() <= (0.02 * without.max() if effect == "image_lag" else 0)


def test_every_effect_that_remembers_is_known_to():
    """Those above are all of the catalogue's: another one with a memory belongs to them."""
    camera = Camera.load(CAMERA)
    remember = set()
    for name, effect in catalogue().items():
        if not effect.base and name != "unexplained":  # which needs a measured file
            reach = Reach.of(camera.with_effect(name))
            if reach.whole_frames or reach.depth:
                remember.add(name)
    assert remember == {"image_lag", "light_drift", "black_level_drift", "rts_noise", "dark_current_rts"}
    assert Reach.of(camera.with_effect("image_lag", share=0.03, decay=0.55)).depth > 3
    assert Reach.of(camera.with_effect("rts_noise", density=0.05, kept=0.6)) == Reach(True, 0)
    assert Reach.of(camera) == Reach(False, 0)


def test_an_effect_of_ones_own_gets_its_history_without_knowing(sequence, persistence):
    camera = Camera.load(CAMERA).with_effect(persistence)
    reach = Reach.of(camera)
    assert reach.whole_frames
    assert reach.depth > 8
    # the mean of a window of 2 x 2 pixels is not that of the frame: its noise, a percent, is what is left of a thousandth
    assert apart(camera, sequence, KEPT).max() < 1.0
    cut = simulate(camera, sequence.subset(KEPT), 5)
    whole = simulate(camera, sequence, 5)
    assert np.abs(whole.read(KEPT[-1]) - cut.read(len(KEPT) - 1)).mean() > 3
