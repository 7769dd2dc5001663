"""What the arms do to a batch of training images besides ultralytics' own: functions of (B, C, H, W) in [0, 1].

Random numbers come from torch's global generator, which ultralytics seeds by seed and rank. Gray images have
equal channels, and one draw goes to all channels, as a gray camera would.
"""

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d

from visaug.camera import Camera, draw
from visaug.camera.scale import gain_of, white_dn
from visaug_train.sections import Amounts, ConfigSection, Share


class BatchAugmentation(ConfigSection):
    """A change of a share `p` of the images."""

    p: Share = 0.5

    def __call__(self, images: Tensor) -> Tensor:
        """The images, changed."""
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

    def __call__(self, images: Tensor) -> Tensor:
        b, c, h, w = images.shape
        sigma = uniform(b, self.sigma_px, images).clamp_min(1e-3)
        reach = max(1, int(3 * self.sigma_px[1] + 0.5))
        x = torch.arange(-reach, reach + 1, device=images.device)
        kernel = torch.exp(-0.5 * (x[None, :] / sigma[:, None]) ** 2)
        kernel = (kernel / kernel.sum(dim=1, keepdim=True)).repeat_interleave(c, dim=0)
        flat = torch.nn.functional.pad(images.reshape(1, b * c, h, w), [reach] * 4, mode="replicate")
        flat = conv2d(flat, kernel[:, None, :, None], groups=b * c)
        blurred = conv2d(flat, kernel[:, None, None, :], groups=b * c).reshape(b, c, h, w)
        return torch.where(chosen(self.p, images), blurred, images)


class GaussianNoise(BatchAugmentation):
    """White noise whose standard deviation (1 is full scale) is uniform in `std`, drawn for each image."""

    std: Amounts = (0.0, 0.02)

    def __call__(self, images: Tensor) -> Tensor:
        std = uniform(len(images), self.std, images)
        return torch.where(chosen(self.p, images), add_white(images, std), images)


class WhiteSensorNoise(nn.Module):
    """White Gaussian noise of a camera's variance, the paper's eq. 6: one standard deviation for the whole
    image.

    Its variance in electrons is that of the photons at the image's mean level, the dark current and the read
    noise; fixed patterns have no part in it. Camera parameters are drawn per image as for the sensor noise.
    """

    def __init__(self, camera: Camera, p: float = 1.0) -> None:
        super().__init__()
        self.camera, self.p = camera, p

    def forward(self, images: Tensor) -> Tensor:
        seed = int(torch.randint(2**31, (1,)))
        values = {
            k: v.numpy().astype(float)
            for k, v in draw(self.camera, len(images), np.random.default_rng(seed)).items()
        }
        gain, white = gain_of(self.camera, values), white_dn(self.camera, values)
        mean_e = images.mean(dim=(1, 2, 3)).double().cpu().numpy() * white * gain
        dark = values["exposure_s"] * values["dark_current.a_e_per_s"]
        dark = dark * np.exp(values["dark_current.b_per_c"] * values["temperature_c"])
        read = values["read_noise.sigma_e"] ** 2 + (values["read_noise.after_gain_dn"] * gain) ** 2
        std = np.sqrt(mean_e + dark + read) / gain / white
        noisy = add_white(images, torch.as_tensor(std, dtype=images.dtype, device=images.device))
        return torch.where(chosen(self.p, images), noisy, images)


class WhiteTwin(nn.Module):
    """White Gaussian noise with the variance that a noise module adds, image by image.

    Its mean, its patterns and its dependence on the level are left out, so that it differs from the module in
    structure alone.
    """

    def __init__(self, noise: nn.Module) -> None:
        super().__init__()
        self.noise = noise

    def forward(self, images: Tensor) -> Tensor:
        std = (self.noise(images) - images).std(dim=(1, 2, 3))
        return torch.where((std > 0)[:, None, None, None], add_white(images, std), images)


def add_white(images: Tensor, std: Tensor) -> Tensor:
    """Images plus normal noise of standard deviation `std` (B), one draw for all channels, clipped to [0, 1]."""
    b, _, h, w = images.shape
    noise = torch.randn(b, 1, h, w, device=images.device, dtype=images.dtype)
    return (images + std[:, None, None, None] * noise).clamp(0, 1)


def chosen(p: float, images: Tensor) -> Tensor:
    """Which images are noised, (B, 1, 1, 1)."""
    return (torch.rand(len(images), device=images.device) < p)[:, None, None, None]


def uniform(count: int, between: tuple[float, float], like: Tensor) -> Tensor:
    """`count` numbers, uniform between two."""
    low, high = between
    return low + (high - low) * torch.rand(count, device=like.device, dtype=like.dtype)
