"""Fringing."""

import math

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class Fringing(Effect):
    """Narrow-band light interferes in a thin layer (the silicon of a back-illuminated sensor, or its cover glass).

    The thickness varies over the sensor as a shallow paraboloid about a point that is drawn once per camera, so the fringes
    are rings about it. Broad-band light averages them out.
    """

    name = "fringing"
    stage = Stage.OPTICS
    order = 14
    aliases = ("etaloning", "interference fringes", "Newton rings")
    summary = "Narrow-band light shows interference fringes of the sensor's layers."
    equation = """mu_p <- mu_p (1 + A cos(2 pi (fringes r^2 + phase))), r: distance to a point of the camera
    in units of the longer side, phase ~ U(0, 1) per camera"""
    source = """E. M. Malumuth et al., Model of fringing in the WFC3 CCDs, Proc. SPIE 4854 (2003) 567, 700 to
    1000 nm; here the first harmonic of the interference, for a thickness that varies as a paraboloid"""
    separates = "take flats in narrow-band and in white light: fringes disappear in white light; dust, vignetting and prnu do not"
    amplitude = Strength(
        0.02, "fraction", 0.0, 1.0, "1 to 10 % above 750 nm in thinned CCDs", trials=(0.005, 0.02)
    )
    fringes = Parameter(
        5.0, "1", 0.5, 1e3, "2 n times the change of thickness / wavelength", trials=(5.0, 15.0)
    )

    def apply(self, signal, p, stream, context):
        height, width = context.resolution
        row, column, phase = (stream.fixed.fork(what).uniform("frame") for what in ("row", "column", "phase"))
        y = (context.rows(signal) + 0.5 - height * (1.5 * row - 0.25)) / max(height, width)
        x = (context.columns(signal) + 0.5 - width * (1.5 * column - 0.25)) / max(height, width)
        return signal * (1 + p.amplitude * torch.cos(2 * math.pi * (p.fringes * (x**2 + y**2) + phase)))

    def moments(self, mean, p, context):
        return mean, (mean * p.amplitude) ** 2 / 2
