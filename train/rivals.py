"""Augmentations that sensor noise competes with: functions of (B, C, H, W) in [0, 1], each acting on a share `p`.

They are those of SPNv2 and SPNv3 (T. H. Park and S. D'Amico, Advances in Space Research, 2023) that need no weights, by
their definition in Albumentations where there is one. Random numbers come from torch's global generator; gray images
stay gray.
"""

import torch
from pydantic import Field, field_validator
from torch import Tensor
from torch.nn.functional import avg_pool2d, conv2d, interpolate, pad

from visaug_train.batch_noise import BatchAugmentation, chosen, uniform
from visaug_train.sections import Amounts, Counts, PositivePair, Share, SharePair


class RandomErase(BatchAugmentation):
    """Random erasing (Z. Zhong et al., AAAI 2020): a rectangle of `area` (share of the image) and `aspect` (height over width)
    is filled with uniform noise.
    """

    area: SharePair = (0.02, 0.33)
    aspect: PositivePair = (0.3, 3.3)

    def __call__(self, images: Tensor) -> Tensor:
        b, _, h, w = images.shape
        area = uniform(b, self.area, images) * h * w
        low, high = (float(torch.tensor(end).log()) for end in self.aspect)
        aspect = uniform(b, (low, high), images).exp()
        height, width = (area * aspect).sqrt().clamp(1, h), (area / aspect).sqrt().clamp(1, w)
        top, left = (uniform(b, (0, 1), images) * (h - height), uniform(b, (0, 1), images) * (w - width))
        y, x = (torch.arange(n, device=images.device) for n in (h, w))
        rows = (y >= top[:, None]) & (y < (top + height)[:, None])
        columns = (x >= left[:, None]) & (x < (left + width)[:, None])
        inside = (rows[:, None, :, None] & columns[:, None, None, :]) & chosen(self.p, images)
        filling = torch.rand(b, 1, h, w, device=images.device, dtype=images.dtype)
        return torch.where(inside, filling, images)


class SunFlare(BatchAugmentation):
    """A source with a halo that falls off exponentially, and `ghosts` discs on the line through the image's centre, as
    Albumentations' RandomSunFlare.
    """

    radius: PositivePair = Field((0.05, 0.3), description="of the source's halo, of the image's longer side")
    ghosts: Counts = (3, 7)

    def __call__(self, images: Tensor) -> Tensor:
        b, _, h, w = images.shape
        y = torch.arange(h, device=images.device, dtype=images.dtype)[:, None]
        x = torch.arange(w, device=images.device, dtype=images.dtype)
        centre_y, centre_x = uniform(b, (0, h), images), uniform(b, (0, w), images)

        def distance(cy: Tensor, cx: Tensor) -> Tensor:
            return ((y - cy[:, None, None]) ** 2 + (x - cx[:, None, None]) ** 2).sqrt()

        radius = (uniform(b, self.radius, images) * max(h, w))[:, None, None]
        light = torch.exp(-3 * distance(centre_y, centre_x) / radius)
        count = int(torch.randint(self.ghosts[0], self.ghosts[1] + 1, ()))
        for _ in range(count):
            along = uniform(b, (-1.0, 1.0), images)  # -1 is the source mirrored at the image's centre
            at_y = h / 2 + along * (centre_y - h / 2)
            at_x = w / 2 + along * (centre_x - w / 2)
            size = (uniform(b, (0.01, 0.08), images) * max(h, w))[:, None, None]
            brightness = uniform(b, (0.0, 0.3), images)[:, None, None]
            light = light + brightness * (distance(at_y, at_x) < size)
        return torch.where(chosen(self.p, images), (images + light[:, None]).clamp(0, 1), images)


class BrightnessContrast(BatchAugmentation):
    """(1 + c) x + b with c and b uniform within `contrast` and `brightness`."""

    brightness: Share = 0.2
    contrast: Share = 0.2

    def __call__(self, images: Tensor) -> Tensor:
        b = len(images)
        slope = 1 + uniform(b, (-self.contrast, self.contrast), images)[:, None, None, None]
        shift = uniform(b, (-self.brightness, self.brightness), images)[:, None, None, None]
        return torch.where(chosen(self.p, images), (slope * images + shift).clamp(0, 1), images)


class RandomMotionBlur(BatchAugmentation):
    """Mean along a line of `length_px` pixels at a random angle."""

    length_px: Amounts = (3.0, 7.0)

    def __call__(self, images: Tensor) -> Tensor:
        b, c = images.shape[:2]
        reach = int(self.length_px[1] / 2 + 1)
        length = uniform(b, self.length_px, images)
        angle = uniform(b, (0.0, torch.pi), images)
        points = 8 * reach + 1
        steps = (torch.arange(points, device=images.device, dtype=images.dtype) + 0.5) / points - 0.5
        at_y = steps * (length * angle.sin())[:, None] + reach
        at_x = steps * (length * angle.cos())[:, None] + reach
        kernel = images.new_zeros(b, (2 * reach + 1) ** 2)
        low_y, low_x = at_y.floor(), at_x.floor()
        for dy in (0, 1):  # bilinear shares of each point of the line
            for dx in (0, 1):
                share = (1 - (at_y - low_y - dy).abs()) * (1 - (at_x - low_x - dx).abs())
                place = (low_y + dy) * (2 * reach + 1) + low_x + dx
                kernel.scatter_add_(1, place.long().clamp(0, kernel.shape[1] - 1), share)
        kernel = (kernel / kernel.sum(dim=1, keepdim=True)).reshape(b, 1, 2 * reach + 1, 2 * reach + 1)
        blurred = convolve_each(images, kernel.repeat_interleave(c, dim=0))
        return torch.where(chosen(self.p, images), blurred, images)


