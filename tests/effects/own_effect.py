"""A user's own effect, as `--effects` loads it: the laws hold for it too."""

from visaug.effects import Effect, Parameter, Stage


class ColumnRamp(Effect):
    name = "column_ramp"
    stage = Stage.READOUT
    summary = "The offset rises along each row, as a supply sags, by a slope that is new in every frame."
    equation = "V <- V + s column / columns, s ~ N(0, sigma^2)"
    source = "made up for the tests"
    sigma_e = Parameter(1.0, unit="e-", high=100.0, strength=True, trials=(1.0, 5.0), source="made up")

    def apply(self, signal, p, stream, context):
        ramp = context.columns(signal) / context.resolution[1]
        return signal + p.sigma_e * stream.normal("frame") * ramp

    def moments(self, mean, p, context):
        return mean, (p.sigma_e * context.columns(mean) / context.resolution[1]) ** 2
