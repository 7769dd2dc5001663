"""What the arms do to a batch of training images besides ultralytics' own: functions of (B, C, H, W) in [0, 1].

Beside the paper's blur and white noise these are the augmentations that sensor noise competes with: those of SPNv2 and SPNv3
(T. H. Park and S. D'Amico, Advances in Space Research, 2023) that need no weights, by their definition in Albumentations where
there is one. Random numbers come from torch's global generator, which ultralytics seeds by seed and rank. Gray images have
equal channels, and one draw goes to all channels, as a gray camera would.
"""

import torch
from pydantic import Field, field_validator
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, conv2d, interpolate, pad

from visaug.effects.optics.defocus import disc
from visaug_train.sections import Amounts, ConfigSection, Counts, PositivePair, Share, SharePair


class BatchAugmentation(ConfigSection):
    """A change of a share `p` of the images."""

    p: Share = 0.5

    def __call__(self, images: Tensor) -> Tensor:
        changed = self.change(images).clamp(0, 1)
        return torch.where(chosen(self.p, images), changed, images)

    def change(self, images: Tensor) -> Tensor:
        """All images, changed; what leaves [0, 1] is cut afterwards."""
        raise NotImplementedError


class AugmentationModule(nn.Module):
    """An augmentation as a module."""

    def __init__(self, augmentation: BatchAugmentation) -> None:
        super().__init__()
        self.augmentation = augmentation

    def forward(self, images: Tensor) -> Tensor:
        return self.augmentation(images)

    def extra_repr(self) -> str:
        return repr(self.augmentation)


class GaussianBlur(BatchAugmentation):
    """Blur by a Gaussian of standard deviation uniform in `sigma_px`."""

    p: Share = 0.1
    sigma_px: Amounts = (0.3, 1.0)

    def change(self, images: Tensor) -> Tensor:
        sigma = uniform(images, self.sigma_px).clamp_min(1e-3)
        reach = max(1, int(3 * self.sigma_px[1] + 0.5))
        x = torch.arange(-reach, reach + 1, device=images.device)
        kernel = torch.exp(-0.5 * (x / sigma[:, 0, 0]) ** 2)
        kernel = (kernel / kernel.sum(dim=1, keepdim=True))[:, None]
        return convolve_each(convolve_each(images, kernel[..., None]), kernel[:, :, None])


class GaussianNoise(BatchAugmentation):
    """White noise whose standard deviation (1 is full scale) is uniform in `std`, drawn for each image."""

    std: Amounts = (0.0, 0.02)

    def change(self, images: Tensor) -> Tensor:
        return add_white(images, uniform(images, self.std))


class RandomErase(BatchAugmentation):
    """Random erasing (Z. Zhong et al., AAAI 2020): a rectangle of `area` (share of the image) and `aspect` (height over width)
    is filled with uniform noise.
    """

    area: SharePair = (0.02, 0.33)
    aspect: PositivePair = (0.3, 3.3)

    def change(self, images: Tensor) -> Tensor:
        h, w = images.shape[2:]
        area = uniform(images, self.area) * h * w
        low, high = torch.tensor(self.aspect).log().tolist()
        aspect = uniform(images, (low, high)).exp()
        height, width = (area * aspect).sqrt().clamp(1, h), (area / aspect).sqrt().clamp(1, w)
        top, left = uniform(images, (0, 1)) * (h - height), uniform(images, (0, 1)) * (w - width)
        y, x = grid(images)
        inside = (y >= top) & (y < top + height) & (x >= left) & (x < left + width)
        return torch.where(inside, torch.rand_like(images[:, :1]), images)


class SunFlare(BatchAugmentation):
    """A source with a halo that falls off exponentially, and `ghosts` discs on the line through the image's centre, as
    Albumentations' RandomSunFlare.
    """

    radius: PositivePair = Field((0.05, 0.3), description="of the source's halo, of the image's longer side")
    ghosts: Counts = (3, 7)

    def change(self, images: Tensor) -> Tensor:
        h, w = images.shape[2:]
        y, x = grid(images)
        centre_y, centre_x = uniform(images, (0, h)), uniform(images, (0, w))
        radius = uniform(images, self.radius) * max(h, w)
        light = torch.exp(-3 * torch.hypot(y - centre_y, x - centre_x) / radius)
        for _ in range(int(torch.randint(self.ghosts[0], self.ghosts[1] + 1, ()))):
            along = uniform(images, (-1.0, 1.0))  # -1 is the source mirrored at the image's centre
            at_y, at_x = h / 2 + along * (centre_y - h / 2), w / 2 + along * (centre_x - w / 2)
            size, brightness = uniform(images, (0.01, 0.08)) * max(h, w), uniform(images, (0.0, 0.3))
            light = light + brightness * (torch.hypot(y - at_y, x - at_x) < size)
        return images + light


