"""Streams of random numbers for a batch of images."""

import contextlib
import hashlib
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from visaug.core.errors import InputError
from visaug.core.sampling import distributions, tukey_lambda
from visaug.core.sampling.philox import mix, sensor_bits

kernels: Any = None  # without numba: same law and, but for rounding, same numbers from torch, slower
with contextlib.suppress(ImportError):
    from visaug.core.sampling import kernels


def as_seed(seed: Any, name: str = "seed") -> int:
    """A seed as Python's whole number, whatever its type: `derive_key` takes NumPy's 3 for another word than 3."""
    try:
        return operator.index(seed)
    except TypeError:
        raise InputError(f"{seed!r} is not valid", field=name, expected="a whole number") from None


def derive_key(*words: object) -> int:
    """A 64-bit key from a seed and names; different arguments give independent streams."""
    return int.from_bytes(hashlib.blake2b(repr(words).encode(), digest_size=8).digest(), "little")


def _signed_key(words: tuple[object, ...]) -> int:
    return signed(derive_key(*words))


# What `torch.compiler.assume_constant_result` does; to call it would import all of the compiler, 1.3 s, for everybody.
vars(_signed_key)["_dynamo_marked_constant"] = True


def signed(key: int) -> int:
    """The int64 with the same bits as an unsigned 64-bit key."""
    return key - 2**64 if key >= 2**63 else key


def _forked(keys: Tensor, name: int) -> Tensor:
    """`mix(keys ^ name)` on the CPU, without a dozen operators on a few numbers."""
    names = np.array([name & (2**64 - 1)], np.uint64)
    return torch.from_numpy(kernels.forked(keys.numpy().view(np.uint64), names).view(np.int64))


def _as_tensor(keys: "Sequence[int] | Tensor", device: torch.device) -> Tensor:
    """(B,) int64; (1,) where all keys are known to be equal."""
    if isinstance(keys, Tensor):
        return keys.to(device)
    distinct = keys[:1] if len(set(keys)) == 1 else keys
    return torch.tensor([signed(key) for key in distinct], dtype=torch.int64, device=device)


