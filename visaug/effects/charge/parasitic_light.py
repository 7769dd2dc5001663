"""Parasitic light sensitivity."""

from visaug.effects.effect import Noiseless, Parameter, Stage, Strength, choice


class ParasiticLight(Noiseless):
    """A global shutter stores the charge of all pixels at once and reads the rows one after another.

    The storage node is not perfectly dark: while a row waits it collects `share` of the light of its pixel. The first row
    hardly waits; the last one waits for the whole readout. The light is assumed to be constant; a light that is off during
    readout leaves nothing.
    """

    name = "parasitic_light"
    stage = Stage.GENERATION
    order = 12  # light alone: after PRNU, before the dark current
    aliases = ("PLS", "shutter efficiency", "global shutter leakage", "smear")
    summary = "The storage nodes of a global shutter collect light while the rows wait for readout."
    equation = "mu_e <- mu_e (1 + share wait / t), wait = readout row / rows, from the first row that is read"
    source = """S. Lauxtermann et al., Comparison of global shutter pixels for CMOS image sensors, IISW 2007
    (extinction ratio); the ramp is derived: a row waits in proportion to its number"""
    separates = """take flats of equal mean at short and long exposures: a ramp over the rows that is inversely
    proportional to the exposure; vignetting does not depend on it, and amplifier_glow is also in the dark"""
    share = Strength(
        2e-4,
        unit="fraction",
        high=0.5,
        trials=(0.01, 0.05),
        source="parasitic light sensitivity; 1/5000 with shielding, 1e-2 without",
    )
    readout_s = Parameter(0.01, "s", 0.0, 100.0, "of a whole frame: 1 / frame rate")
    first = choice(("top", "bottom"), "row that is read first")

    def apply(self, signal, p, stream, context):
        waits = context.rows(signal) / context.resolution[0]
        if p.first == "bottom":
            waits = (context.resolution[0] - 1) / context.resolution[0] - waits
        return signal * (1 + p.share * p.readout_s * waits / context.exposure_s.clamp_min(1e-9))
