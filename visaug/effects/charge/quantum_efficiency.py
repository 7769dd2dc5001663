"""Quantum efficiency."""

from visaug.effects.effect import Effect, Parameter, Stage


class QuantumEfficiency(Effect):
    """Detection selects photons at random and acts on the mean before the shot noise: electrons are Poisson of mean QE mu_p."""

    name = "quantum_efficiency"
    stage = Stage.GENERATION
    order = 0
    base = True
    aliases = ("QE", "responsivity")
    summary = "A photon generates an electron with a probability, the total quantum efficiency."
    equation = "mu_e = QE mu_p"
    source = "EMVA 1288 release 4 Linear, eq. 2; the paper, eq. 9"
    value = Parameter(1.0, "e-/photon", 1e-4, 1.0, "EMVA 1288: total quantum efficiency")

    def conditions(self, p, context):
        return {"quantum_efficiency": p.value}

    def apply(self, signal, p, stream, context):
        return signal * p.value
