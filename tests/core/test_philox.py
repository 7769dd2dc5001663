"""The generator against the published vectors, and its two implementations against each other."""

import numpy as np
import pytest
import torch

from visaug.core.sampling import Stream, derive_key, kernels
from visaug.core.sampling import stream as stream_module
from visaug.core.sampling.philox import philox, sensor_bits

# Random123 1.14.0 (D. E. Shaw Research), tests/kat_vectors, "philox4x32 10": counter, key, answer.
KNOWN = [
    ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
]


def words(text: str) -> tuple[int, ...]:
    return tuple(int(word, 16) for word in text.split())


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN)
def test_known_answers(counter, key, answer):
    tensors = [torch.tensor(word) for word in words(counter)]
    found = philox(tuple(tensors), tuple(torch.tensor(word) for word in words(key)))
    assert tuple(int(word) for word in found) == words(answer)


def test_first_pixels_are_the_known_answer():
    """Key 0 at the sensor's origin is the counter of zeros, in both implementations."""
    expected = list(words(KNOWN[0][2]))
    assert sensor_bits(torch.tensor([0]), 1, range(1), range(4)).flatten().tolist() == expected
    out = np.empty((1, 1, 1, 4), np.uint64)
    kernels.fill_bits(np.zeros(1, np.uint64), 0, 0, out)
    assert out.flatten().tolist() == expected


@pytest.mark.parametrize("columns", [range(16), range(3, 14), range(5, 6), range(4001, 4090)])
def test_implementations_are_bit_equal(columns):
    keys = [derive_key("a"), 2**64 - 1, 2**63, 7]
    signed = torch.tensor([key - 2**64 if key >= 2**63 else key for key in keys])
    torch_bits = sensor_bits(signed, 3, range(60, 71), columns)
    out = np.empty((4, 3, 11, len(columns)), np.uint64)
    kernels.fill_bits(np.array(keys, np.uint64), 60, columns.start, out)
    assert np.array_equal(torch_bits.numpy().astype(np.uint64), out)


def test_keys_differ():
    """That they are the same in every process is shown by tests/test_same_bytes.py."""
    names = [(0, "frame", 1), (0, "frame", 2), (1, "frame", 1), (0, "camera"), ("0", "camera")]
    assert len({derive_key(*name) for name in names}) == len(names)


def test_streams_are_uncorrelated():
    """Neighbours, rows, channels, images and forks. 6 standard errors: false alarm below 1e-7 for the lot."""
    window = (range(256), range(256))
    stream = Stream([1, 2], [3, 3], 2, window)
    x = stream.uniform().double() - 0.5
    y = stream.fork("other").uniform().double() - 0.5
    pairs = [
        (x[..., 1:], x[..., :-1]),
        (x[..., 4:], x[..., :-4]),
        (x[..., 1:, :], x[..., :-1, :]),
        (x[:, 0], x[:, 1]),
        (x[0], x[1]),
        (x, y),
        (x, stream.fixed.uniform().double() - 0.5),
    ]
    for a, b in pairs:
        a, b = torch.broadcast_tensors(a, b)
        correlation = 12 * (a * b).mean()
        assert abs(correlation) < 6 / a.numel() ** 0.5


def test_a_fork_is_the_same_stream_in_both_ways(monkeypatch):
    keys, cameras = [7, 2**63 + 5, 2**64 - 1], [1, 2**63, 3]
    native = Stream(keys, cameras, 1, (range(2), range(3))).fork("shot", 2)
    monkeypatch.setattr(stream_module, "kernels", None)
    plain = Stream(keys, cameras, 1, (range(2), range(3))).fork("shot", 2)
    assert torch.equal(native._keys, plain._keys)
    assert torch.equal(native._camera_keys, plain._camera_keys)
