"""One effect on its own, outside a chain."""

from types import SimpleNamespace

import pytest
import torch

from visaug.core.sampling import Stream
from visaug.effects import Context, catalogue


@pytest.fixture
def run_effect():
    """run_effect(name, signal, known={context field: value}, **parameters): the signal after the effect."""
    return _run


def _run(
    name,
    signal,
    *,
    keys=None,
    cameras=None,
    window=None,
    resolution=None,
    known=None,
    sequence=False,
    memory=None,
    **parameters,
):
    batch, channels, rows, columns = signal.shape
    window = window or (range(rows), range(columns))

    def number(value):
        value = torch.as_tensor(value, dtype=signal.dtype)
        return value.reshape(-1, 1, 1, 1).expand(batch, 1, 1, 1)

    usual = {
        "exposure_s": 0.5,
        "temperature_c": 20.0,
        "gain_e_per_dn": 0.2,
        "black_level_dn": 240.0,
        "full_well_e": 11000.0,
        "quantum_efficiency": 0.5,
        "dark_current_e": 20.0,
    }
    context = Context(
        **{key: number(value) for key, value in {**usual, **(known or {})}.items()},
        bit_depth=16,
        reading="physical",
        resolution=resolution or (rows, columns),
        window=window,
        sequence=sequence,
        memory={} if memory is None else memory,
    )
    effect = catalogue()[name]()
    values = {
        key: parameters.pop(key, parameter.default)
        if parameter.options
        else number(parameters.pop(key, parameter.default))
        for key, parameter in effect.parameters.items()
    }
    assert not parameters, f"{name} has no {sorted(parameters)}"
    stream = Stream(keys or range(1, batch + 1), cameras or [7] * batch, channels, window)
    return effect.apply(signal, SimpleNamespace(**values), stream, context)
