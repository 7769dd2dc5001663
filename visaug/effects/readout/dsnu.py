"""Dark-signal non-uniformity."""

from visaug.effects.effect import Effect, Stage, Strength


class DSNU(Effect):
    """A fixed pattern of offsets, drawn once per camera: column + row + pixel, each Gaussian with mean 0.

    A measured offset of every pixel (`dsnu.map`, a file) replaces the drawn one.
    """

    name = "dsnu"
    stage = Stage.READOUT
    order = 10
    base = True
    aliases = ("DSNU", "fixed pattern noise", "FPN", "offset FPN", "bias pattern")
    summary = "Pixels, rows and columns differ in their offset, with and without light."
    equation = "V <- V + D_column + D_row + D_pixel"
    source = "EMVA 1288 release 4 Linear, section 4; the paper, eq. 11"
    separates = """average many bias frames: temporal noise of rows, columns and pixels averages out, dsnu
    remains; dark_current_nonuniformity is absent in bias frames and grows with the exposure"""
    map_unit = "e-"
    column_e = Strength(0.0, "e-", 0.0, 1e4, "EMVA 1288: DSNU_col", trials=(0.5, 2.0))
    row_e = Strength(0.0, "e-", 0.0, 1e4, "EMVA 1288: DSNU_row", trials=(0.3, 1.0))
    pixel_e = Strength(0.0, "e-", 0.0, 1e4, "EMVA 1288: DSNU_pix", trials=(0.5, 2.0))

    def apply(self, signal, p, stream, context):
        if (pattern := context.measured_map(self.name, signal)) is None:
            pattern = stream.fixed.pattern(p.column_e, p.row_e, p.pixel_e)
        return signal + pattern

    def moments(self, mean, p, context):
        if (pattern := context.measured_map(self.name, mean)) is not None:
            return mean + pattern, 0 * mean
        return mean, p.column_e**2 + p.row_e**2 + p.pixel_e**2
