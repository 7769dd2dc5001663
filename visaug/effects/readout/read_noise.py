"""Read noise."""

from visaug.effects.effect import Effect, Parameter, Stage
from visaug.sampling.distributions import tukey_standard_deviation


class ReadNoise(Effect):
    """Tukey-lambda noise of mean 0. `sigma_e` is its standard deviation; `meaning: scale` takes it as the scale instead,

    as a fit that does not normalise the quantile function gives it (at shape -0.23 the standard deviation is then 2.96 times it).
    """

    name = "read_noise"
    stage = Stage.READOUT
    order = 60
    base = True
    summary = "Reading a pixel adds noise, whatever the signal; its tails may be heavier than Gaussian."
    equation = "V <- V + sigma TL(shape), TL normalised to standard deviation 1"
    source = "the paper, eq. 4; K. Wei et al., IEEE TPAMI 44 (2022) 8520"
    separates = (
        "bias frames: this is what their pixels scatter by, each on its own; shot noise comes with light or exposure, "
        "row_noise and column_noise are common to a line; histograms of the residuals tell the shape"
    )
    sigma_e = Parameter(
        0.0, unit="e-", high=1e4, strength=True, source="EMVA 1288: temporal dark noise", trials=(1.0, 3.0)
    )
    shape = Parameter(
        0.14, unit="1", low=-0.45, high=1.0, source="0.14 is nearly Gaussian; the paper's camera has -0.23"
    )
    meaning = Parameter(
        "standard_deviation", options=("standard_deviation", "scale"), source="the paper fits the scale"
    )

    def apply(self, signal, p, stream, context):
        sigma = p.sigma_e
        if p.meaning == "scale":
            sigma = sigma * tukey_standard_deviation(p.shape).float()
        return signal + sigma * stream.tukey_lambda(p.shape)

    def moments(self, mean, p, context):
        sigma = p.sigma_e * (tukey_standard_deviation(p.shape).float() if p.meaning == "scale" else 1)
        return mean, sigma**2
