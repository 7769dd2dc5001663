"""Column noise."""

from visaug.effects.effect import Effect, Parameter, Stage


class ColumnNoise(Effect):
    """Each column has a converter of its own, whose reference is sampled once for a whole frame.

    What stays the same in every frame is DSNU's column part; this part is fresh in every frame.
    """

    name = "column_noise"
    stage = Stage.READOUT
    order = 45
    summary = "One random offset for each column and frame."
    equation = "V <- V + c_column, c ~ N(0, sigma^2), new in every frame"
    source = "EMVA 1288 release 4 Linear, temporal column noise; J. Janesick, Photon Transfer (SPIE 2007)"
    separates = (
        "two frames subtracted: dsnu and prnu cancel, this stays; column means scatter alike in the "
        "dark and in the light"
    )
    sigma_e = Parameter(
        1.0, unit="e-", high=1e4, strength=True, source="0.1 to 1 times the read noise", trials=(0.5, 1.5)
    )

    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e * stream.normal("column")

    def moments(self, mean, p, context):
        return mean, p.sigma_e**2
