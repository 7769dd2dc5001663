"""Everything random about a batch of noisy images, as tensors of a few numbers an image: drawn, stored, replayed.

A draw is a dict: `keys` (B,) int64, of the temporal noise; `pattern_keys` (B,) int64, of the fixed patterns;
`camera` (B,) int64, which camera of the population; each randomised value by its path, (B,) float32; and `exposure`, (B,)
float32, where the option is set. The noise of a batch
itself is a pure function of them, so they are all that has to be kept; see `SensorNoise.apply_draws`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from visaug.core.errors import InputError
from visaug.core.extras import extra
from visaug.core.sampling import derive_key, signed

KEYS = ("keys", "pattern_keys")
# in draws of one of several images of a sample: the pattern is that of others too
SHARED = "pattern_is_shared"


def draws_to_json(draws: Mapping[str, Tensor] | Sequence[Any]) -> Any:
    """Draws as what `json.dumps` takes. Keys become hexadecimal: many JSON readers keep 53 bits of a number.

    Args:
        draws: of `SensorNoise` or `VISNoise`, or the `_params` of a kornia container, whatever its other augmentations.
    """
    if isinstance(draws, Mapping):
        return {name: _plain(name, value) for name, value in draws.items()}
    held = [(item.name, item.data) for item in draws]
    return [{"name": name, "data": None if data is None else draws_to_json(data)} for name, data in held]


def draws_from_json(plain: Any) -> Any:
    """The draws that `draws_to_json` wrote; the noise they replay is the same bit by bit.

    Those of a container come back as kornia's `ParamItem`s, for `container(images, params=...)`.

    Raises:
        InputError: something else.
    """
    is_draws = "keys" in plain if isinstance(plain, Mapping) else isinstance(plain, list)
    try:
        if is_draws:
            return _draws(plain)
    except InputError:  # kornia is missing
        raise
    except (TypeError, ValueError, KeyError, AttributeError, RuntimeError, OverflowError):
        pass
    raise InputError("these are no stored draws", field="draws", expected="what `draws_to_json` returned")


def _draws(plain: Any) -> Any:
    if isinstance(plain, Mapping):
        return {name: _tensor(name, value) for name, value in plain.items()}
    with extra(field="params"):
        from kornia.augmentation.container.params import ParamItem

    return [ParamItem(item["name"], None if item["data"] is None else _draws(item["data"])) for item in plain]


def _plain(name: str, value: Tensor) -> Any:
    """A list; with its type where that would not come back by itself."""
    if name in KEYS:
        return [f"{key % 2**64:016x}" for key in value.tolist()]
    if value.numel() > 0 and value.dtype in (torch.float32, torch.int64, torch.bool):
        return value.tolist()
    kind = str(value.dtype).removeprefix("torch.")
    return {"type": kind, "shape": list(value.shape), "values": value.flatten().tolist()}


def _tensor(name: str, plain: Any) -> Tensor:
    if name in KEYS:
        return torch.tensor([signed(int(key, 16)) for key in plain], dtype=torch.int64)
    if isinstance(plain, Mapping):
        return torch.tensor(plain["values"], dtype=getattr(torch, plain["type"])).reshape(plain["shape"])
    return torch.tensor(plain)


def of_frames(draws: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
    """Images of a batch that share `keys` are frames of one clip, as kornia's `VideoSequential` has them: they share camera
    and fixed patterns, and each gets temporal noise of its own, which follows from the shared key and its number.
    """
    keys = draws["keys"].tolist()
    if len(set(keys)) == len(keys):
        return draws
    count: Counter[int] = Counter()
    own = []
    for key in keys:
        own.append(_frame_key(key, count[key]))
        count[key] += 1
    return {**draws, "keys": torch.tensor(own, dtype=torch.int64)}


def nth_frame(draws: Mapping[str, Tensor], number: int) -> dict[str, Tensor]:
    """Draws of image `number`, from 0, of several that the same cameras with the same fixed patterns take one by one."""
    keys = [_frame_key(key, number) for key in draws["keys"].tolist()]
    kept = torch.ones(len(keys), dtype=torch.bool)
    return {**draws, "keys": torch.tensor(keys, dtype=torch.int64), SHARED: kept}


def _frame_key(key: int, number: int) -> int:
    return signed(derive_key(key % 2**64, "frame", number)) if number else key
