"""States of traps that are kept from frame to frame."""

import torch
from torch import Tensor

from visaug.effects.effect import Context


def kept_states(name: str, state: Tensor, keeps: Tensor, context: Context) -> Tensor:
    """States along a sequence: that of the frame before where `keeps`, else the fresh one.

    Args:
        name: key of the last frame's states in the context's memory.
        state: (B, C, H, W) fresh states of each frame.
        keeps: the same shape, true where a trap keeps its state.
    """
    before = context.memory.get(name, state[:1])
    frames = []
    for fresh, keep in zip(state.split(1), keeps.split(1), strict=True):
        before = torch.where(keep, before, fresh)
        frames.append(before)
    context.memory[name] = before
    return torch.cat(frames)
