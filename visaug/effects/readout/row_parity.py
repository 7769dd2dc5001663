"""Odd and even rows."""

from visaug.effects.effect import Noiseless, Stage, Strength


class RowParity(Noiseless):
    """Odd and even rows have different amplifiers, or share transistors, and so have a constant difference.

    Half of the difference is applied to each, so the mean of the frame does not change.
    """

    name = "row_parity"
    stage = Stage.READOUT
    order = 30
    aliases = ("odd-even rows", "fixed pattern noise", "FPN", "horizontal stripes")
    summary = "Odd and even rows have a constant difference in offset and gain."
    equation = "V <- V (1 + s gain / 2) + s offset / 2, s = +1 on rows 1, 3, 5 ..., -1 on rows 0, 2, 4 ..."
    source = """J. Nakamura (ed.), Image Sensors and Signal Processing for Digital Still Cameras (CRC 2006),
    fixed-pattern noise"""
    separates = """average many frames and subtract even from odd rows: constant in the dark (offset), growing
    with the light (gain); tap_mismatch has a single step instead"""
    offset_e = Strength(
        1.0, "e-", -1e4, 1e4, "a fraction of the read noise; odd minus even", trials=(0.3, 1.0)
    )
    gain = Strength(0.0, "fraction", -0.5, 0.5, "like a PRNU of rows; odd minus even", trials=(0.003, 0.01))

    def apply(self, signal, p, stream, context):
        side = (context.rows(signal) % 2).to(signal.dtype) - 0.5
        return signal * (1 + side * p.gain) + side * p.offset_e