class BrightnessContrast(BatchAugmentation):
    """(1 + c) x + b with c and b uniform within `contrast` and `brightness`."""

    brightness: Share = 0.2
    contrast: Share = 0.2

    def change(self, images: Tensor) -> Tensor:
        slope = 1 + uniform(images, (-self.contrast, self.contrast))
        return slope * images + uniform(images, (-self.brightness, self.brightness))


class RandomMotionBlur(BatchAugmentation):
    """Mean along a line of `length_px` pixels at a random angle."""

    length_px: Amounts = (3.0, 7.0)

    def change(self, images: Tensor) -> Tensor:
        reach = int(self.length_px[1] / 2 + 1)
        length, angle = (uniform(images, ends)[:, 0, 0] for ends in (self.length_px, (0.0, torch.pi)))
        points, side = 8 * reach + 1, 2 * reach + 1
        steps = (torch.arange(points, device=images.device, dtype=images.dtype) + 0.5) / points - 0.5
        at_y, at_x = steps * (length * angle.sin()) + reach, steps * (length * angle.cos()) + reach
        kernel = images.new_zeros(len(images), side**2)
        low_y, low_x = at_y.floor(), at_x.floor()
        for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)):  # bilinear shares of each point of the line
            share = (1 - (at_y - low_y - dy).abs()) * (1 - (at_x - low_x - dx).abs())
            place = (low_y + dy) * side + low_x + dx
            kernel.scatter_add_(1, place.long().clamp(0, side**2 - 1), share)
        kernel = kernel / kernel.sum(dim=1, keepdim=True)
        return convolve_each(images, kernel.reshape(-1, 1, side, side))


class IsoNoise(BatchAugmentation):
    """Albumentations' ISONoise on luminance: x + n (1 - x), n Poisson of mean s i (in 8-bit levels): s the image's standard
    deviation, i the intensity.
    """

    intensity: Amounts = (0.1, 0.5)

    def change(self, images: Tensor) -> Tensor:
        rate = images.std(dim=(1, 2, 3), keepdim=True) * uniform(images, self.intensity) * 255
        return images + torch.poisson(rate.expand_as(images[:, :1])) / 255 * (1 - images)


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

    def change(self, images: Tensor) -> Tensor:
        size = self.kernels[int(torch.randint(len(self.kernels), ()))]
        kernel = torch.randn(len(images), 1, size, size, device=images.device, dtype=images.dtype) / size
        changed, mix = convolve_each(images, kernel), uniform(images, (0.0, 1.0))
        return mix * images + (1 - mix) * changed


class Corruptions(BatchAugmentation):
    """One corruption for each image, in the manner of D. Hendrycks and T. Dietterich (ICLR 2019): contrast, pixelation,
    posterisation, impulse noise, speckle noise or defocus.
    """

    severity: SharePair = Field((0.2, 1.0), description="0 does nothing, 1 is the strongest")

    def change(self, images: Tensor) -> Tensor:
        corruptions = (_contrast, _pixelate, _posterize, _impulse, _speckle, _defocus)
        kinds = torch.randint(len(corruptions), (len(images),)).tolist()
        drawn = zip(images, kinds, uniform(images, self.severity).flatten().tolist())
        return torch.cat([corruptions[kind](image[None], s) for image, kind, s in drawn])


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
    return convolve_each(image, disc(image.new_full((1, 1, 1, 1), 1 + 2 * severity)))


def convolve_each(images: Tensor, kernels: Tensor) -> Tensor:
    """Each image of (B, C, H, W) with its own kernel (B, 1, k, l), k and l odd; borders are continued."""
    b, c, h, w = images.shape
    rows, columns = (n // 2 for n in kernels.shape[2:])
    planes = pad(images.reshape(1, b * c, h, w), [columns, columns, rows, rows], mode="replicate")
    return conv2d(planes, kernels.repeat_interleave(c, dim=0), groups=b * c).reshape(b, c, h, w)


def add_white(images: Tensor, std: Tensor) -> Tensor:
    """Images plus normal noise of standard deviation `std` (B, 1, 1, 1), one draw for all channels, cut to [0, 1]."""
    return (images + std * torch.randn_like(images[:, :1])).clamp(0, 1)


def chosen(p: float, images: Tensor) -> Tensor:
    """Which images are changed, (B, 1, 1, 1)."""
    return uniform(images, (0, 1)) < p


def uniform(images: Tensor, between: tuple[float, float]) -> Tensor:
    """A number for each image, (B, 1, 1, 1), uniform between two."""
    low, high = between
    return low + (high - low) * torch.rand(len(images), 1, 1, 1, device=images.device, dtype=images.dtype)


def grid(images: Tensor) -> tuple[Tensor, Tensor]:
    """Numbers of the rows, (H, 1), and of the columns, (W)."""
    y, x = (torch.arange(n, device=images.device, dtype=images.dtype) for n in images.shape[2:])
    return y[:, None], x
