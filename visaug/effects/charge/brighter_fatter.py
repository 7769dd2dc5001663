"""The brighter-fatter effect."""

import torch
import torch.nn.functional as F

from visaug.effects.effect import Effect, Parameter, Stage

LIMIT = 0.2  # below 1/4: a pixel cannot give its four neighbours more than it has


class BrighterFatter(Effect):
    """Charge in a pixel pushes its walls outwards, so that charge on its way lands next door.

    A pair of neighbours evens out by a share of its difference that grows with the pair's mean charge; all
    charge is kept. In a flat of mean mu the variance becomes mu [(1 - 4 a mu)^2 + 4 (a mu)^2] and
    neighbours get the covariance 2 a mu^2 (1 - 4 a mu), where a is the share per electron.
    """

    name = "brighter_fatter"
    stage = Stage.CHARGE
    order = 40
    summary = "Neighbours share charge, the more the more they hold."
    equation = "N_i <- N_i + sum over neighbours j of min(a (N_i + N_j) / 2, 0.2) (N_j - N_i)"
    source = "P. Antilogus et al., JINST 9 (2014) C03048; A. Guyonnet et al., A&A 575 (2015) A41"
    separates = "covariance in flats: this one grows with the square of the level, crosstalk's with the level"
    share_per_ke = Parameter(
        3e-4,
        unit="1/(1000 e-)",
        high=0.1,
        strength=True,
        trials=(1e-3, 4e-3),
        source="variance of thick CCDs falls by 20 % at 100 000 e-; more in small pixels",
    )
    aspect = Parameter(1.0, high=10.0, trials=(1.0, 2.5), source="vertical to horizontal; in CCDs 2 to 3")

    def apply(self, signal, p, stream, context):
        share = p.share_per_ke / 1000
        held = torch.minimum(
            signal, context.full_well_e
        )  # what is above the full well is on its way elsewhere
        left, right = held[..., :-1], held[..., 1:]
        across = (share * (left + right) / 2).clamp_max(LIMIT) * (right - left)
        up, down = held[..., :-1, :], held[..., 1:, :]
        along = (p.aspect * share * (up + down) / 2).clamp_max(LIMIT) * (down - up)
        gained = torch.diff(F.pad(across, (1, 1)), dim=-1) + torch.diff(F.pad(along, (0, 0, 1, 1)), dim=-2)
        return signal + gained
