"""Two taps."""

from visaug.effects.effect import Noiseless, Parameter, Stage, Strength, choice
from visaug.effects.readout.steps import edges


class TapMismatch(Noiseless):
    """Fast sensors are read by two output amplifiers, one for each half, which never match exactly.

    Half of the difference is applied to each side. A pixel that contains the seam gets a weighted mean of both sides, which
    gives `seam` a derivative.
    """

    name = "tap_mismatch"
    stage = Stage.READOUT
    order = 20
    aliases = ("channel mismatch", "seam", "quadrant step", "amplifier step")
    summary = """Two halves of the sensor are read with different gain and offset, which gives a step at the seam."""
    equation = "V <- V (1 + s gain / 2) + s offset / 2, s = -1 before the seam and +1 behind it"
    source = "J. Janesick, Scientific Charge-Coupled Devices (SPIE 2001), multiple output amplifiers"
    separates = """average many dark frames and many flats: a step at the seam, constant in the dark (offset)
    and growing with the light (gain); vignetting has no step"""
    offset_e = Strength(
        2.0, "e-", -1e4, 1e4, "about the read noise; second minus first half", trials=(0.5, 2.0)
    )
    gain = Strength(
        0.0, "fraction", -0.5, 0.5, "matched to about 1 %; second minus first half", trials=(0.005, 0.02)
    )
    seam = Parameter(0.5, "share of the sensor", 0.0, 1.0, "0.5 is the middle", trials=(0.5,))
    direction = choice(("columns", "rows"), "columns: left and right halves")

    def apply(self, signal, p, stream, context):
        place, extent = context.places(p.direction, signal)
        side = (place + 1 - p.seam * extent).clamp(0, 1) - 0.5
        return signal * (1 + side * p.gain) + side * p.offset_e

    @classmethod
    def looks(cls, seen):
        """The highest step between the columns, or the rows, of the mean dark frame."""
        found = []
        for direction, profile, place in seen.profiles:
            (seam,), levels = edges(profile, 1)
            offset = float(levels[1] - levels[0])
            found.append({"offset_e": offset, "seam": float(place[seam]), "direction": direction})
        return found
