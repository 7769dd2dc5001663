"""Two gains in one frame."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class DualGain(Effect):
    """Every pixel is read at a high and at a low gain, and the frame is stitched: dark pixels from the first, bright ones from
    the second.

    The channel of low gain has more read noise, so the signal-to-noise ratio steps down at the seam. Where the gains and
    offsets are not matched the response steps there too. `read_noise` is that of the channel of high gain.
    """

    name = "dual_gain"
    stage = Stage.READOUT
    order = 64  # the channel is chosen by what was read, noise included
    aliases = ("HDR", "dual conversion gain", "DCG", "SNR dip", "stitching")
    summary = "Above a level the signal is read through a second channel with more noise and another gain and offset."
    equation = "where V > seam: V <- V + gain (V - seam) + offset + noise n, n ~ N(0, 1) in every frame"
    source = "B. Fowler et al., Proc. SPIE 7536 (2010) 753607 (sCMOS, two column amplifiers); step at the seam: derived"
    separates = """plot the variance of flats against their mean: a step up at one level, and in the linearity
    a step or a kink; nonlinearity bends smoothly"""
    differentiable = False
    why_not = "which channel a pixel is read from is discrete; the image has gradients within each"
    noise_e = Strength(10.0, "e-", 0.0, 1e4, "sCMOS: 1.5 e- at high, 30 e- at low gain", trials=(5.0, 20.0))
    gain = Strength(0.0, "fraction", -0.5, 0.5, "mismatch; 1 % after calibration", trials=(0.01, 0.04))
    offset_e = Strength(0.0, "e-", -1e4, 1e4, "mismatch at the seam", trials=(5.0, 20.0))
    seam_e = Parameter(1000.0, "e-", 1.0, 1e7, "range of the channel of high gain", trials=(700.0, 3000.0))

    def apply(self, signal, p, stream, context):
        second = self._response(signal, p) + p.noise_e * stream.normal()
        return torch.where(signal > p.seam_e, second, signal)

    def moments(self, mean, p, context):
        bright = mean > p.seam_e
        return torch.where(bright, self._response(mean, p), mean), bright * p.noise_e**2

    @staticmethod
    def _response(signal, p):
        return signal + p.gain * (signal - p.seam_e) + p.offset_e
