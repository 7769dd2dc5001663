"""Interpixel crosstalk."""

import torch.nn.functional as F

from visaug.effects.effect import Effect, Parameter, Stage


class InterpixelCrosstalk(Effect):
    """Neighbouring nodes couple by their capacitance: each sees a share of the other's signal and noise.

    Energy is kept. White noise of variance v has afterwards, to first order in the share a, the variance v
    (1 - 8 a) and the covariance 2 a v between neighbours, at every level alike.
    """

    name = "interpixel_crosstalk"
    stage = Stage.CHARGE
    order = 90  # at the nodes that are read: after everything that happens to the charge itself
    summary = "Neighbours share signal linearly, after the shot noise: noise is correlated."
    equation = "N_i <- N_i + share sum over the 8 neighbours j of g_j (N_j - N_i), g: 1, aspect or diagonal"
    source = "A. C. Moore, Z. Ninkov and W. J. Forrest, Optical Engineering 45 (2006) 076402"
    separates = (
        "covariance of noise in flats: point_spread has none, brighter_fatter's share grows with level"
    )
    share = Parameter(
        0.01,
        unit="fraction",
        high=0.1,
        strength=True,
        trials=(0.006, 0.025),
        source="each neighbour: 0.5 to 3 %",
    )
    aspect = Parameter(1.0, high=1.5, trials=(0.7, 1.4), source="coupling above and below, to that beside")
    diagonal = Parameter(0.0, high=1.0, trials=(0.0, 0.3), source="coupling at the corners, to that beside")

    def apply(self, signal, p, stream, context):
        around = F.pad(signal, (1, 1, 1, 1), mode="replicate")  # no charge crosses the edge
        beside = around[..., 1:-1, :-2] + around[..., 1:-1, 2:]
        column = around[..., :-2, :] + around[..., 2:, :]
        corners = column[..., :-2] + column[..., 2:]
        shared = beside - 2 * signal + p.aspect * (column[..., 1:-1] - 2 * signal)
        return signal + p.share * (shared + p.diagonal * (corners - 4 * signal))

    def moments(self, mean, p, context):
        return mean, mean * 0
