"""The brighter-fatter effect."""

import torch
import torch.nn.functional as F

from visaug.effects.effect import Effect, Parameter, Stage, Strength

LIMIT = 0.2  # below 1/4: a pixel cannot give its four neighbours more than it has


class BrighterFatter(Effect):
    """Charge in a pixel shifts the pixel's boundaries, so that arriving charge is collected by its neighbours.

    A pair of neighbours exchanges a fraction of its difference that grows with the mean charge of the pair. Charge is
    conserved. In CCDs the second neighbour takes part too, by `tail`. In a flat of mean mu, with equal coupling to all
    neighbours and no tail, the variance becomes mu [(1 - 4 a mu)^2 + 4 (a mu)^2] and the covariance of neighbours
    2 a mu^2 (1 - 4 a mu), where a is the coupling per electron.
    """

    name = "brighter_fatter"
    stage = Stage.CHARGE
    order = 40
    local = False
    aliases = ("BFE", "charge repulsion", "dynamic charge deflection")
    summary = "Charge in a pixel deflects further charge to its neighbours, increasingly with the signal."
    equation = """N_i <- N_i + sum over neighbours j of a (P_j - P_i), at most 0.2 |N_j - N_i|, and tail times
    the same over those after next; P = N^2 / 2, beyond the full well W: W^2 / 2 + beyond W (N - W)"""
    source = "P. Antilogus et al., JINST 9 (2014) C03048; A. Guyonnet et al., A&A 575 (2015) A41"
    separates = """measure the covariance of neighbours in flats: brighter_fatter grows with the square of the
    level, crosstalk in proportion to it"""
    share_per_ke = Strength(
        3e-4,
        unit="1/(1000 e-)",
        high=0.1,
        trials=(1e-3, 4e-3),
        source="the variance of thick CCDs falls by 20 % at 100 000 e-; more in small pixels",
    )
    aspect = Parameter(1.0, "1", 0.0, 5.0, "vertical to horizontal; in CCDs 2 to 3", trials=(1.0, 2.5))
    tail = Parameter(
        0.0,
        unit="fraction",
        high=0.25,  # with the eight of LIMIT each a pixel cannot give more than it has
        trials=(0.2,),
        source="coupling to the second neighbour relative to the first; in CCDs 0.05 to 0.2",
    )
    beyond = Parameter(
        1.0,
        high=10.0,
        trials=(0.0,),
        source="1: a full well deflects all charge that still arrives; 0: charge above the full well does not deflect",
    )

    def apply(self, signal, p, stream, context):
        share = p.share_per_ke / 1000
        there = signal.clamp_max(1e15)  # whose square float32 holds
        held, over = torch.minimum(there, context.full_well_e), (there - context.full_well_e).clamp_min(0)
        push = held**2 / 2 + p.beyond * held * over  # integral of what is held over what arrives
        gained = torch.zeros_like(signal)
        for axis, strength in ((-1, share), (-2, p.aspect * share)):
            for apart, part in ((1, 1.0), (2, p.tail)):
                gained = gained + part * _gained(signal, strength * push, apart, axis)
        return signal + gained


def _gained(signal, push, apart, axis):
    """What each pixel gains from the two that lie so many pixels apart along an axis."""
    length = signal.shape[axis] - apart
    if length <= 0:
        return torch.zeros_like(signal)
    most = LIMIT * signal.narrow(axis, apart, length).sub(signal.narrow(axis, 0, length)).abs()
    flow = push.narrow(axis, apart, length) - push.narrow(axis, 0, length)
    flow = torch.minimum(torch.maximum(flow, -most), most)
    padded = F.pad(flow, (apart, apart) if axis == -1 else (0, 0, apart, apart))
    return padded.narrow(axis, apart, signal.shape[axis]) - padded.narrow(axis, 0, signal.shape[axis])
