"""Photo-response non-uniformity."""

from visaug.effects.effect import Effect, Stage, Strength


class PRNU(Effect):
    """A fixed pattern, drawn once per camera: K = column + row + pixel, each Gaussian with mean 0.

    A measured K of every pixel (`prnu.map`, a file) replaces the drawn one.
    """

    name = "prnu"
    stage = Stage.GENERATION
    order = 10
    base = True
    aliases = ("PRNU", "fixed pattern noise", "FPN", "photo response non-uniformity", "gain FPN")
    summary = "Pixels, rows and columns differ in their response to light."
    equation = "mu_e <- mu_e (1 + K_column + K_row + K_pixel)"
    source = "EMVA 1288 release 4 Linear, section 4; the paper, eq. 10"
    separates = """compare flats at several levels: shot noise grows with the root of the light, PRNU in
    proportion to it; the difference of two flats contains no PRNU"""
    map_unit = "fraction"
    column = Strength(0.0, "fraction", 0.0, 0.5, "EMVA 1288: PRNU_col", trials=(0.001, 0.003))
    row = Strength(0.0, "fraction", 0.0, 0.5, "EMVA 1288: PRNU_row", trials=(0.001, 0.003))
    pixel = Strength(0.0, "fraction", 0.0, 0.5, "EMVA 1288: PRNU_pix", trials=(0.003, 0.008))

    def apply(self, signal, p, stream, context):
        if (pattern := context.measured_map(self.name, signal)) is None:
            pattern = stream.fixed.pattern(p.column, p.row, p.pixel)
        return (signal * (1 + pattern)).clamp_min(0)

    def moments(self, mean, p, context):
        if (pattern := context.measured_map(self.name, mean)) is not None:
            return mean * (1 + pattern), 0 * mean
        return mean, mean**2 * (p.column**2 + p.row**2 + p.pixel**2)
