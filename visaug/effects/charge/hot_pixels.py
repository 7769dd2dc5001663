"""Hot pixels."""

import torch

from visaug.effects.charge.dark_electrons import REFERENCE_C, add_dark_electrons
from visaug.effects.effect import Effect, Parameter, Stage, Strength


class HotPixels(Effect):
    """Excess dark current of a few pixels, drawn once per camera; exponentially distributed for tail = 1.

    One uniform random number u decides whether a pixel is hot (u < density) and how hot: the rate goes to 0 as u approaches
    the density, so the map is a continuous function of the density and has a gradient.

    Hotter pixels have a lower activation energy (the Meyer-Neldel rule): with `softer_per_c` s the coefficient of a pixel is
    b - s ln h, h its rate at 20 C relative to the mean.
    """

    name = "hot_pixels"
    stage = Stage.GENERATION
    order = 30
    aliases = ("warm pixels", "hot spots", "defect pixels", "white spots")
    summary = "A few pixels have a much larger dark current, with their own temperature coefficient."
    equation = "mu_e <- mu_e + t rate h exp((b - s ln h) (T - 20 C)), h = (ln density/u)^tail / Gamma(1 + tail), where u < density"
    source = """R. Widenhorn et al., Proc. SPIE 4669 (2002) 193 and J. Appl. Phys. 89 (2001) 8179; EMVA 1288
    release 4 Linear, defect pixels"""
    separates = """take darks at two exposures: hot pixels grow with the exposure; in a long series, rts_noise
    pixels jump between levels"""
    density = Strength(
        1e-3, "fraction", 0.0, 0.2, "1e-5 when new to 1e-2 after irradiation", trials=(5e-4, 4e-3)
    )
    rate_e_per_s = Parameter(500.0, "e-/s", 0.0, 1e7, "mean of the hot pixels, at 20 C", trials=(80.0, 600.0))
    b_per_c = Parameter(0.06, "1/C", 0.0, 0.3, "below 0.0866 of silicon: field-assisted", trials=(0.06, 0.12))
    tail = Parameter(
        1.0, "1", 0.1, 4.0, "near 0: all equal; 1: exponential; higher: heavier tails", trials=(1.0, 2.0)
    )
    softer_per_c = Parameter(
        0.0,
        unit="1/C",
        high=0.1,
        source="decrease of b for each factor e of the rate; 0.016: from 1.1 eV to 0.55 eV over two decades of the rate",
    )

    def apply(self, signal, p, stream, context):
        heat = torch.log(p.density.clamp_min(1e-12)) - torch.log(stream.fixed.uniform())
        power = self._power(p, context)
        heat = torch.where(heat > 0, heat.clamp_min(1e-6) ** (p.tail * power), 0.0)
        hot = self._mean_e(p, context) * heat / torch.exp(torch.lgamma(1 + p.tail) * power)
        return add_dark_electrons(signal, hot, stream, context)

    @staticmethod
    def _mean_e(p, context):
        heating = torch.exp(p.b_per_c * (context.temperature_c - REFERENCE_C))
        return context.exposure_s * p.rate_e_per_s * heating

    @staticmethod
    def _power(p, context):
        """Of a rate relative to the mean at 20 C: b_per_c - softer_per_c ln(rate) instead of b_per_c."""
        return (1 - p.softer_per_c * (context.temperature_c - REFERENCE_C)).clamp_min(0)

    def moments(self, mean, p, context):
        hot, power = self._mean_e(p, context), self._power(p, context)
        first, second = (
            torch.exp(torch.lgamma(1 + n * power * p.tail) - n * power * torch.lgamma(1 + p.tail))
            for n in (1, 2)
        )
        return mean + p.density * hot * first, hot**2 * (p.density * second - (p.density * first) ** 2)
