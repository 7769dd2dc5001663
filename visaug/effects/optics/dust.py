"""Dust."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength

MOST = 200  # specks of a sensor


class Dust(Effect):
    """Specks on the cover glass of the sensor cast soft shadows, which stay where they are until the sensor is cleaned.

    A shadow is the speck blurred by the pupil: flat with a soft edge where the speck is larger than the blur. Its radius is
    about the distance of the glass over twice the f-number, so it grows as the aperture is opened while the shadow becomes
    fainter. Radii differ by up to a factor of 1.5 and depths by up to a factor of 3; places are uniform over the sensor. All
    are drawn once per camera.
    """

    name = "dust"
    stage = Stage.OPTICS
    order = 12
    aliases = ("sensor dust", "dirt", "blemish", "dark spots")
    summary = "Specks on the cover glass cast soft dark shadows."
    equation = "mu_p <- mu_p prod_i (1 - depth d_i exp(-(r_i / (radius q_i))^4)), d_i ~ U(1/3, 1), q_i ~ U(2/3, 3/2) per camera"
    source = """A. E. Dirik, H. T. Sencar and N. Memon, IEEE Trans. Information Forensics and Security 3
    (2008) 539, who take the shadow to be Gaussian; the flatter form is that of a disc blurred by the pupil"""
    separates = """take flats before and after cleaning, and at two apertures: shadows disappear, or change
    size; prnu is white, and vignetting is centred on the axis"""
    depth = Strength(0.1, "fraction", 0.0, 1.0, "1 to 30 %, at small apertures most", trials=(0.03, 0.15))
    radius_px = Parameter(
        8.0, "px", 1.0, 500.0, "1 mm of glass at f/8 on 3.45 um pixels: 18 px", trials=(4.0, 12.0)
    )
    specks = Parameter(8.0, "specks", 1.0, MOST, "assumed", integer=True, trials=(4, 16))

    def apply(self, signal, p, stream, context):
        height, width = context.resolution
        parts = ("row", "column", "depth", "radius")
        drawn = {what: stream.fixed.fork(what).over(range(1), range(MOST)) for what in parts}
        share = {what: own.uniform("column")[:, :1].unbind(-1) for what, own in drawn.items()}
        rows, columns = context.rows(signal) + 0.5, context.columns(signal) + 0.5
        passed = torch.ones_like(p.depth)
        edge = 4  # power of the distance in the fall-off: a flat shadow with a soft edge
        for i in range(int(p.specks.detach().round().max())):
            radius2 = (p.radius_px * (2 / 3 + 5 / 6 * _at(share["radius"], i))) ** 2
            down, across = rows - height * _at(share["row"], i), columns - width * _at(share["column"], i)
            away2 = down**2 + across**2
            own = (1 + 2 * _at(share["depth"], i)) / 3 * (i < p.specks.round())
            passed = passed * (1 - p.depth * own * torch.exp(-((away2 / radius2) ** (edge // 2))))
        return signal * passed


def _at(shares, i):
    return shares[i].unsqueeze(-1)
