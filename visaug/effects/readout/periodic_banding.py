"""Periodic banding."""

import math

import numpy as np
import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength


class PeriodicBanding(Effect):
    """A clock, a switching supply or the mains interferes with the readout, row after row.

    It is not synchronised with the frame clock, so the phase at row 0 is uniform and independent in every frame.
    """

    name = "periodic_banding"
    stage = Stage.READOUT
    order = 50
    aliases = ("banding", "EMI", "mains hum", "interference", "pattern noise", "horizontal stripes")
    summary = "A sinusoidal offset over the rows, with a random phase in each frame."
    equation = """V <- V + A (sin theta + h sin 2 theta), theta = 2 pi (row / period + phase), phase ~ U(0, 1)
    in every frame"""
    source = """K. Wei et al., IEEE TPAMI 44 (2022) 8520 (banding pattern noise); EMVA 1288 release 4 Linear,
    spectrograms"""
    separates = """compute the spectrum of the row means of single dark frames: a line at one frequency,
    absent in the average of many frames; a wave of fixed_pattern_structure remains in the average"""
    amplitude_e = Strength(1.0, "e-", 0.0, 1e4, "0.1 to 1 times the read noise", trials=(0.5, 1.5))
    period_rows = Parameter(
        20.0,
        unit="px",
        low=2.0,
        high=1e5,
        trials=(3.0, 6.0, 10.0, 20.0, 35.0, 60.0),
        source="row rate divided by the interfering frequency",
    )
    second_harmonic = Parameter(
        0.0, "fraction", 0.0, 1.0, "amplitude relative to the first; 0: a pure sine", trials=(0.5,)
    )

    def apply(self, signal, p, stream, context):
        theta = 2 * math.pi * (context.rows(signal) / p.period_rows + stream.uniform("frame"))
        return signal + p.amplitude_e * (torch.sin(theta) + p.second_harmonic * torch.sin(2 * theta))

    @classmethod
    def looks(cls, seen):
        """The highest line in the spectrum of single frames' rows, as high as it is and, if that is faint, higher.

        The shift by a faint one is hidden in the noise of a few simulations; that by a strong one can be scaled down.
        """
        lines = seen.row_noise_e - seen.row_noise_e.mean(1, keepdims=True)
        count, height = lines.shape
        if count == 0 or height < 4:
            return []
        finer = 8  # points of a spectrum for each that a frame's rows resolve
        power = (np.abs(np.fft.rfft(lines, finer * height)) ** 2).mean(0)
        top = finer + int(power[finer:].argmax())  # a whole period or more in a frame
        seen_e = 2 * math.sqrt(power[top]) / height
        amplitudes = {max(seen_e, least) for least in (1e-3, cls.parameters["amplitude_e"].trials[0])}
        return [{"amplitude_e": a, "period_rows": finer * height / top} for a in sorted(amplitudes)]

    def moments(self, mean, p, context):
        return mean, p.amplitude_e**2 * (1 + p.second_harmonic**2) / 2
