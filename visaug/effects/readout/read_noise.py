"""Read noise."""

from visaug.core.sampling.tukey_lambda import standard_deviation_tensor
from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice, is_surely

# A random number of 32 bits ends at a tail of p = 2^-33. Beyond it lies a share of the variance that grows as the shape falls,
# 2 p^(2L + 1) / (L^2 (2L + 1) var): 0.3 % here, so that the standard deviation is 0.2 % short at most; 2 % at -0.4.
LEAST_SHAPE = -0.35


class ReadNoise(Effect):
    """Tukey-lambda noise of mean 0 before the gain stage, and Gaussian noise after it.

    `sigma_e` is the standard deviation of the first. With `meaning: scale` it is the scale instead, as given by a fit that
    does not normalise the quantile function (at shape -0.23 the standard deviation is 2.96 times the scale). `after_gain_dn`
    is the standard deviation of the second in DN: converter and line noise that is not amplified, so in electrons it
    decreases as the gain increases. A measured standard deviation of every pixel (`read_noise.map`, a file, in e-) replaces
    `sigma_e` and `meaning`; the shape still applies.
    """

    name = "read_noise"
    stage = Stage.READOUT
    order = 60
    base = True
    aliases = ("temporal dark noise", "readout noise", "kTC noise")
    summary = "Reading a pixel adds signal-independent noise; its tails may be heavier than Gaussian."
    equation = "V <- V + sigma TL(shape) + G(dB) sigma_after N, TL normalised to standard deviation 1"
    source = "the paper, eq. 4; K. Wei et al., IEEE TPAMI 44 (2022) 8520; after the gain: EMVA 1288 release 4 Linear, eq. 8"
    separates = """take bias frames: read noise is the independent noise of single pixels; shot noise requires light or
    exposure, row_noise and column_noise are common to a line; the histogram of the residuals shows the shape"""
    map_unit = "e-"
    map_low = 0.0
    sigma_e = Strength(0.0, "e-", 0.0, 1e4, "EMVA 1288: temporal dark noise", trials=(1.0, 3.0))
    shape = Parameter(0.14, "1", LEAST_SHAPE, 1.0, "0.14 is nearly Gaussian; the paper's camera has -0.23")
    after_gain_dn = Parameter(0.0, "DN", 0.0, 65535.0, "converter and line noise after the gain stage")
    meaning = choice(("standard_deviation", "scale"), "scale: as fitted in the paper")

    @classmethod
    def strengths(cls):
        return "sigma_e", "after_gain_dn"  # no fit moves the second: frames at one gain cannot part the two

    def apply(self, signal, p, stream, context):
        signal = signal + _sigma(signal, p, context) * stream.tukey_lambda(p.shape)
        after = p.after_gain_dn
        if not is_surely(after, 0.0):
            signal = signal + after * context.gain_e_per_dn * stream.fork("after gain").normal()
        return signal

    def moments(self, mean, p, context):
        return mean, _sigma(mean, p, context) ** 2 + (p.after_gain_dn * context.gain_e_per_dn) ** 2


def _sigma(like, p, context):
    """Standard deviation before the gain stage in electrons: of every pixel where it was measured, else of all."""
    if (measured := context.measured_map(ReadNoise.name, like)) is not None:
        return measured
    return p.sigma_e * standard_deviation_tensor(p.shape).float() if p.meaning == "scale" else p.sigma_e
