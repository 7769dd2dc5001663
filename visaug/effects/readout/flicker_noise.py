"""1/f noise."""

from visaug.effects.effect import AdditiveNoise, Parameter, Stage, Strength, choice
from visaug.effects.readout.coloured import STEEPEST, coloured, part_of_coloured


class FlickerNoise(AdditiveNoise):
    """Low-frequency noise of an output amplifier, in the order in which it reads the pixels: stripes along rows.

    Each frequency along the readout of the whole sensor gets a random amplitude and phase. The simulated record is twice as
    long as a frame, so that the end of a frame is not correlated with its beginning, and as long as one frame if a clamp
    removes the mean of each frame. A crop of the sensor gets its part of the readout. A window of the frames of a sequence that
    has at most half of the rows gets noise of the same law, whose numbers are not those of the whole frame: these would cost
    as much as the whole frame.
    """

    name = "flicker_noise"
    stage = Stage.READOUT
    order = 48
    aliases = ("1/f noise", "pink noise", "streaking")
    summary = "Noise along the readout whose power rises towards low frequencies."
    equation = """V <- V + f_k, k the pixel's place in the readout; power spectrum ~ 1 / frequency^exponent,
    variance sigma^2"""
    source = """J. Janesick, Photon Transfer (SPIE 2007), read noise: flicker noise; shaping as in Timmer and
    Koenig, A&A 300 (1995) 707"""
    separates = """compute the spectrum of single dark frames along the readout: flicker noise rises towards
    low frequencies; row_noise is white over the rows and constant within a row"""
    sigma_e = Strength(1.0, "e-", 0.0, 1e4, "0.1 to 1 times the read noise", trials=(0.5, 1.5))
    exponent = Parameter(
        1.0, "1", 0.0, 2.0, "near 1 for MOS transistors; 2 is a random walk", trials=(0.7, 1.0, 1.4)
    )
    direction = choice(("rows", "columns"), "rows: pixels of a row are read one after another")
    clamp = choice(
        ("none", "frame"),
        "none: periods longer than a frame shift the whole frame; frame: a black clamp removes the mean of each frame",
    )

    def apply(self, signal, p, stream, context):
        rows, columns = context.resolution
        along = (rows, columns) if p.direction == "rows" else (columns, rows)
        lines = along[0] + along[0] % 2 if p.clamp == "frame" else 2 * along[0]  # an even number of pixels
        read = context.window if p.direction == "rows" else context.window[::-1]
        inside = read[0]  # lines of the window, in the order in which they are read
        if context.sequence and 4 * len(inside) <= lines and float(p.exponent.max()) <= STEEPEST:
            white = stream.over(range(2 * len(inside)), range(along[1])).normal()
            noise = part_of_coloured(white.flatten(2), p.exponent, lines * along[1])
            inside = range(len(inside))
        else:
            white = stream.over(range(lines), range(along[1])).normal()
            noise = coloured(white.flatten(2), p.exponent)
        noise = noise.unflatten(-1, (-1, along[1]))[
            ..., inside.start : inside.stop, read[1].start : read[1].stop
        ]
        return signal + p.sigma_e * (noise if p.direction == "rows" else noise.transpose(-1, -2))
