"""System gain."""

from visaug.effects.effect import Effect, Parameter, Stage
from visaug.effects.straight_through import round_through


class SystemGain(Effect):
    """Converts electrons to DN. In the paper's reading the electrons are rounded first (eq. 12).

    Called alone, it converts at the gain `gain_db` for which `gain_e_per_dn` is given.
    """

    name = "system_gain"
    stage = Stage.DIGITAL
    order = 0
    base = True
    aliases = ("conversion gain", "K")
    summary = "The converter has a gain and a black level."
    equation = "y = V / G(dB) + black level, G(dB) = G 10^((dB_0 - dB) / 20)"
    source = "EMVA 1288 release 4 Linear, eq. 7 (K = 1/G); the paper, eq. 12"
    separates = """measure the photon transfer curve (variance against mean of flats at several levels): its
    slope gives the gain, independent of the light source"""
    gain_e_per_dn = Parameter(1.0, "e-/DN", 1e-6, 1e6, "EMVA 1288: inverse of the system gain K")
    gain_db = Parameter(0.0, "dB", -60.0, 120.0, "20 dB is a factor of ten")
    black_level_dn = Parameter(0.0, "DN", 0.0, 65535.0, "offset of the converter, equal at every gain")

    def conditions(self, p, context):
        return {"gain_e_per_dn": p.gain_e_per_dn, "black_level_dn": p.black_level_dn}

    def apply(self, signal, p, stream, context):
        if context.reading == "paper":
            signal = round_through(signal)
        return signal / context.gain_e_per_dn + context.black_level_dn
