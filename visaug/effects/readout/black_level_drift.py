"""Drift of the black level."""

import torch

from visaug.effects.effect import AdditiveNoise, Parameter, Stage, Strength


class BlackLevelDrift(AdditiveNoise):
    """The clamp that sets the black level is noisy and depends on the temperature of the electronics.

    Along a sequence the offset is a first-order autoregression with standard deviation `sigma_e` and `correlation` between
    consecutive frames (0: white; towards 1: a random walk). Unrelated images get independent offsets.
    """

    name = "black_level_drift"
    stage = Stage.READOUT
    order = 70
    aliases = ("offset drift", "bias drift", "pedestal drift", "clamp noise")
    summary = "The offset of the whole frame changes from frame to frame."
    equation = "V <- V + d_t, d_t = r d_(t-1) + sigma sqrt(1 - r^2) n_t, n_t ~ N(0, 1)"
    source = """EMVA 1288 release 4 Linear, stability of the dark signal; J. Janesick, Photon Transfer (SPIE 2007)"""
    separates = """compute the mean of each frame of a dark series: the whole frame shifts, with and without
    light; light_drift is absent in the dark"""
    sigma_e = Strength(1.0, "e-", 0.0, 1e4, "0.1 to 1 times the read noise", trials=(0.3, 1.5))
    correlation = Parameter(0.9, "1", 0.0, 0.999, "depends on the frame rate; assumed", trials=(0.0, 0.9))

    def apply(self, signal, p, stream, context):
        course = stream.normal("frame")
        if context.sequence:
            course = self._walk(course, p.correlation, context)
        return signal + p.sigma_e * course

    def _walk(self, fresh, correlation, context):
        """Autoregressive course of variance 1 from white numbers (B, 1, 1, 1), on from the last batch."""
        correlation = torch.as_tensor(correlation, device=fresh.device).expand_as(fresh)
        before, course = context.memory.get(self.name), []
        for new, r in zip(fresh, correlation):
            before = new if before is None else r * before + (1 - r**2).sqrt() * new
            course.append(before)
        context.memory[self.name] = before.detach()
        return torch.stack(course)
