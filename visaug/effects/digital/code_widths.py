"""Codes of unequal width."""

import math

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice

NEAREST = 0.49  # of a threshold to its ideal place, in code widths: thresholds stay in order
NARROWEST = 1e-6  # width of a code that is never met


class CodeWidths(Effect):
    """The thresholds of a converter are not evenly spaced (differential nonlinearity), so some codes occur more often.

    `thresholds`: each threshold has an independent error, as in flash and single-slope converters. `bits`: each bit has an
    error of its weight that is proportional to the root of the weight, as the capacitors of a converter by successive
    approximation have; codes are widest or absent at multiples of large powers of two. `stage`: the thresholds of the last
    stage of a pipelined or subranging converter, with independent errors, serve every range of the stages before it, so the
    errors repeat after `period` codes. Offset and gain of the converter do not change. A measured table (`map`: relative widths
    of the codes from a code-density test, at least two and at most 1, repeated where it is shorter than the range) replaces the
    pattern and `dnl`.

    Acts on the signal before it is rounded: what lies within the k-th code's own thresholds is moved to k - 1/2 ... k + 1/2.
    """

    name = "code_widths"
    stage = Stage.DIGITAL
    order = 45  # before the rounding, order 50
    aliases = ("DNL", "INL", "ADC nonlinearity", "differential nonlinearity")
    summary = "The codes of the converter are of unequal width, the same in every frame."
    equation = """y <- k - 1/2 + (y - T_k) / (T_(k+1) - T_k) for T_k <= y < T_(k+1), T_k = k - 1/2 + e_k;
    thresholds: e_k = dnl z_k / sqrt(2); stage: e_k = dnl z_(k mod period) / sqrt(2); bits: e_k = dnl sum_i
    bit_i(k) 2^((i - n) / 2) z_i without its slope; z ~ N(0, 1) per camera"""
    source = "IEEE Std 1241-2010, differential nonlinearity and code-density test"
    separates = """take the histogram of codes over a ramp of light: the same codes are rare or frequent at
    every level; missing_codes are empty, bit_truncation leaves multiples of a power of two"""
    map_unit = "relative width"
    map_low = 0.0
    map_is_table = True
    dnl = Strength(
        0.3,
        unit="DN",
        high=2.0,
        trials=(0.2, 0.5),
        source="standard deviation of a code's width; of the largest steps for `bits`; datasheets: 0.3 to 1",
    )
    pattern = choice(
        ("thresholds", "stage", "bits"),
        "thresholds: flash, slope; stage: pipelined, subranging; bits: successive approximation",
    )
    period = Parameter(
        4.0,
        unit="codes",
        low=2.0,
        high=256,
        integer=True,
        trials=(4, 8, 16),
        source="codes that the last stage resolves; 2 to 4 bits in pipelined converters",
        of=("stage",),
    )

    def apply(self, signal, p, stream, context):
        off = self._errors(p, stream.fixed, context).to(signal)  # (B or 1, C or 1, codes + 1), the last one 0
        batch, channels = signal.shape[:2]
        off = off.expand(batch, channels, -1)
        ideal = torch.arange(off.shape[-1], device=signal.device, dtype=signal.dtype) - 0.5
        value = signal.flatten(2)
        in_order = context.maps.get(CodeWidths.name) is None and p.pattern != "bits"
        code = code_of(value.detach(), ideal + off.detach(), in_order)
        low, high = off.gather(2, code), off.gather(2, code + 1)
        width = (1 + high - low).clamp_min(NARROWEST)
        within = torch.minimum((value - ideal[code] - low).clamp_min(0), width)
        return (value + (within / width - within - low)).view_as(signal)

    @staticmethod
    def _errors(p, fixed, context):
        """Of every threshold from that below code 0 to that above the highest, in widths of a code."""
        codes = context.max_dn + 1
        if (measured := context.maps.get(CodeWidths.name)) is not None:
            table = measured.flatten().double()
            widths = table.repeat(math.ceil(codes / len(table)))[:codes]
            edges = widths.cumsum(0) * (codes / widths.sum())
            off = edges - torch.arange(1, codes + 1, device=edges.device)
            return torch.nn.functional.pad(off[:-1], (1, 1)).view(1, 1, -1)
        if p.pattern != "bits":
            drawn = fixed.over(range(1), range(codes + 1)).normal("column").squeeze(2)
            inner = torch.arange(codes + 1, device=drawn.device)
            if p.pattern == "stage":
                own = inner % p.period.round().squeeze(-1)  # (B or 1, 1, codes + 1)
                drawn = torch.take_along_dim(drawn, own.long(), -1)
            off = (p.dnl.squeeze(-1) / math.sqrt(2) * drawn).clamp(-NEAREST, NEAREST)
            return off * ((inner > 0) & (inner < codes))
        return _of_bits(p.dnl.squeeze(-1), fixed, context.bit_depth)


def code_of(value, edges, in_order):
    """The code of each value (B, C, n): how many of the thresholds above code 0 it reaches.

    Args:
        edges: (B, C, codes + 1) thresholds.
        in_order: whether each is within `NEAREST` of its ideal place, so that one comparison is enough.
    """
    top = edges.shape[-1] - 2
    if not in_order:
        return torch.searchsorted(edges[..., 1:].contiguous(), value.contiguous(), right=True).clamp_max(top)
    below = value.nan_to_num().clamp(0, top).long()
    return (below + (value >= edges.gather(2, below + 1))).clamp_max(top)


def _of_bits(dnl, fixed, bits):
    drawn = fixed.over(range(1), range(bits)).normal("column").squeeze(2)
    place = torch.arange(bits, device=drawn.device)
    code = torch.arange(2**bits, device=drawn.device)
    has = ((code[None] >> place[:, None]) & 1).to(drawn.dtype)
    off = dnl * drawn * 2.0 ** ((place - bits) / 2)  # at the middle code all bits change: variance dnl^2
    off = off @ has.to(off.dtype)
    off = off - off[..., -1:] * (code / code[-1])
    ordered = (code + off).cummax(-1).values - code  # a threshold below an earlier one is never met
    return torch.nn.functional.pad(ordered, (0, 1))
