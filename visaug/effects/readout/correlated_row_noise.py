"""Row noise with a memory."""

from visaug.effects.effect import AdditiveNoise, Parameter, Stage, Strength, choice
from visaug.effects.readout.coloured import coloured


class CorrelatedRowNoise(AdditiveNoise):
    """The references and supplies that the pixels of a row share have 1/f noise, so neighbouring rows have similar offsets.

    The record is twice as long as the frame, so the end of a frame is not correlated with its beginning. Periods longer than
    a frame shift the whole frame. For `columns` the noise runs along the columns of a sensor with one converter for each.
    """

    name = "correlated_row_noise"
    proposed = False  # where it was tried it took the place of other effects
    stage = Stage.READOUT
    order = 42
    aliases = ("horizontal stripes", "banding", "pink noise", "1/f noise", "supply noise", "EMI")
    summary = (
        """A random offset for each row and frame whose power rises towards low frequencies over the rows."""
    )
    equation = "V <- V + r_row, power spectrum over the rows ~ 1 / frequency^exponent, variance sigma^2, new in every frame"
    source = """EMVA 1288 release 4 Linear, temporal row noise and spectrograms; power law generated as in J.
    Timmer and M. Koenig, A&A 300 (1995) 707"""
    separates = """compute the spectrum of the row means of single dark frames: row_noise is white,
    periodic_banding has a line, flicker_noise also varies within a row"""
    sigma_e = Strength(1.0, "e-", 0.0, 1e4, "0.1 to 1 times the read noise", trials=(0.5, 1.5))
    exponent = Parameter(1.0, "1", 0.0, 2.5, "1: flicker; 2: a random walk", trials=(0.6, 1.6))
    direction = choice(("rows", "columns"), "rows: one offset for each row")

    def apply(self, signal, p, stream, context):
        axis = 0 if p.direction == "rows" else 1
        own = stream.over(range(1), range(2 * context.resolution[axis])).normal("column")
        lines = context.window[axis]
        noise = coloured(own.flatten(2), p.exponent)[..., lines.start : lines.stop]
        return signal + p.sigma_e * noise.unsqueeze(-1 if axis == 0 else -2)
