"""Full well."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage


class Saturation(Effect):
    """Clips the charge; the gradient is that of the clip, zero where the well is full."""

    name = "saturation"
    stage = Stage.CHARGE
    order = 80
    base = True
    summary = "A pixel holds no more electrons than its full well."
    equation = "N_e <- min(N_e, full well)"
    source = "EMVA 1288 release 4 Linear, saturation capacity"
    separates = (
        "flats beyond saturation: read noise is left where the charge clips, none where the converter does"
    )
    full_well_e = Parameter(float("inf"), unit="e-", low=1.0, source="EMVA 1288: saturation capacity")

    def apply(self, signal, p, stream, context):
        return torch.minimum(signal, p.full_well_e)
