"""The fused implementation for GPUs, run by eager torch on a CPU."""

from torch import Tensor

from visaug.camera import Camera, fast, fast_gpu


def take(camera: Camera, images: Tensor, scale, values, keys, patterns, kept=False, origin=(0, 0), white=0):
    """As `fast.take` on a GPU."""
    drawn = fast.drawn(camera, images.shape, scale, values, keys, patterns, kept, origin)
    return fast_gpu.take(images, drawn, keys, origin, fast_gpu.noisy)
