"""Lost low bits."""

import numpy as np
import torch

from visaug.effects.effect import Effect, Stage, Strength, choice


class BitTruncation(Effect):
    """A link with fewer bits than the converter, or 12-bit data in a 16-bit file: the lowest bits are zero."""

    name = "bit_truncation"
    stage = Stage.DIGITAL
    order = 70
    aliases = ("LSB loss", "bit shift", "comb histogram")
    summary = "The lowest bits are lost."
    equation = "y <- 2^bits floor(y / 2^bits); rounding: 2^bits floor(y / 2^bits + 1/2)"
    source = """B. Widrow and I. Kollar, Quantization Noise (Cambridge 2008); adds 4^bits / 12 DN^2 where
    noise is wide"""
    separates = """look at the histogram of codes: all are multiples of a power of two; missing_codes has gaps
    without such a step"""
    differentiable = False
    why_not = """the number of bits is an integer; the gradient of the image passes straight through, as for rounding"""
    bits = Strength(
        2.0, "bits", 0.0, 15.0, "16-bit files of 12-bit cameras: 4", integer=True, trials=(1, 2, 3, 4)
    )
    mode = choice(("cut", "round"), "most links truncate; scaling in software rounds")

    def apply(self, signal, p, stream, context):
        step = 2.0 ** p.bits.round()  # what a fit gives may lie between
        kept = torch.floor(signal / step + (0.5 if p.mode == "round" else 0)) * step
        kept = torch.where(p.bits > 0, kept.clamp_max(context.max_dn), signal)
        return signal + (kept - signal).detach()

    @classmethod
    def looks(cls, seen):
        """The bits that no code has; the highest code is left out, where the converter clips."""
        step = int(np.gcd.reduce(np.diff(seen.codes[:-1]).astype(np.int64))) if len(seen.codes) > 2 else 1
        bits = (step & -step).bit_length() - 1
        return [{"bits": bits, "mode": mode} for mode in ("cut", "round")] if 0 < bits <= 15 else []
