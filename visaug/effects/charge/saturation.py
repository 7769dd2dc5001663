"""Full well."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage


class Saturation(Effect):
    """Clips the charge at the full well. The gradient is that of the clip: zero in a saturated pixel."""

    name = "saturation"
    stage = Stage.CHARGE
    order = 80
    base = True
    aliases = ("full well", "clipping", "saturation capacity")
    summary = "A pixel holds no more electrons than its full well."
    equation = "N_e <- min(N_e, full well)"
    source = "EMVA 1288 release 4 Linear, saturation capacity"
    separates = """take flats beyond saturation: read noise remains if the charge is clipped, none if the
    converter clips"""
    full_well_e = Parameter(float("inf"), unit="e-", low=1.0, source="EMVA 1288: saturation capacity")

    def conditions(self, p, context):
        return {"full_well_e": p.full_well_e}

    def apply(self, signal, p, stream, context):
        return torch.minimum(signal, p.full_well_e)
