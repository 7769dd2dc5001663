"""Missing codes."""

import torch

from visaug.effects.effect import Effect, Stage, Strength, choice


class MissingCodes(Effect):
    """A converter with unequal steps skips codes; a digital gain or look-up table skips them evenly.

    A missing code is replaced by the next lower code that exists. Code 0 always exists.
    """

    name = "missing_codes"
    stage = Stage.DIGITAL
    order = 60
    aliases = ("DNL", "gaps in the histogram", "comb histogram")
    summary = "Some output codes never occur; the set is fixed for a camera."
    equation = """y <- max{k <= y: k exists}; a code is missing with probability density, or at every
    1/density-th place"""
    source = "IEEE Std 1241-2010, missing codes"
    separates = """take the histogram of codes over a ramp of light: the same codes are empty at every level;
    bit_truncation leaves multiples of a power of two"""
    differentiable = False
    why_not = """whether a code exists is discrete; the gradient of the image passes straight through, as for
    rounding"""
    density = Strength(
        0.05,
        unit="share of codes",
        high=0.5,
        trials=(0.02, 0.1),
        source="0 for a good converter; a digital gain g gives 1 - 1/g; above a gain of 2 use bit_truncation",
    )
    pattern = choice(("random", "even"), "random: the converter; even: a digital gain")

    def apply(self, signal, p, stream, context):
        codes = torch.arange(context.max_dn + 1, device=signal.device)
        if p.pattern == "even":
            place = codes.double() * p.density
            missing = (place + p.density).floor() > place.floor()
        else:
            missing = stream.fixed.over(range(1), range(len(codes))).uniform("column") < p.density
        exists = torch.where(missing & (codes > 0), 0, codes)
        lookup = exists.cummax(dim=-1).values.to(signal.dtype)  # (B or 1, C or 1, 1, codes)
        index = signal.detach().round().long().clamp(0, context.max_dn)
        batch, channels = signal.shape[:2]
        found = lookup.expand(batch, channels, 1, len(codes)).flatten(2).gather(2, index.flatten(2))
        found = torch.where(p.density > 0, found.view_as(signal), signal)
        return signal + (found - signal).detach()
