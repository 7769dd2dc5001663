"""Read noise that differs from pixel to pixel."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class ReadNoiseNonuniformity(Effect):
    """The source follower of each pixel has noise of its own, in addition to the read noise that all pixels have.

    The standard deviations are lognormal over the pixels, with a long tail of noisy ones, and drawn once per camera. A
    measured standard deviation of each pixel's own noise (`map`, a file) replaces the drawn ones. A camera whose read noise
    was measured pixel by pixel as a whole has `read_noise.map` instead.
    """

    name = "read_noise_nonuniformity"
    proposed = False  # its confusion with similar effects has not been counted
    stage = Stage.READOUT
    order = 58
    aliases = ("noisy pixels", "sCMOS noise map", "pixel-dependent noise")
    summary = "Each pixel has its own read noise; few pixels have much more than the others."
    equation = "V <- V + s_pixel n, n ~ N(0, 1) in every frame, s = excess exp(spread z - spread^2), z ~ N(0, 1) per camera"
    source = """F. Huang et al., Nature Methods 10 (2013) 653 (noise maps of sCMOS cameras); X. Wang et al.,
    IEDM 2006 (source-follower noise)"""
    separates = """compute the variance of each pixel over many dark frames: it differs by more than the
    chi-square scatter and is the same in the next series; heavy tails of read_noise occur in all pixels,
    rts_noise has discrete levels"""
    map_unit = "e-"
    map_low = 0.0
    excess_e = Strength(
        1.0,
        unit="e-",
        high=1e4,
        trials=(0.7, 2.0),
        source="rms over the pixels of what each has beyond the common read noise; sCMOS: 0.5 to 1 e-",
    )
    spread = Parameter(
        0.7,
        low=0.05,
        high=1.5,
        trials=(0.4, 1.0),
        source="of ln s; the tail of sCMOS cameras reaches 10 times the median",
    )

    def apply(self, signal, p, stream, context):
        if (own := context.measured_map(self.name, signal)) is None:
            own = p.excess_e * torch.exp(p.spread * stream.fixed.normal() - p.spread**2)
        return signal + own * stream.fork("noise").normal()

    def moments(self, mean, p, context):
        own = context.measured_map(self.name, mean)
        return mean, p.excess_e**2 if own is None else own**2
