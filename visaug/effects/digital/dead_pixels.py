"""Dead pixels."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class DeadPixels(Effect):
    """A defective pixel gives one code in every frame: the black level (no response), code 0, the highest code, or one between."""

    name = "dead_pixels"
    stage = Stage.DIGITAL
    order = 90
    aliases = ("stuck pixels", "defect pixels", "cold pixels")
    summary = "A few pixels have a constant output at any light level."
    equation = """y <- round(L), L = b + l (top - b), or b (1 + l) for l < 0, where the pixel is dead; l =
    clip(level + spread n_pixel, -1, 1), b: black level"""
    source = "EMVA 1288 release 4 Linear, defect pixels"
    separates = """take flats at several levels: a dead pixel never changes; hot_pixels add a dark signal to
    the light, prnu scales with the light"""
    differentiable = False
    why_not = "whether a pixel is dead is discrete; image and level have no gradient through a dead pixel"
    density = Strength(
        0.001, "share of pixels", 0.0, 1.0, "below 0.1 % in datasheets; assumed", trials=(0.0005, 0.004)
    )
    level = Parameter(
        0.0,
        unit="share of the range",
        low=-1.0,
        high=1.0,
        trials=(0.0, -1.0, 0.3, 1.0),
        source="0: the black level, as without light; -1: code 0; 1: the highest code",
    )
    spread = Parameter(
        0.0, "share of the range", 0.0, 1.0, "standard deviation over dead pixels", trials=(0.15,)
    )

    @classmethod
    def looks(cls, seen):
        """As many as do not answer light, at their levels: a fit that starts without a spread does not find it."""
        if len(seen.stuck) == 0:
            return []
        level, spread = float(seen.stuck.mean()), float(seen.stuck.std())
        return [{"density": len(seen.stuck) / seen.dark_e.size, "level": level, "spread": spread}]

    def apply(self, signal, p, stream, context):
        fixed = stream.fixed
        dead = fixed.fork("where").uniform() < p.density
        level = (p.level + p.spread * fixed.fork("level").normal()).clamp(-1, 1)
        black = context.black_level_dn
        stuck = black + torch.where(level < 0, level * black, level * (context.max_dn - black))
        return torch.where(dead, stuck.round(), signal)
