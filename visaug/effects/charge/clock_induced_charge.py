"""Clock-induced charge."""

from visaug.effects.charge.dark_electrons import add_dark_electrons
from visaug.effects.effect import Effect, Parameter, Stage


class ClockInducedCharge(Effect):
    """Clocking frees electrons in every frame, however short; the shot noise makes them Poisson."""

    name = "clock_induced_charge"
    stage = Stage.GENERATION
    order = 50
    summary = "Poisson electrons in every frame, whatever the exposure."
    equation = "mu_e <- mu_e + mean"
    source = "J. Janesick, Scientific Charge-Coupled Devices (SPIE, 2001), on spurious charge"
    separates = "bias frames against a covered black level: its variance equals its mean"
    mean_e = Parameter(
        0.5, unit="e-", high=1e4, strength=True, trials=(1.0, 4.0), source="0.002 (EMCCD) to some e- a frame"
    )

    def apply(self, signal, p, stream, context):
        return add_dark_electrons(signal, p.mean_e, stream, context)

    def moments(self, mean, p, context):
        return mean + p.mean_e, p.mean_e if context.reading == "paper" else 0 * mean
