"""Quantisation and the converter's range."""

from visaug.effects.effect import Effect, Stage
from visaug.effects.straight_through import round_through


class Quantization(Effect):
    """Rounds to whole DN and clips to [0, 2^bits - 1].

    Gradients pass rounding unchanged (straight through: the derivative of the mean if the noise is wider than one DN) and are
    zero where the converter clips. In the paper's reading uniform noise is added before rounding (eq. 13).
    """

    name = "quantization"
    stage = Stage.DIGITAL
    order = 50
    stepwise = True
    base = True
    aliases = ("ADC noise", "digitization")
    summary = "The converter rounds to whole numbers within its range."
    equation = "y <- clip(round(y), 0, 2^bits - 1); adds a variance of 1/12 DN^2"
    source = "EMVA 1288 release 4 Linear, eq. 8; the paper, eq. 13"

    separates = """look at the histogram of DN: quantization occupies every code; bit_truncation and
    missing_codes leave some empty"""

    def apply(self, signal, p, stream, context):
        if context.reading == "paper":
            signal = signal + stream.uniform() - 0.5
        return round_through(signal).clamp(0, context.max_dn)
