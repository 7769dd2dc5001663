"""Interpixel crosstalk."""

import torch.nn.functional as F

from visaug.effects.effect import Parameter, Spreading, Stage, Strength


class InterpixelCrosstalk(Spreading):
    """Neighbouring nodes are coupled by their capacitance: each contains a fraction of the other's signal and noise.

    Along rows and columns the second neighbour may be coupled too, by `tail`. The total is conserved. With four equal
    neighbours and no further coupling, white noise of variance v gets, to first order in the share a, the variance
    v (1 - 8 a) and the covariance 2 a v between neighbours, at every level.
    """

    name = "interpixel_crosstalk"
    stage = Stage.CHARGE
    order = 90  # at the nodes that are read: after everything that happens to the charge itself
    aliases = ("IPC", "interpixel capacitance", "crosstalk")
    summary = "Neighbouring pixels share signal linearly after the shot noise, so their noise is correlated."
    equation = """N_i <- N_i + share sum over the 8 neighbours j of g_j (N_j - N_i), g: 1, aspect or diagonal,
    and tail times the same over the four after next, g: 1 or aspect"""
    source = "A. C. Moore, Z. Ninkov and W. J. Forrest, Optical Engineering 45 (2006) 076402"
    separates = """measure the covariance of noise in flats: point_spread has none, and the fraction of
    brighter_fatter grows with the level"""
    share = Strength(0.01, "fraction", 0.0, 0.1, "each neighbour: 0.5 to 3 %", trials=(0.006, 0.025))
    aspect = Parameter(
        1.0,
        high=1.5,
        trials=(0.7, 1.4),
        source="coupling to the neighbours above and below, relative to those beside",
    )
    diagonal = Parameter(
        0.0, "1", 0.0, 1.0, "coupling to the diagonal neighbours, relative to those beside", trials=(0.0, 0.3)
    )
    tail = Parameter(
        0.0,
        unit="fraction",
        high=0.5,
        trials=(0.2,),
        source="coupling to the second neighbour, relative to the first; in a network of equal nodes about `share`",
    )

    def apply(self, signal, p, stream, context):
        padded = F.pad(signal, (2, 2, 2, 2), mode="replicate")  # no charge crosses the edge

        def at(down: int, across: int):
            return padded.narrow(-2, 2 + down, signal.shape[-2]).narrow(-1, 2 + across, signal.shape[-1])

        corners = at(-1, -1) + at(-1, 1) + at(1, -1) + at(1, 1)
        shared = p.diagonal * (corners - 4 * signal)
        for apart, part in ((1, 1.0), (2, p.tail)):
            beside, above = at(0, -apart) + at(0, apart), at(-apart, 0) + at(apart, 0)
            shared = shared + part * (beside - 2 * signal + p.aspect * (above - 2 * signal))
        return signal + p.share * shared
