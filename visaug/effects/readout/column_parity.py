"""Interleaved and side-by-side readout channels."""

import numpy as np
import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice

MOST = 64  # channels; column-parallel sensors have 2 to 64 outputs
READ = (2, 3, 4, 6, 8, 12, 16)  # interleaved channels that a look at the columns distinguishes,
CERTAIN = 1e-3  # if channels without offsets differ as much with a probability below this


class ColumnParity(Effect):
    """Columns are read by several amplifiers or converters in turn, each with its own offset and gain.

    `interleaved`: column c belongs to channel c mod n; with two channels odd and even columns differ. `blocks`: n taps of
    equal width lie side by side. Offsets and gains of the channels have mean 0 and rms 1 over the channels, times `offset_e`
    and `gain`, so the mean of the frame does not change; with two channels the difference is twice the parameter.
    """

    name = "column_parity"
    stage = Stage.READOUT
    order = 32
    aliases = ("odd-even columns", "tap mismatch", "channel mismatch", "fixed pattern noise", "FPN")
    aliases += ("vertical stripes",)
    summary = "Columns of several readout channels differ in offset and gain."
    equation = """V <- V (1 + gain g_k) + offset o_k, k = column mod n, or floor(n column / columns); o and g
    of mean 0 and rms 1 over the n channels, drawn once per camera"""
    source = """A. El Gamal et al., Modeling and estimation of FPN components in CMOS image sensors, Proc.
    SPIE 3301 (1998) 168 (column FPN); derived for amplifiers that take turns"""
    separates = """average many dark frames and compute the spectrum of the column means: lines at multiples
    of 1/n; the column part of dsnu is white, tap_mismatch has one step"""
    offset_e = Strength(1.0, "e-", 0.0, 1e4, "rms; a fraction of the read noise", trials=(0.3, 1.5))
    gain = Strength(0.0, "fraction", 0.0, 0.2, "rms; matched to 0.1 to 1 %", trials=(0.002, 0.01))
    channels = Parameter(
        2.0, "channels", 2.0, MOST, "2: odd and even columns", integer=True, trials=(2, 4, 8)
    )
    layout = choice(("interleaved", "blocks"), "blocks: taps side by side, as in large CCDs")
    special_cases = (({"layout": "blocks", "channels": 2}, "tap_mismatch"),)

    @classmethod
    def looks(cls, seen):
        """Interleaved channels by the column means of the mean dark frame, with gains that differ too.

        A fit that starts without gains never finds them, since the variance that they add has no slope at 0.
        """
        from scipy.stats import f_oneway  # heavy to import

        profile, step = seen.dark_e.mean(0), np.diff(seen.columns[:2])
        if len(profile) < 4 * READ[0]:
            return []
        columns = np.rint(seen.columns / step).astype(int)
        numbers = [n for n in READ if len(profile) >= 4 * n]
        tests = {n: f_oneway(*(profile[columns % n == k] for k in range(n))) for n in numbers}
        channels = max(tests, key=lambda n: tests[n].statistic)
        if tests[channels].pvalue > CERTAIN / len(tests):
            return []
        levels = [profile[columns % channels == k].mean() for k in range(channels)]
        share = 1 - 1 / tests[channels].statistic  # of their variance that is not chance
        offset_e = float(np.std(levels) * np.sqrt(share))
        return [{"offset_e": offset_e, "gain": cls.gain.trials[0], "channels": float(channels)}]

    def apply(self, signal, p, stream, context):
        channels = p.channels.round()  # what a fit gives may lie between
        columns = context.columns(signal)
        if p.layout == "interleaved":
            own = columns % channels
        else:
            own = torch.floor(columns * channels / context.resolution[1]).clamp_max(MOST - 1)
        levels = (_levels(stream.fixed.fork(what), channels) for what in ("offset", "gain"))
        offset, gain = (torch.take_along_dim(level, own.long(), -1) for level in levels)
        return signal * (1 + p.gain * gain) + p.offset_e * offset

    def moments(self, mean, p, context):
        return mean, p.offset_e**2 + (p.gain * mean) ** 2


def _levels(fixed, channels):
    """Of each channel, (B or 1, C, 1, MOST), of mean 0 and rms 1 over those that there are."""
    drawn = fixed.over(range(1), range(MOST)).normal("column")
    there = torch.arange(MOST, device=drawn.device) < channels
    apart = (drawn - (drawn * there).sum(-1, keepdim=True) / channels) * there
    return apart / (apart.square().sum(-1, keepdim=True) / channels).sqrt().clamp_min(1e-6)
