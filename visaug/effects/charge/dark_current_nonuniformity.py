"""Dark-current non-uniformity."""

import torch

from visaug.effects.effect import Effect, Stage, Strength, choice


class DarkCurrentNonuniformity(Effect):
    """The dark current of each pixel is that of the camera times a factor of mean 1, drawn once per camera.

    Without dark current in the camera there is no effect. Measured factors (`map`, a file: a map of the dark current divided
    by its mean) replace the drawn ones.
    """

    name = "dark_current_nonuniformity"
    stage = Stage.GENERATION
    order = 25
    aliases = ("DCNU", "fixed pattern noise", "FPN", "dark fixed pattern")
    summary = "Dark current differs from pixel to pixel; the pattern grows with exposure and temperature."
    equation = "mu_e <- mu_e + D(T) t (K - 1), K lognormal of mean 1 and standard deviation spread"
    source = """R. D. Gow et al., IEEE Trans. Electron Devices 54 (2007) 1321; EMVA 1288 release 4 Linear, section 7"""
    separates = "take darks at two exposures: this pattern grows with the exposure, dsnu does not"
    map_unit = "factor K"
    map_low = 0.0
    spread = Strength(
        0.3, "fraction", 0.0, 10.0, "standard deviation relative to the mean: 0.1 to 1", trials=(0.4, 1.2)
    )
    distribution = choice(("lognormal", "gaussian", "exponential"), "of the factors")

    def apply(self, signal, p, stream, context):
        if (measured := context.measured_map(self.name, signal)) is not None:
            excess = measured - 1
        elif p.distribution == "lognormal":
            s = self._log_sigma(p.spread)
            excess = torch.expm1(s * stream.fixed.normal() - s**2 / 2)
        elif p.distribution == "gaussian":
            excess = p.spread * stream.fixed.normal()
        else:
            excess = p.spread * (-torch.log(stream.fixed.uniform()) - 1)
        return signal + context.dark_current_e * excess.clamp_min(-1)

    @staticmethod
    def _log_sigma(spread):
        """sqrt(ln(1 + spread^2)), written so that it has a gradient at 0."""
        square = (spread**2).clamp_min(1e-12)
        return spread * torch.sqrt(torch.log1p(square) / square)

    def moments(self, mean, p, context):
        if (measured := context.measured_map(self.name, mean)) is not None:
            return mean + context.dark_current_e * (measured - 1), 0 * mean
        if p.distribution != "lognormal":
            return None  # wide spreads are cut where dark current would be negative
        return mean, (context.dark_current_e * p.spread) ** 2
