"""Odd and even rows."""

from visaug.effects.effect import Noiseless, Parameter, Stage


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
    source = (
        "J. Nakamura (ed.), Image Sensors and Signal Processing for Digital Still Cameras (CRC 2006), "
        "fixed-pattern noise"
    )
    separates = (
        "average many frames and subtract even from odd rows: constant in the dark (offset), growing with "
        "the light (gain); tap_mismatch has a single step instead"
    )
    offset_e = Parameter(
        1.0,
        unit="e-",
        low=-1e4,
        high=1e4,
        strength=True,
        trials=(0.3, 1.0),
        source="a fraction of the read noise; odd minus even",
    )
    gain = Parameter(
        0.0,
        unit="fraction",
        low=-0.5,
        high=0.5,
        strength=True,
        trials=(0.003, 0.01),
        source="like a PRNU of rows; odd minus even",
    )

    def apply(self, signal, p, stream, context):
        side = (context.rows(signal) % 2).to(signal.dtype) - 0.5
        return signal * (1 + side * p.gain) + side * p.offset_e
