"""Slanted interference."""

import math

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class SlantedInterference(Effect):
    """A radio, a motor or a switching supply is picked up at a frequency above the row rate.

    Pixels are read one after another, so the wave advances by a fixed phase from pixel to pixel and from row to row: a plane
    wave across the frame. It is not synchronised with the frames, so its phase is uniform and independent in every frame.
    """

    name = "slanted_interference"
    proposed = False  # where it was tried it took the place of other effects
    stage = Stage.READOUT
    order = 52
    aliases = ("EMI", "banding", "interference", "herringbone", "moving stripes", "pattern noise")
    summary = "A plane wave across rows and columns, with a random phase in each frame."
    equation = "V <- V + A sin(2 pi ((row cos angle + column sin angle) / period + phase)), phase ~ U(0, 1) in every frame"
    source = "derived: a sine in time, sampled pixel by pixel and row by row; EMVA 1288 release 4 Linear, spectrograms"
    separates = """compute the two-dimensional spectrum of single dark frames: one peak off both axes; that of
    periodic_banding lies on the axis of the rows"""
    amplitude_e = Strength(1.0, "e-", 0.0, 1e4, "0.1 to 1 times the read noise", trials=(0.5, 2.0))
    period_px = Parameter(10.0, "px", 2.0, 1e4, "across the wave fronts", trials=(5.0, 8.0, 14.0, 30.0))
    angle_deg = Parameter(
        40.0,
        unit="deg",
        low=-90.0,
        high=90.0,
        trials=(20.0, 40.0, 65.0, -40.0),
        source="0: along the columns, as periodic_banding; 90: along the rows",
    )

    def apply(self, signal, p, stream, context):
        angle = torch.deg2rad(p.angle_deg)
        across = context.rows(signal) * torch.cos(angle) + context.columns(signal) * torch.sin(angle)
        turns = across / p.period_px + stream.uniform("frame")
        return signal + p.amplitude_e * torch.sin(2 * math.pi * turns)

    def moments(self, mean, p, context):
        return mean, p.amplitude_e**2 / 2
