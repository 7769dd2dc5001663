"""Shot noise."""

import torch

from visaug.effects.effect import Effect, Stage


class PhotonShotNoise(Effect):
    """Converts the mean to a count. All means added before it share one Poisson draw.

    In the paper's reading it acts on photons, before the quantum efficiency, and dark current has a separate draw.
    """

    name = "photon_shot_noise"
    stage = Stage.GENERATION
    order = 100
    stepwise = True
    base = True
    aliases = ("Poisson noise", "photon noise")
    summary = "The number of electrons in a pixel is Poisson distributed."
    equation = "N_e ~ Poisson(mu_e)"
    source = "EMVA 1288 release 4 Linear, eq. 5; the paper, eqs. 2 and 8"

    def apply(self, signal, p, stream, context):
        return torch.where(signal.isnan(), signal, stream.poisson(signal))  # no number has no count

    def moments(self, mean, p, context):
        return mean, mean
