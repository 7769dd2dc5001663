"""Drift of the light."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class LightDrift(Effect):
    """All light of a frame changes by a relative Gaussian amount; a dark frame does not change.

    In a sequence, consecutive frames may be correlated (a drifting lamp): a first-order autoregression with standard
    deviation `sigma`. Unrelated images have independent draws.
    """

    name = "light_drift"
    stage = Stage.OPTICS
    order = 0
    aliases = ("flicker", "lamp drift", "source instability")
    summary = "The level of the light source changes from frame to frame."
    equation = "mu_p <- mu_p (1 + sigma x_k), x_k = c x_(k-1) + sqrt(1 - c^2) z_k, z_k ~ N(0, 1)"
    source = "a first-order autoregression; EMVA 1288 asks for a source that is stable over a series"
    separates = """compare dark with illuminated frames: black_level_drift is present in both, light_drift
    only with light"""
    sigma = Strength(0.01, "fraction", 0.0, 0.5, "lamps and LEDs: 0.1 to 2 %", trials=(0.005, 0.02))
    correlation = Parameter(
        0.0, "1", 0.0, 0.999, "between consecutive frames; 0: white, near 1: a random walk", trials=(0.0, 0.9)
    )

    def apply(self, signal, p, stream, context):
        return signal * (1 + p.sigma * self._levels(p, stream, context)).clamp_min(0)

    def _levels(self, p, stream, context):
        fresh = stream.normal("frame")
        if not context.sequence:
            return fresh
        level, levels = context.memory.get(self.name), []
        for c, z in zip(p.correlation.expand_as(fresh).split(1), fresh.split(1)):
            level = z if level is None else c * level + torch.sqrt(1 - c**2) * z
            levels.append(level)
        context.memory[self.name] = levels[-1].detach()
        return torch.cat(levels)

    def moments(self, mean, p, context):
        return mean, (mean * p.sigma) ** 2
