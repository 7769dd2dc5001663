"""Nonlinear response."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage


class Nonlinearity(Effect):
    """Capacitance of the sense node and gain of its amplifier change with the voltage: the response bends.

    The curve starts at 0 with slope 1 and follows its tangent beyond full scale. Within the bounds its slope
    is never below 0.25, so the response is monotone. A full well of infinity falls back on the converter's
    range.
    """

    name = "nonlinearity"
    stage = Stage.READOUT
    order = 0
    summary = "The response bends with the signal."
    equation = "V <- V + S (quadratic x^2 + cubic x^3), x = V / S in [0, 1], S the full scale; linear outside"
    source = (
        "EMVA 1288 release 4 Linear, linearity error; J. Janesick, Photon Transfer (SPIE 2007), nonlinearity"
    )
    separates = (
        "a sweep of exposures at steady light: the mean bends while dark frames stay; blooming and a "
        "full well act near saturation alone"
    )
    quadratic = Parameter(
        -0.02,
        unit="fraction",
        low=-0.15,
        high=0.15,
        strength=True,
        trials=(-0.01, -0.04),
        source="departure at full scale; EMVA 1288 datasheets state 0.2 to 3 %",
    )
    cubic = Parameter(
        0.0,
        unit="fraction",
        low=-0.15,
        high=0.15,
        strength=True,
        trials=(-0.01, -0.04),
        source="departure at full scale; the next term of the same curve",
    )
    full_scale = Parameter(
        "full_well", options=("full_well", "converter"), source="which of the two bends the response"
    )

    def apply(self, signal, p, stream, context):
        return self._curve(signal, p, context)

    def moments(self, mean, p, context):
        return self._curve(mean, p, context), torch.zeros_like(mean)

    @staticmethod
    def _curve(signal, p, context):
        converter = (context.max_dn - context.black_level_dn) * context.gain_e_per_dn
        well = context.full_well_e
        use_well = torch.isfinite(well) & (p.full_scale == "full_well")
        scale = torch.where(use_well, well, converter)
        x = (signal / scale).clamp(0, 1)
        beyond = (signal / scale - 1).clamp_min(0) * (2 * p.quadratic + 3 * p.cubic)
        return signal + scale * (p.quadratic * x**2 + p.cubic * x**3 + beyond)
