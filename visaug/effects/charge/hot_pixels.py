"""Hot pixels."""

import torch

from visaug.effects.charge.dark_electrons import add_dark_electrons
from visaug.effects.effect import Effect, Parameter, Stage

REFERENCE_C = 20.0


class HotPixels(Effect):
    """Excess dark current of a few pixels, drawn once per camera; exponentially distributed for tail = 1.

    One uniform random number u decides whether a pixel is hot (u < density) and how hot: the rate goes to 0 as u approaches
    the density, so the map is a continuous function of the density and has a gradient.
    """

    name = "hot_pixels"
    stage = Stage.GENERATION
    order = 30
    summary = "A few pixels have a much larger dark current, with their own temperature coefficient."
    equation = (
        "mu_e <- mu_e + t rate exp(b (T - 20 C)) (ln density/u)^tail / Gamma(1 + tail) where u < density"
    )
    source = "R. Widenhorn et al., Proc. SPIE 4669 (2002) 193; EMVA 1288 release 4 Linear, defect pixels"
    separates = (
        "take darks at two exposures: hot pixels grow with the exposure; in a long series, rts_noise pixels"
        " jump between levels"
    )
    density = Parameter(
        1e-3,
        unit="fraction",
        high=0.2,
        strength=True,
        trials=(5e-4, 4e-3),
        source="1e-5 when new to 1e-2 after irradiation",
    )
    rate_e_per_s = Parameter(
        500.0, unit="e-/s", high=1e7, trials=(80.0, 600.0), source="mean of the hot pixels, at 20 C"
    )
    b_per_c = Parameter(
        0.06, unit="1/C", high=0.3, trials=(0.06, 0.12), source="below 0.0866 of silicon: field-assisted"
    )
    tail = Parameter(
        1.0,
        low=0.1,
        high=4.0,
        trials=(1.0, 2.0),
        source="near 0: all equal; 1: exponential; higher: heavier tails",
    )

    def apply(self, signal, p, stream, context):
        heat = torch.log(p.density.clamp_min(1e-12)) - torch.log(stream.fixed.uniform())
        heat = torch.where(heat > 0, heat.clamp_min(1e-6) ** p.tail, 0.0)
        hot = self._mean_e(p, context) * heat / torch.exp(torch.lgamma(1 + p.tail))
        return add_dark_electrons(signal, hot, stream, context)

    @staticmethod
    def _mean_e(p, context):
        heating = torch.exp(p.b_per_c * (context.temperature_c - REFERENCE_C))
        return context.exposure_s * p.rate_e_per_s * heating

    def moments(self, mean, p, context):
        hot = self._mean_e(p, context)
        second = torch.exp(torch.lgamma(1 + 2 * p.tail) - 2 * torch.lgamma(1 + p.tail))
        return mean + p.density * hot, hot**2 * (p.density * second - p.density**2)
