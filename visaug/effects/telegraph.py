"""States of defects that jump between two levels, from frame to frame."""

import math

import numpy as np
import torch
from torch import Tensor

from visaug.core.sampling.philox import mix
from visaug.effects.effect import Context, Values


def kept_states(
    name: str, where: Tensor, places: tuple[Tensor, Tensor], p: Values, keys: np.ndarray, context: Context
) -> Tensor:
    """States 0 and 1 along a sequence: that of the frame before with probability `p.kept`, else 1 with probability `p.duty`.

    Whether a state is drawn anew, and what is drawn, are functions of the pixel and of the number of the frame in the sequence.
    What is remembered from frame to frame is therefore the number of the frame alone, so frames may be skipped. `p` may differ
    within a batch; in the frames before it the values of its first frame are assumed.

    Args:
        name: key in the context's memory.
        where: (B or 1, C, H, W), true for pixels that have a defect; the state of others is 0.
        places: two uniform numbers of each pixel that belong to the camera, likewise. A sequence is of one camera: those of the
            first frame are used.
        p: with `duty` and `kept`.
        keys: (B,) uint64, of the frames; that of the first one is that of the sequence.

    Returns:
        (B, C, H, W), float32.
    """
    begun = context.memory.get(name)
    sequence, frame = (int(keys[0].view(np.int64)), 0) if begun is None else map(int, begun.flatten())
    duty, kept = (value.flatten().expand(len(keys)).tolist() for value in (p.duty, p.kept))
    hit = where.any(0)
    first, second = (number[0][hit].view(torch.int32).long() for number in places)
    own = mix(mix(first << 32 | second) ^ sequence)
    states = torch.zeros(len(keys), *hit.shape, device=hit.device)
    upper = _looked_back(own, frame, duty[0], kept[0])
    for k, state in enumerate(states):
        if k > 0:
            drawn = _drawn(own, torch.tensor(frame + k, device=own.device))
            upper = torch.where(_uniform(drawn) >= kept[k], _is_upper(drawn, duty[k]), upper)
        state[hit] = upper.float()
    context.memory[name] = torch.tensor([sequence, frame + len(keys)]).view(1, 2, 1, 1)
    return states * where


def _looked_back(own: Tensor, frame: int, duty: float, kept: float) -> Tensor:
    """Of each defect, by its own key: what was drawn in the last frame, up to this one, in which its state was drawn.

    It is drawn in frame 0 in any case: whether a state is drawn depends on none before, so it is distributed there as in any frame.
    """
    first_look = 2.0  # frames that are looked back at once, in units of the mean time between draws
    most_look = 64
    look = min(math.ceil(first_look / (1 - kept)), most_look)
    upper = torch.zeros(len(own), dtype=torch.bool, device=own.device)
    open_ = torch.arange(len(own), device=own.device)
    while len(open_):
        back = torch.arange(frame, max(frame - look, -1), -1, device=own.device)
        drawn = _drawn(own[open_][:, None], back)
        is_drawn = (_uniform(drawn) >= kept) | (back == 0)
        last = is_drawn.int().argmax(1, keepdim=True)
        found = is_drawn.any(1)
        upper[open_[found]] = _is_upper(drawn.gather(1, last)[found, 0], duty)
        open_, frame = open_[~found], frame - look
    return upper


def _drawn(own: Tensor, frame: Tensor) -> Tensor:
    """Keys of what may be drawn in frames."""
    return mix(own ^ mix(frame))


def _is_upper(drawn: Tensor, duty: float) -> Tensor:
    state = drawn ^ 0x5DEECE66D  # key of the state, apart from that of whether it is drawn
    return _uniform(mix(state)) < duty


def _uniform(keys: Tensor) -> Tensor:
    """In [0, 1), of 53 bits."""
    return ((keys >> 11) & (2**53 - 1)).double() * 2.0**-53
