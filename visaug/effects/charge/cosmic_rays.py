"""Cosmic rays."""

import math

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class CosmicRays(Effect):
    """The number of tracks is Poisson; start and direction are uniform, length and charge per pixel exponential.

    Tracks that start outside a crop do not appear in it.
    """

    name = "cosmic_rays"
    stage = Stage.CHARGE
    order = 20
    local = False
    aliases = ("particle tracks", "single event transients", "SET", "radiation")
    summary = "Particles leave tracks of charge in single frames."
    equation = """tracks ~ Poisson(rate (t + readout) per 10^6 px), charge per px ~ Exp(charge), length ~ Exp(length)"""
    source = "D. Groom, Experimental Astronomy 14 (2002) 45; 80 e- per um of silicon"
    differentiable = False
    why_not = "the number of tracks and the pixels they cross are discrete"
    separates = "take a second frame: a cosmic-ray track is not repeated, a hot pixel or rts_noise pixel is"
    rate_per_mpx_s = Strength(
        1.0,
        unit="1/(Mpx s)",
        high=1e6,
        trials=(30.0, 300.0),
        source="ground: 1/(cm^2 min), 0.003 for 4 um pixels; orbit: 100 times that, more in the radiation belts",
    )
    charge_e_per_px = Parameter(
        800.0, "e-/px", 0.0, 1e6, "80 e-/um of path, times the pixel size", trials=(400.0, 2000.0)
    )
    length_px = Parameter(
        6.0, "px", 0.5, 50.0, "depth over pixel size, depending on the angle", trials=(2.0, 8.0)
    )
    readout_s = Parameter(
        0.0, "s", 0.0, 1e3, "frames also collect tracks while they wait for readout", trials=(0.0, 0.2)
    )

    @classmethod
    def looks(cls, seen):
        """As many tracks, as long and as bright as were seen; a single pixel may jump for other reasons.

        Lengths are exponential: beyond their first pixel tracks are as long as all are, and exp(-1 / length) have more than one.
        """
        pixels, electrons = seen.tracks[seen.tracks[:, 0] > 1].T
        if len(pixels) == 0 or seen.searched_mpx_s == 0:
            return []
        length = max(float(pixels.mean()) - 1, cls.parameters["length_px"].low)
        rate = len(pixels) * math.exp(1 / length) / seen.searched_mpx_s
        charge = float((electrons / pixels).mean())
        return [{"rate_per_mpx_s": rate, "charge_e_per_px": charge, "length_px": length}]

    def apply(self, signal, p, stream, context):
        expected = (p.rate_per_mpx_s * (context.exposure_s + p.readout_s) * 1e-6).detach()
        image, channel, row, column = torch.nonzero(stream.poisson(expected), as_tuple=True)
        if len(image) == 0:
            return signal

        def uniform(what):
            """Of each track: the numbers of its row and its column add up, modulo 1, to a uniform one."""
            own = stream.fork(what)
            by_row, by_column = own.uniform("row"), own.uniform("column")
            return (by_row[image, channel, row, 0] + by_column[image, channel, 0, column]) % 1

        def each(parameter):
            return parameter.detach().expand(len(signal), 1, 1, 1)[image, 0, 0, 0]

        angle = 2 * math.pi * uniform("direction")
        length = -torch.log1p(-uniform("length")) * each(p.length_px)
        charge = -torch.log1p(-uniform("charge")) * each(p.charge_e_per_px)
        longest_px = 200  # tracks are cut here; at a mean of 20 px one in 22000 is
        step = torch.arange(min(longest_px, math.ceil(float(length.max()))), device=signal.device)
        r = (row[:, None] + torch.sin(angle)[:, None] * step).round().long()
        c = (column[:, None] + torch.cos(angle)[:, None] * step).round().long()
        deposit = charge[:, None] * (length[:, None] - step).clamp(0, 1)  # the last step is a part of a px
        rows, columns = signal.shape[-2:]
        inside = (r >= 0) & (r < rows) & (c >= 0) & (c < columns)
        plane = (image * signal.shape[1] + channel)[:, None].expand_as(r)
        place = (plane * rows + r) * columns + c
        tracks = torch.zeros(signal.numel(), dtype=signal.dtype, device=signal.device)
        return signal + tracks.index_add(0, place[inside], deposit[inside].to(signal.dtype)).view_as(signal)
