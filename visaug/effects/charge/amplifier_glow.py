"""Amplifier glow."""

import torch

from visaug.effects.charge.dark_electrons import REFERENCE_C, add_dark_electrons
from visaug.effects.effect import Effect, Parameter, Stage, Strength

# where on the sensor, in shares of its rows and columns; None: all along that side
CORNERS = {
    "top_left": (0.0, 0.0),
    "top_right": (0.0, 1.0),
    "bottom_left": (1.0, 0.0),
    "bottom_right": (1.0, 1.0),
}
SIDES = {"top": (0.0, None), "bottom": (1.0, None), "left": (None, 0.0), "right": (None, 1.0)}
PLACES = {**CORNERS, **SIDES}
RIM = "rim"  # all four sides: drivers and amplifiers all around


class AmplifierGlow(Effect):
    """Circuits beside the pixels emit near-infrared light during the exposure, almost independent of temperature.

    A measured glow (`map`, a file) replaces the profile and its rate; the temperature coefficient still applies.
    """

    name = "amplifier_glow"
    stage = Stage.GENERATION
    order = 40
    aliases = ("amp glow", "electroluminescence")
    summary = "A smooth dark signal from an edge or corner grows with the exposure time."
    equation = "mu_e <- mu_e + t rate exp(b (T - 20 C)) exp(-(d / width)^shape), d: distance to the place"
    source = "J. Janesick, Scientific Charge-Coupled Devices (SPIE, 2001), on amplifier luminescence"
    separates = "take darks with and without a lens cover: a light leak disappears, glow does not"
    map_unit = "e-/s at 20 C"
    map_low = 0.0
    rate_e_per_s = Strength(20.0, "e-/s", 0.0, 1e6, "at the brightest position, at 20 C", trials=(5.0, 25.0))
    place = Parameter(
        "bottom_right",
        options=(*PLACES, RIM),
        source="the corner or edge at which the circuit lies, or all edges",
    )
    width = Parameter(
        0.25,
        unit="fraction",
        low=0.002,
        high=5.0,
        trials=(0.004, 0.012, 0.035, 0.1, 0.3, 0.9),  # from a few pixels to the whole sensor
        source="decay length relative to the longer side",
    )
    shape = Parameter(1.0, "1", 0.3, 4.0, "1: exponential, 2: Gaussian fall-off", trials=(1.0, 2.0))
    b_per_c = Parameter(
        0.01,
        unit="1/C",
        low=-0.1,
        high=0.2,
        trials=(0.01, 0.1),
        source="light, not heat: much smaller than the dark current's 0.0866",
    )

    def apply(self, signal, p, stream, context):
        if (rate := context.measured_map(self.name, signal)) is None:
            rate = p.rate_e_per_s * self._profile(signal, p, context)
        heating = torch.exp(p.b_per_c * (context.temperature_c - REFERENCE_C))
        return add_dark_electrons(signal, context.exposure_s * rate * heating, stream, context)

    @staticmethod
    def _profile(signal, p, context):
        height, width = context.resolution
        rows, columns = context.rows(signal) + 0.5, context.columns(signal) + 0.5
        if p.place == RIM:
            to_sides = torch.minimum(rows, height - rows), torch.minimum(columns, width - columns)
            distance = torch.minimum(*to_sides)
        else:
            y, x = PLACES[p.place]
            down = 0.0 if y is None else rows - y * height
            across = 0.0 if x is None else columns - x * width
            distance = torch.sqrt(torch.as_tensor(down**2 + across**2))
        return torch.exp(-((distance / max(height, width) / p.width) ** p.shape))
