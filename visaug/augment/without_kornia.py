"""What VISNoise needs of kornia's base class, where kornia is not installed."""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor, nn


class Augmentation(nn.Module):
    """An augmentation with a probability for each image, whose draws can be repeated.

    The random numbers are drawn in kornia's order, so that the same seed gives the same noise with and without kornia.
    """

    # of the augmentation itself
    generate_parameters: Callable[..., dict[str, Tensor]]
    apply_transform: Callable[..., Tensor]

    def __init__(self, p: float = 1.0, same_on_batch: bool = False, keepdim: bool = True):
        super().__init__()
        self.p, self.same_on_batch, self.keepdim = p, same_on_batch, keepdim
        self._params: dict[str, Tensor] = {}
        self.flags: dict[str, Any] = {}

    def forward_parameters(self, batch_shape: tuple[int, ...]) -> dict[str, Tensor]:
        """Draws of a batch; `batch_prob` is 1 for images that are changed."""
        count = batch_shape[0]
        if self.p in (0, 1):
            changed = torch.full((count,), float(self.p))
        else:
            changed = (torch.rand(1 if self.same_on_batch else count) < self.p).float().expand(count)
        return {**self.generate_parameters(batch_shape), "batch_prob": changed}

    def forward(self, input: Tensor, params: Mapping[str, Tensor] | None = None) -> Tensor:
        images = input.reshape((1,) * max(0, 4 - input.ndim) + tuple(input.shape))
        drawn = self.forward_parameters(tuple(images.shape)) if params is None else dict(params)
        self._params = drawn
        changed = drawn.get("batch_prob", torch.ones(len(images))) > 0.5
        noisy = self.apply_transform(images, drawn, self.flags)
        if not bool(changed.all()):
            noisy = torch.where(changed.to(images.device)[:, None, None, None], noisy, images)
        return noisy.reshape(input.shape) if self.keepdim else noisy