class IsoNoise(BatchAugmentation):
    """Albumentations' ISONoise on luminance: x + n (1 - x), n Poisson of mean s i (in 8-bit levels): s the image's standard
    deviation, i the intensity.
    """

    intensity: Amounts = (0.1, 0.5)

    def __call__(self, images: Tensor) -> Tensor:
        b, _, h, w = images.shape
        rate = images.std(dim=(1, 2, 3)) * uniform(b, self.intensity, images) * 255
        noise = torch.poisson(rate[:, None, None, None].expand(b, 1, h, w)) / 255
        return torch.where(chosen(self.p, images), (images + noise * (1 - images)).clamp(0, 1), images)


class RandConv(BatchAugmentation):
    """A random convolution (Z. Xu et al., ICLR 2021): a x + (1 - a) k * x, a uniform in [0, 1], k normal of variance
    1 / size^2, one of the sizes for each batch.
    """

    kernels: list[int] = Field([1, 3, 5, 7])

    @field_validator("kernels")
    @classmethod
    def _odd(cls, kernels: list[int]) -> list[int]:
        if not kernels or any(k < 1 or k % 2 == 0 for k in kernels):
            raise ValueError("expected odd sizes such as [1, 3, 5, 7]")
        return kernels

    def __call__(self, images: Tensor) -> Tensor:
        b, c, _, _ = images.shape
        size = self.kernels[int(torch.randint(len(self.kernels), ()))]
        kernel = torch.randn(b, 1, size, size, device=images.device, dtype=images.dtype) / size
        changed = convolve_each(images, kernel.repeat_interleave(c, dim=0))
        mix = uniform(b, (0.0, 1.0), images)[:, None, None, None]
        return torch.where(chosen(self.p, images), (mix * images + (1 - mix) * changed).clamp(0, 1), images)


class Corruptions(BatchAugmentation):
    """One corruption for each image, in the manner of D. Hendrycks and T. Dietterich (ICLR 2019): contrast, pixelation,
    posterisation, impulse noise, speckle noise or defocus.
    """

    severity: SharePair = Field((0.2, 1.0), description="0 does nothing, 1 is the strongest")

    def __call__(self, images: Tensor) -> Tensor:
        corruptions = (_contrast, _pixelate, _posterize, _impulse, _speckle, _defocus)
        acts = chosen(self.p, images).flatten().tolist()
        kinds = torch.randint(len(corruptions), (len(images),)).tolist()
        severity = uniform(len(images), self.severity, images).tolist()
        changed = [
            corruptions[kind](image[None], s)[0] if act else image
            for image, act, kind, s in zip(images, acts, kinds, severity)
        ]
        return torch.stack(changed).clamp(0, 1)


def convolve_each(images: Tensor, kernels: Tensor) -> Tensor:
    """Each plane of (B, C, H, W) with its own kernel (B C, 1, k, k), k odd; borders are continued."""
    b, c, h, w = images.shape
    reach = kernels.shape[-1] // 2
    planes = pad(images.reshape(1, b * c, h, w), [reach] * 4, mode="replicate")
    return conv2d(planes, kernels, groups=b * c).reshape(b, c, h, w)


def _contrast(image: Tensor, severity: float) -> Tensor:
    mean = image.mean()
    return mean + (image - mean) * (1 - 0.8 * severity)


def _pixelate(image: Tensor, severity: float) -> Tensor:
    factor = 1 + round(3 * severity)
    small = avg_pool2d(image, factor, ceil_mode=True)
    return interpolate(small, scale_factor=float(factor))[..., : image.shape[2], : image.shape[3]]


def _posterize(image: Tensor, severity: float) -> Tensor:
    levels = 2 ** (8 - round(5 * severity)) - 1
    return (image * levels).round() / levels


def _impulse(image: Tensor, severity: float) -> Tensor:
    drawn = torch.rand_like(image[:, :1])
    share = 0.05 * severity
    return torch.where(drawn < share, 0.0, torch.where(drawn > 1 - share, 1.0, image))


def _speckle(image: Tensor, severity: float) -> Tensor:
    return image * (1 + 0.3 * severity * torch.randn_like(image[:, :1]))


def _defocus(image: Tensor, severity: float) -> Tensor:
    radius = 1 + 2 * severity
    reach = int(radius + 1)
    x = torch.arange(-reach, reach + 1, device=image.device, dtype=image.dtype)
    disc = (radius + 0.5 - (x[:, None] ** 2 + x**2).sqrt()).clamp(0, 1)
    kernel = (disc / disc.sum())[None, None].expand(image.shape[1], 1, -1, -1)
    return convolve_each(image, kernel)
