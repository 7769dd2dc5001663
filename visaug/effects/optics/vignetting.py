"""Vignetting."""

from visaug.effects.effect import Effect, Parameter, Stage


class Vignetting(Effect):
    """Transmission falls from 1 at the axis as a power of the distance in half diagonals of the sensor.

    The power 2 is the first term of the natural cos^4 law; lens barrels cut off more steeply, towards 4 and
    above. A measured transmission (`map`, a file: a mean flat of an even source over its brightest part) takes
    the place of the law.
    """

    name = "vignetting"
    stage = Stage.OPTICS
    order = 10
    summary = "Light falls smoothly off from the centre of the field."
    equation = "mu_p <- mu_p max(0, 1 - corner_loss (r / r_corner)^power)"
    source = "D. B. Goldman, IEEE TPAMI 32 (2010) 2276; cos^4 law"
    separates = "flats with the camera turned before the source: vignetting stays, uneven light does not"
    map_unit = "fraction of the light that passes"
    map_low = 0.0
    corner_loss = Parameter(
        0.2,
        unit="fraction",
        high=1.0,
        strength=True,
        trials=(0.08, 0.3),
        source="loss in the corners: 5 to 60 %",
    )
    power = Parameter(
        2.0, low=1.0, high=8.0, trials=(2.0, 4.0), source="2: cos^4 law; more: stops in the barrel"
    )
    centre_row = Parameter(
        0.0, unit="fraction", low=-0.5, high=0.5, source="axis off the centre, of the rows"
    )
    centre_column = Parameter(
        0.0, unit="fraction", low=-0.5, high=0.5, source="axis off the centre, of the columns"
    )

    def apply(self, signal, p, stream, context):
        measured = context.measured_map(self.name, signal)
        if measured is not None:
            return signal * measured
        height, width = context.resolution
        y = context.rows(signal) + 0.5 - height * (0.5 + p.centre_row)
        x = context.columns(signal) + 0.5 - width * (0.5 + p.centre_column)
        r2 = (x**2 + y**2) / (height**2 + width**2) * 4 + 1e-12  # never 0: a root of 0 has no gradient
        return signal * (1 - p.corner_loss * r2 ** (p.power / 2)).clamp_min(0)
