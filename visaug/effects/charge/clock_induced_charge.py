"""Clock-induced charge."""

from visaug.effects.charge.dark_electrons import add_dark_electrons
from visaug.effects.effect import Effect, Parameter, Stage, Strength


class ClockInducedCharge(Effect):
    """Clocking generates electrons in every frame, however short; the shot noise makes them Poisson.

    Charge that is clocked through more rows collects more: `gradient`.
    """

    name = "clock_induced_charge"
    stage = Stage.GENERATION
    order = 50
    aliases = ("CIC", "spurious charge")
    summary = "Clocking adds Poisson electrons to every frame, independent of the exposure time."
    equation = "mu_e <- mu_e + mean (1 + gradient u), u from -1 at row 0 to 1 at the last row"
    source = "J. Janesick, Scientific Charge-Coupled Devices (SPIE, 2001), on spurious charge"
    separates = "compare bias frames with the optical black: the variance of the added signal equals its mean"
    mean_e = Strength(0.5, "e-", 0.0, 1e4, "0.002 (EMCCD) to several e- per frame", trials=(1.0, 4.0))
    gradient = Parameter(
        0.0,
        low=-1.0,
        high=1.0,
        trials=(1.0, -1.0),
        source="0: uniform; 1: proportional to the transfers from row 0; -1: from the last row",
    )

    def apply(self, signal, p, stream, context):
        return add_dark_electrons(signal, self._mean(signal, p, context), stream, context)

    def moments(self, mean, p, context):
        freed = self._mean(mean, p, context)
        return mean + freed, freed if context.reading == "paper" else 0 * mean

    @staticmethod
    def _mean(signal, p, context):
        u = (2 * context.rows(signal) + 1) / context.resolution[0] - 1
        return p.mean_e * (1 + p.gradient * u)
