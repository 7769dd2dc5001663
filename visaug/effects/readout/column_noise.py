"""Column noise."""

from visaug.effects.effect import AdditiveNoise, Stage, Strength


class ColumnNoise(AdditiveNoise):
    """Each column has a converter whose reference is sampled once per frame.

    The part that is constant over frames is the column part of DSNU; this effect is drawn anew in every frame.
    """

    name = "column_noise"
    stage = Stage.READOUT
    order = 45
    aliases = ("vertical stripes", "temporal column noise", "line noise", "banding")
    summary = "An independent random offset for each column and frame."
    equation = "V <- V + c_column, c ~ N(0, sigma^2), new in every frame"
    source = "EMVA 1288 release 4 Linear, temporal column noise; J. Janesick, Photon Transfer (SPIE 2007)"
    separates = """subtract two frames: dsnu and prnu cancel, column noise remains; the variance of column
    means is the same in the dark and with light"""
    sigma_e = Strength(1.0, "e-", 0.0, 1e4, "0.1 to 1 times the read noise", trials=(0.5, 1.5))

    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e * stream.normal("column")
