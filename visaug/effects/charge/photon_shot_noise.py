"""Shot noise."""

from visaug.effects.effect import Effect, Stage


class PhotonShotNoise(Effect):
    """From the mean to a count. All means that add up before it share one Poisson draw, as physics has it.

    In the paper's reading it acts on photons, before the quantum efficiency, and dark current has a draw of its own.
    """

    name = "photon_shot_noise"
    stage = Stage.GENERATION
    order = 100
    base = True
    summary = "Electrons come one by one and at random: the count is Poisson distributed."
    equation = "N_e ~ Poisson(mu_e)"
    source = "EMVA 1288 release 4 Linear, eq. 5; the paper, eqs. 2 and 8"

    def apply(self, signal, p, stream, context):
        return stream.poisson(signal)

    def moments(self, mean, p, context):
        return mean, mean
