"""Row noise."""

from visaug.effects.effect import AdditiveNoise, Stage, Strength


class RowNoise(AdditiveNoise):
    """The reset and reference voltages of a row are common to its pixels and fluctuate from frame to frame."""

    name = "row_noise"
    stage = Stage.READOUT
    order = 40
    aliases = ("horizontal stripes", "horizontal noise", "line noise", "temporal row noise", "banding")
    summary = "An independent random offset for each row and frame."
    equation = "V <- V + r_row, r ~ N(0, sigma^2), new in every frame"
    source = "EMVA 1288 release 4 Linear, temporal row noise; K. Wei et al., IEEE TPAMI 44 (2022) 8520, eq. 7"
    separates = """subtract two frames: fixed patterns cancel, row noise remains; its spectrum over the rows
    is white, periodic_banding has a line, flicker_noise rises towards low frequencies"""
    sigma_e = Strength(1.0, "e-", 0.0, 1e4, "0.1 to 1 times the read noise", trials=(0.5, 1.5))

    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e * stream.normal("row")