class Stream:
    """Random numbers of one effect for a batch of images.

    Args:
        keys: one 64-bit key an image (its temporal noise): B unsigned numbers, or (B,) int64 of the same bits.
        camera_keys: one 64-bit key an image (its fixed patterns); equal keys mean the same camera, hence the
            same maps. A tensor may be (1,): one camera for all.
        channels: number of planes C.
        window: rows and columns of the sensor that the images show.
        device: where the numbers are wanted.
        drawn: keeps the camera's own numbers, those of `fixed`, for the next batch of the same window; its tensors must
            not be changed.

    Every draw takes `vary`, which determines the pixels that share one number:
    "pixel" (B, C, H, W), "row" (B, C, H, 1), "column" (B, C, 1, W), "frame" (B, 1, 1, 1).
    Draw twice for two independent sets by `fork(name)`: the same stream gives the same numbers again.
    """

    def __init__(
        self,
        keys: Sequence[int] | Tensor,
        camera_keys: Sequence[int] | Tensor,
        channels: int,
        window: tuple[range, range],
        device: torch.device | str = "cpu",
        drawn: dict[tuple, Tensor] | None = None,
        is_fixed: bool = False,
    ):
        self._drawn, self._is_fixed = drawn, is_fixed
        self.channels = channels
        self.window = window
        self.device = torch.device(device)
        self._keys = _as_tensor(keys, self.device).expand(len(keys))
        self._camera_keys = _as_tensor(camera_keys, self.device)

    def fork(self, *words: object) -> "Stream":
        """An independent stream for the same images and cameras."""
        name = _signed_key(words)
        if self._native():
            keys, camera_keys = (_forked(k, name) for k in (self._keys, self._camera_keys))
        else:
            keys, camera_keys = mix(self._keys ^ name), mix(self._camera_keys ^ name)
        return self._like(keys, camera_keys, self._is_fixed)

    @property
    def keys(self) -> np.ndarray:
        """The keys of the frames, (B,) uint64, on the CPU."""
        return self._keys.cpu().numpy().view(np.uint64)

    @property
    def fixed(self) -> "Stream":
        """The stream of the cameras instead of the frames: its numbers are the same in every frame of a camera.

        Where all images come from one camera its draws have a batch of 1, and broadcast.
        """
        return self._like(self._camera_keys, self._camera_keys, True)

    def _like(self, keys: Tensor, camera_keys: Tensor, is_fixed: bool) -> "Stream":
        return Stream(keys, camera_keys, self.channels, self.window, self.device, self._drawn, is_fixed)

    def over(self, rows: range, columns: range) -> "Stream":
        """The same numbers for another window: whole rows, the whole sensor, or a table of fixed numbers."""
        return Stream(self._keys, self._camera_keys, self.channels, (rows, columns), self.device)

    def image(self, k: int) -> "Stream":
        """The same numbers for one image of the batch."""
        both = self._keys, self._camera_keys
        keys, camera_keys = (own if len(own) == 1 else own[k : k + 1] for own in both)
        return Stream(keys, camera_keys, self.channels, self.window, self.device)

    def uniform(self, vary: str = "pixel") -> Tensor:
        """Uniform in (0, 1), float32."""
        return distributions.uniform(self._bits(vary))

    def normal(self, vary: str = "pixel") -> Tensor:
        """Standard normal, float32."""
        if not self._native():
            return distributions.normal(self._bits(vary))
        return self._kept(lambda: self._filled(kernels.fill_normal, vary), vary)

    def pattern(self, column: Tensor, row: Tensor, pixel: Tensor) -> Tensor:
        """Sum of Gaussian parts of columns, rows and pixels with these standard deviations, (B or 1, 1, 1, 1), float32."""

        def summed() -> Tensor:
            lines = column * self.fork("column").normal("column") + row * self.fork("row").normal("row")
            return lines + pixel * self.fork("pixel").normal("pixel")

        parts = (column, row, pixel)
        if not self._native() or any(part.numel() > 1 or part.requires_grad for part in parts):
            return summed()
        return self._kept(summed, *map(float, parts))

    def _kept(self, make: Callable[[], Tensor], *what: object) -> Tensor:
        """What `make` gives, made once for this window where the camera's own numbers are kept."""
        if self._drawn is None or not self._is_fixed or len(self._keys) > 1:
            return make()
        place = (int(self._keys[0]), self.channels, self.window, *what)
        if place not in self._drawn:
            self._drawn[place] = make()
        return self._drawn[place]

    def tukey_lambda(self, shape: Tensor | float, vary: str = "pixel") -> Tensor:
        """Tukey-lambda noise of mean 0 and standard deviation 1, float32; differentiable in `shape`, the lambda, > -0.5, scalar or
        (B, 1, 1, 1): 0.14 is nearly Gaussian, below 0 the tails are heavy.
        """
        shape = torch.as_tensor(shape, dtype=torch.float64, device=self.device)
        if self._native() and not shape.requires_grad:
            shapes = shape.reshape(-1).expand(len(self._keys))
            scales = 1 / tukey_lambda.standard_deviation_tensor(shapes)
            return self._filled(kernels.fill_tukey, vary, shapes.numpy(), scales.numpy())
        quantile = distributions.tukey_lambda(self._bits(vary), shape)
        return quantile / tukey_lambda.standard_deviation_tensor(shape).float()

    def poisson(self, mean: Tensor) -> Tensor:
        """Poisson counts of the given means (B, C, H, W), float32; differentiable in `mean` (see below).

        For one image the count grows with the mean at the same random number: two means share their noise.
        """
        mean = mean.expand(len(self._keys), self.channels, *map(len, self.window))
        if self._native():
            count = self._filled(kernels.fill_poisson, "pixel", mean.detach().float().numpy())
        else:
            count = distributions.poisson(mean.detach(), self._bits("pixel"))
        return with_poisson_gradient(count, mean)

    def _native(self) -> bool:
        return kernels is not None and self.device.type == "cpu" and not torch.compiler.is_compiling()

    def _filled(self, fill: Callable, vary: str, *more: np.ndarray, dtype: Any = np.float32) -> Tensor:
        """What a kernel writes for each pixel, or line, of the window."""
        channels, rows, columns = self._extent(vary)
        out = np.empty((len(self._keys), channels, len(rows), len(columns)), dtype)
        fill(self._keys.numpy().view(np.uint64), rows.start, columns.start, *more, out)
        return torch.from_numpy(out)

    def _extent(self, vary: str) -> tuple[int, range, range]:
        rows, columns = self.window
        one = range(1)
        extents = {
            "pixel": (self.channels, rows, columns),
            "row": (self.channels, rows, one),
            "column": (self.channels, one, columns),
            "frame": (1, one, one),
        }
        if vary not in extents:
            raise ValueError(f"vary is {vary!r}; known: {', '.join(extents)}")
        return extents[vary]

    def _bits(self, vary: str) -> Tensor:
        if self._native():
            return self._filled(kernels.fill_bits, vary, dtype=np.int64)
        return sensor_bits(self._keys, *self._extent(vary))


def with_poisson_gradient(count: Tensor, mean: Tensor) -> Tensor:
    """A Poisson count N with the pathwise gradient of N = m + sqrt(m) z at fixed z: dN/dm = 1 + (N - m) / (2 m).

    A count has no derivative; this one is unbiased for the derivative of the mean and of the second moment:
    E[dN/dm] = 1 and E[2 N dN/dm] = 2 m + 1. Below m = 0.01 the denominator is held, to bound the gradient's variance;
    the derivative of the mean stays unbiased.
    """
    if not (mean.requires_grad and torch.is_grad_enabled()):
        return count
    fixed = mean.detach()
    slope = 1 + (count - fixed) / (2 * fixed.clamp_min(0.01))
    return count + (mean - fixed) * slope  # adds zero
