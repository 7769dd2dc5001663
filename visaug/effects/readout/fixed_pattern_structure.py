"""Structured fixed pattern."""

import math

import numpy as np
import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice
from visaug.effects.readout.steps import edges

SHARE = "share of the sensor"  # a unit


class FixedPatternStructure(Effect):
    """Column amplifiers share supplies and layout, so their offsets are correlated.

    The shapes are:

    - bands: groups of `period_px` adjacent lines share a level that is uniform in [-1, 1];
    - levels: the same with one of three levels -1, 0, 1 (the paper's columns lie near 11, 6 and 1 e-);
    - wave: a sine of period `period_px` with a phase that is fixed for the camera;
    - slope: a parabola across the sensor, from one edge to the other;
    - steps: the level rises by A at `edge` and by A times `second` at `second_edge`; a negative A inverts it.

    A measured structure (`map`, a file: a whole pattern, or the profile of columns or rows) replaces the shape and its
    amplitude and is added to what `dsnu` draws; `dsnu.map` replaces that too.
    """

    name = "fixed_pattern_structure"
    stage = Stage.READOUT
    order = 15
    aliases = ("fixed pattern noise", "FPN", "banding", "vertical stripes", "bias structure")
    summary = "An additive pattern with bands, steps, slope or period, constant over the frames of a camera."
    equation = """V <- V + A f(x): bands, levels, sin(2 pi (x / period + phase)), slope u + curvature (u^2 -
    1), u from -1 to 1, or steps [x > edge] + second [x > second_edge]"""
    source = "the paper, figs. 2 and 4 (columns in three bands); EMVA 1288 release 4 Linear, spectrograms"
    separates = """average many bias frames and compute the row and column profiles and their spectra: dsnu is
    white; periodic_banding and flicker_noise average out; dark-current patterns grow with the exposure"""
    map_unit = "e-"
    amplitude_e = Strength(2.0, "e-", -1e4, 1e4, "5 e- for the paper's columns", trials=(1.0, 4.0))
    period_px = Parameter(
        32.0,
        unit="px",
        low=1.0,
        high=1e5,
        trials=(8.0, 32.0, 100.0, 300.0),
        source="of a wave; width of a band; assumed",
        of=("bands", "levels", "wave"),
    )
    curvature = Parameter(
        0.0, "1", -1.0, 1.0, "of a slope, relative to its linear part", trials=(0.5,), of=("slope",)
    )
    edge = Parameter(0.33, SHARE, 0.0, 1.0, "of steps: position of the first", trials=(0.33,), of=("steps",))
    second_edge = Parameter(
        0.67, SHARE, 0.0, 1.0, "of steps: position of the second", trials=(0.67,), of=("steps",)
    )
    second = Parameter(
        -1.0, "1", -10.0, 10.0, "of steps: the second relative to the first", trials=(-1.0,), of=("steps",)
    )
    shape = choice(
        ("bands", "levels", "wave", "slope", "steps"), "the paper, fig. 2: levels, steps and a slope"
    )
    direction = choice(("columns", "rows"), "columns: constant along a column")

    def apply(self, signal, p, stream, context):
        if (measured := context.measured_map(self.name, signal)) is not None:
            return signal + measured
        return signal + p.amplitude_e * self._pattern(signal, p, stream.fixed, context)

    def moments(self, mean, p, context):
        if (measured := context.measured_map(self.name, mean)) is not None:
            return mean + measured, torch.zeros_like(mean)
        if p.shape == "slope":
            return mean + p.amplitude_e * self._slope(mean, p, context), torch.zeros_like(mean)
        if p.shape == "steps":
            return mean + p.amplitude_e * self._steps(mean, p, context), torch.zeros_like(mean)
        if p.shape == "wave":
            return mean, p.amplitude_e**2 / 2
        return None  # a pixel on the edge of two bands has a share of either

    def _pattern(self, signal, p, fixed, context):
        if p.shape == "slope":
            return self._slope(signal, p, context)
        if p.shape == "steps":
            return self._steps(signal, p, context)
        place, extent = context.places(p.direction, signal)
        if p.shape == "wave":
            return torch.sin(2 * math.pi * (place / p.period_px + fixed.uniform("frame")))
        vary, axis = ("column", 3) if p.direction == "columns" else ("row", 2)
        level = fixed.over(range(extent + 1), range(extent + 1)).uniform(vary)
        level = (3 * level).floor() - 1 if p.shape == "levels" else 2 * level - 1
        here, behind = (torch.floor(edge / p.period_px).detach() for edge in (place, place + 1))
        # An edge inside a pixel gives it a share of either band, and the width a derivative.
        share = (place + 1 - behind * p.period_px).clamp(0, 1)
        here, behind = (torch.take_along_dim(level, band.long(), axis) for band in (here, behind))
        return here + share * (behind - here)

    def _slope(self, signal, p, context):
        place, extent = context.places(p.direction, signal)
        u = (2 * place + 1) / extent - 1
        return u + p.curvature * (u**2 - 1)

    def _steps(self, signal, p, context):
        place, extent = context.places(p.direction, signal)
        # a pixel that an edge falls into has its share, which gives the edge a derivative
        first, second = ((place + 1 - edge * extent).clamp(0, 1) for edge in (p.edge, p.second_edge))
        return first + p.second * second

    @classmethod
    def looks(cls, seen):
        """The three levels that the columns, or the rows, of the mean dark frame show best."""
        found = []
        for direction, profile, place in seen.profiles:
            (first, second), levels = edges(profile, 2)
            rise, then = np.diff(levels)
            rise = rise if abs(rise) > 1e-3 else 1e-3
            steps = {"amplitude_e": float(rise), "second": float(np.clip(then / rise, -10, 10))}
            places = {"edge": float(place[first]), "second_edge": float(place[second])}
            found.append({"shape": "steps", "direction": direction, **steps, **places})
        return found
