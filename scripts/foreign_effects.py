"""Three effects that no catalogue has, as a user would write them down after `visaug effects new NAME`.

    visaug diagnose FRAMES --camera camera.yaml --effects scripts/foreign_effects.py

They are the benchmark's `foreign` effects (scripts/independent/foreign.py holds the other side, in NumPy).
"""

import math

import torch

from visaug.effects import Effect, Parameter, Stage


class SlantedPickup(Effect):
    """A plane wave across rows and columns whose phase changes from frame to frame: mains or a motor nearby."""

    name = "slanted_pickup"
    stage = Stage.READOUT
    amplitude_e = Parameter(0.5, unit="e-", strength=True, trials=(0.3, 1.5))
    period_px = Parameter(10.0, unit="px", low=4.0, high=40.0, trials=(7.0, 8.5, 12.0, 14.5))
    slant = Parameter(0.75, unit="rad", high=math.pi / 2, trials=(0.5, 1.0))

    def apply(self, signal, p, stream, context):
        across = context.rows(signal) * torch.cos(p.slant) + context.columns(signal) * torch.sin(p.slant)
        return signal + p.amplitude_e * torch.sin(
            2 * math.pi * (across / p.period_px + stream.uniform("frame"))
        )


class RowGainNoise(Effect):
    """The gain of each row wavers from frame to frame: a noisy reference voltage."""

    name = "row_gain_noise"
    stage = Stage.READOUT
    sigma = Parameter(0.001, unit="fraction", strength=True, trials=(0.001, 0.005))

    def apply(self, signal, p, stream, context):
        return signal * (1 + p.sigma * stream.normal("row"))


class Patchwork(Effect):
    """Blocks of 8 x 8 pixels with an offset of their own in every frame: a lossy block coder."""

    name = "patchwork"
    stage = Stage.READOUT
    sigma_e = Parameter(0.5, unit="e-", strength=True, trials=(0.3, 1.5))

    def apply(self, signal, p, stream, context):
        rows, columns = context.window
        offsets = stream.over(*(range(w.start // 8, w.stop // 8 + 1) for w in (rows, columns))).normal()
        row, column = (torch.tensor([i // 8 - w.start // 8 for i in w]) for w in (rows, columns))
        return signal + p.sigma_e * offsets[..., row[:, None], column]
