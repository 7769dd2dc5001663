"""Veiling glare."""

from visaug.effects.effect import Parameter, Spreading, Stage, Strength
from visaug.effects.optics.spread import PROFILES, halo, once_for_equals


class VeilingGlare(Spreading):
    """The scattered light is taken from the scene.

    Beyond the frame the light is that of its mirror image times `surround`: 1 where the scene goes on alike, so that at the edge
    as much light enters as leaves; 0 in front of a black sky, where what is scattered beyond the edge is lost.
    """

    name = "veiling_glare"
    stage = Stage.OPTICS
    order = 30
    aliases = ("stray light", "haze", "flare", "glare")
    summary = "A fraction of all light is scattered into a wide halo."
    equation = "mu_p <- (1 - share) mu_p + share (mu_p * k), k of unit volume and given width"
    source = "ISO 9358:1994, veiling glare index; E. Talvala et al., ACM TOG 26 (2007) 37"
    separates = "image a bright source on black: veiling glare reaches far, crosstalk and point spread do not"
    share = Strength(0.05, "fraction", 0.0, 0.9, "veiling glare index: 1 to 10 %", trials=(0.03, 0.12))
    width_px = Parameter(
        40.0, "px", 5.0, 1e5, "from tens of pixels to the whole field", trials=(15.0, 50.0, 200.0, 800.0)
    )
    profile = Parameter(
        "exponential", options=PROFILES, source="width_px is its sigma, decay length or core radius"
    )
    surround = Parameter(
        1.0,
        "1",
        0.0,
        100.0,
        "light beyond the frame over that of the scene's mirror image; 0: black",
        unknown=1.0,
    )

    @once_for_equals
    def apply(self, signal, p, stream, context):
        return signal + p.share * (halo(signal, p.width_px, p.profile, p.surround) - signal)

    def moments(self, mean, p, context):
        return super().moments(mean, p, context) if bool((p.surround == 1).all()) else None
