"""Effects that no catalogue has, as a user would write them down after `visaug effects new NAME`.

    visaug diagnose FRAMES --camera camera.yaml --effects benchmark/user_effects.py

They are the benchmark's `foreign` effects (foreign.py simulates them in NumPy).
"""

import torch

from visaug.effects import Effect, Parameter, Stage


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


class RowLoading(Effect):
    """Bright rows sag: every pixel loses a share of its row's mean. The row's amplifiers load their supply."""

    name = "row_loading"
    stage = Stage.READOUT
    share = Parameter(0.01, unit="fraction", high=0.5, strength=True, trials=(0.001, 0.01))

    def apply(self, signal, p, stream, context):
        return signal - p.share * signal.mean(-1, keepdim=True)


class ElectronicGhost(Effect):
    """A share of the signal comes again some pixels later in the row: an echo on the video line."""

    name = "electronic_ghost"
    stage = Stage.READOUT
    share = Parameter(0.01, unit="fraction", high=0.5, strength=True, trials=(0.001, 0.01))
    late_px = Parameter(20.0, unit="px", low=1.0, high=60.0, trials=tuple(range(14, 31, 2)))

    def apply(self, signal, p, stream, context):
        late = context.columns(signal) - p.late_px
        index = late.floor().clamp(0, signal.shape[-1] - 2).long().expand(signal.shape)
        part = (late - late.floor()).expand(signal.shape)
        echo = signal.gather(-1, index) * (1 - part) + signal.gather(-1, index + 1) * part
        return signal + p.share * torch.where(late >= 0, echo, 0.0)


class Checkerboard(Effect):
    """Pixels share an amplifier in pairs, staggered: more on black fields, less on white ones."""

    name = "checkerboard"
    stage = Stage.READOUT
    amplitude_e = Parameter(1.0, unit="e-", low=-100.0, high=100.0, strength=True, trials=(0.2, 1.0))

    def apply(self, signal, p, stream, context):
        odd = (context.rows(signal) + context.columns(signal)) % 2
        return signal + p.amplitude_e * (2 * odd - 1)


class ConverterStep(Effect):
    """All signal above a level reads higher: a coarse stage of the converter is off."""

    name = "converter_step"
    stage = Stage.READOUT
    step_e = Parameter(10.0, unit="e-", low=-1000.0, high=1000.0, strength=True, trials=(5.0, 50.0))
    level = Parameter(0.3, unit="share of the full well", high=1.0, trials=(0.1, 0.2, 0.3, 0.5, 0.7))

    def apply(self, signal, p, stream, context):
        return signal + p.step_e * (signal > p.level * context.full_well_e)


class BitFlips(Effect):
    """Some pixels of every frame arrive with one of the eight lowest bits flipped: a noisy link."""

    name = "bit_flips"
    stage = Stage.DIGITAL
    order = 80
    density = Parameter(1e-3, unit="share of pixels", high=0.1, strength=True, trials=(1e-4, 1e-3))

    def apply(self, signal, p, stream, context):
        code, bit = signal.round().long(), (8 * stream.fork("bit").uniform()).long()
        hit = stream.uniform() < p.density
        return torch.where(hit, (code ^ (1 << bit)).to(signal.dtype), signal)
