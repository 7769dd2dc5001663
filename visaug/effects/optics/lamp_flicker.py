"""Flicker of a lamp."""

import math

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class LampFlicker(Effect):
    """A lamp on alternating current, or dimmed by pulses, flickers while a rolling shutter exposes one row after another.

    Lamp and camera are not synchronised, so the phase is uniform and independent in every frame. An exposure of t averages
    the flicker and reduces its depth by sin(pi f t) / (pi f t): none is left at whole periods, 10 ms at 50 Hz mains. With
    `frequency_hz` 0 the exposure is much shorter than a period. A global shutter exposes all rows at once, so the level of the
    whole frame changes: see light_drift.
    """

    name = "lamp_flicker"
    stage = Stage.OPTICS
    order = 2
    aliases = ("flicker", "banding", "PWM", "mains", "50 Hz", "60 Hz", "rolling shutter bands")
    summary = "The light oscillates over the rows of a rolling shutter, with a random phase in each frame."
    equation = """mu_p <- mu_p (1 + depth sinc(f t) sin(2 pi (row / period + phase))), phase ~ U(0, 1) in
    every frame, sinc(x) = sin(pi x) / (pi x)"""
    source = """M. Sheinin, Y. Schechner and K. Kutulakos, Rolling shutter imaging on the electric grid, ICCP 2018"""
    separates = """compute the spectrum of the row means of single flats and of dark frames: periodic_banding is also in
    the dark, lamp_flicker only with light and in proportion to it; light_drift has no structure over the rows"""
    depth = Strength(
        0.05,
        unit="fraction",
        high=1.0,
        trials=(0.005, 0.02),
        source="amplitude relative to the mean; incandescent 0.1, LEDs 0 to 1",
    )
    period_rows = Parameter(
        60.0, "px", 2.0, 1e5, "row rate / frequency of the flicker", trials=(12.0, 25.0, 60.0, 200.0)
    )
    frequency_hz = Parameter(
        0.0, "Hz", 0.0, 1e6, "of the flicker, twice the mains: 100 or 120; 0: the exposure averages nothing"
    )

    def apply(self, signal, p, stream, context):
        turns = stream.uniform("frame") + context.rows(signal) / p.period_rows
        return signal * (1 + self._depth(p, context) * torch.sin(2 * math.pi * turns))

    def moments(self, mean, p, context):
        return mean, (mean * self._depth(p, context)) ** 2 / 2

    @staticmethod
    def _depth(p, context):
        return p.depth * torch.sinc(p.frequency_hz * context.exposure_s)
