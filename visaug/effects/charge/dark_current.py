"""Dark current."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class DarkCurrent(Effect):
    """Thermal electrons, D(T) = a exp(b T) with T in degrees Celsius.

    With `dark_current.law: arrhenius` in the camera file, D(T) = a exp(b T 273.15 / (T + 273.15)): one activation energy
    E = b k (273.15 K)^2, 0.56 eV for the default, and b is the growth at 0 C. A current that doubles every 8 C around 20 C is at
    -40 C 3.8 times smaller by this law than by the exponential one.

    They are added to the photo-electrons before the shot noise: the sum of two Poisson counts is Poisson of the summed mean.
    """

    name = "dark_current"
    stage = Stage.GENERATION
    order = 20
    base = True
    aliases = ("thermal signal", "leakage current")
    summary = "Thermal electrons are generated in every pixel in proportion to the exposure time."
    equation = "mu_e <- mu_e + t a exp(b T)"
    source = "the paper, eqs. 3 and 15; EMVA 1288 release 4 Linear, section 7"
    separates = """take darks at several exposures and temperatures: dark current grows with both;
    clock_induced_charge is present at zero exposure, and a light leak hardly changes with temperature"""
    a_e_per_s = Strength(0.0, "e-/s", 0.0, 1e7, "dark current at 0 C", trials=(0.05, 0.2))
    b_per_c = Parameter(0.0866, "1/C", 0.0, 0.5, "0.0866 doubles it every 8 C, usual for silicon (EMVA 1288)")

    def conditions(self, p, context):
        heating = torch.exp(p.b_per_c * context.temperature_c)
        return {"dark_current_e": context.exposure_s * p.a_e_per_s * heating}

    def apply(self, signal, p, stream, context):
        if context.reading == "paper":  # electrons are counted already: eq. 11 adds a separate Poisson draw
            return signal + stream.poisson(context.dark_current_e.expand(signal.shape))
        return signal + context.dark_current_e
