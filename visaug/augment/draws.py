"""Everything random about a batch of noisy images, as tensors of a few numbers an image: drawn, stored, replayed.

A draw is a dict: `keys` (B,) int64, of the temporal noise; `pattern_keys` (B,) int64, of the fixed patterns;
`camera` (B,) int64, which camera of the population; each randomised value by its path, (B,) float32; and `exposure`, (B,)
float32, where the option is set. The noise
itself is a pure function of them, so they are all that has to be kept.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from visaug.camera.randomize import Spreads
from visaug.sampling import derive_key

KEYS = ("keys", "pattern_keys")


def signed(key: int) -> int:
    """The int64 with the same bits as an unsigned 64-bit key."""
    return key - 2**64 if key >= 2**63 else key


def random_keys(count: int, generator: torch.Generator | None) -> Tensor:
    return torch.randint(-(2**63), 2**63 - 1, (count,), dtype=torch.int64, generator=generator)


def draw(
    spreads_of: Sequence[Spreads],
    count: int,
    generator: torch.Generator | None = None,
    pattern_key: int | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> dict[str, Tensor]:
    """Draws for `count` images.

    Args:
        spreads_of: what is random about each camera of the population; each image gets one, all equally likely.
        generator: source of the randomness; None is torch's own, which `torch.manual_seed` sets.
        pattern_key: the key of one camera's fixed patterns; None draws them anew for every image.
        ranges: names and ends of further numbers, drawn uniformly; such a name replaces a camera's value.
    """
    draws = {"keys": random_keys(count, generator)}
    if pattern_key is None:
        draws["pattern_keys"] = random_keys(count, generator)
    else:
        draws["pattern_keys"] = torch.full((count,), signed(pattern_key), dtype=torch.int64)
    draws["camera"] = torch.randint(0, len(spreads_of), (count,), generator=generator)
    for number, random in enumerate(spreads_of):
        uniform = torch.rand(count, len(random.paths), dtype=torch.float64, generator=generator)
        for path, value in random.values(uniform).items():
            other = draws.get(path)  # of another camera that has it too
            draws[path] = value if other is None else torch.where(draws["camera"] == number, value, other)
    for name, (low, high) in (ranges or {}).items():
        uniform = torch.rand(count, generator=generator) if low < high else torch.zeros(count)
        draws[name] = low + (high - low) * uniform
    return draws


def draws_to_json(draws: Mapping[str, Tensor]) -> dict[str, Any]:
    """Draws as what `json.dumps` takes. Keys become hexadecimal: many JSON readers keep 53 bits of a number."""
    plain: dict[str, Any] = {name: value.tolist() for name, value in draws.items()}
    return plain | {name: [f"{key % 2**64:016x}" for key in plain[name]] for name in KEYS if name in plain}


def draws_from_json(plain: Mapping[str, Any]) -> dict[str, Tensor]:
    """The draws that `draws_to_json` wrote; the noise they replay is the same bit by bit."""
    decoded = {name: [signed(int(key, 16)) for key in plain[name]] for name in KEYS if name in plain}
    return {name: torch.tensor(value) for name, value in {**plain, **decoded}.items()}


def pattern_key_of(seed: int) -> int:
    """The key of the individual camera, hence of its maps, that a seed stands for; `simulate` has the same."""
    return derive_key(seed, "camera")
