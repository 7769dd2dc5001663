"""A measured component whose cause is not known."""

import numpy as np
import torch
from torch import Tensor

from visaug.effects.effect import Effect, Stage

PARTS = ("map_e", "row_power_e2", "column_power_e2", "level_e", "variance_e2")


class Unexplained(Effect):
    """What no effect of the catalogue explains, as it was measured: it lowers the error although nobody knows the cause.

    `visaug diagnose FRAMES --camera CAMERA -o FILE --unexplained` measures it and writes it beside the camera file. The file
    (`map`, a .npz) holds any of these arrays:

    - `map_e`, (rows, columns): a fixed pattern, the same in every frame;
    - `row_power_e2`, (rows,), and `column_power_e2`, (columns,): the power spectrum of an offset of each row (column) that is
      new in every frame: |DFT|^2 / rows at 0, 1, ... rows - 1 cycles per sensor. Its mean is the variance of the offset.
      Amplitudes are Gaussian and phases random, so a line of the spectrum is a wave with a new phase in each frame;
    - `level_e` and `variance_e2`, (n,): an additional variance of the temporal noise of each pixel at rising levels of its
      signal, interpolated linearly and constant beyond both ends.

    The noise does not depend on the exposure, the temperature or the gain. A camera file cannot name the effect without a
    file. Effects of the catalogue are the better description wherever one is accepted: they hold for other conditions.
    """

    name = "unexplained"
    proposed = False  # measured, not found: see visaug/diagnosis/empirical.py
    stage = Stage.READOUT
    order = 55
    aliases = ("empirical noise", "measured noise", "residual pattern")
    summary = "A fixed pattern, noise of rows and columns, and pixel noise as measured, of unknown cause."
    equation = """V <- V + m + r_row + c_column + sqrt(v(V)) z; m measured, z ~ N(0, 1), r and c stationary
    Gaussian with the measured power spectra, r, c and z new in every frame"""
    source = """measured from the frames by `visaug diagnose --unexplained`; spectra as in EMVA 1288 release 4
    Linear, spectrograms; noise of a given spectrum as in J. Timmer and M. Koenig, A&A 300 (1995) 707"""
    separates = "it is what remains when no effect of the catalogue is accepted; diagnose again once its cause is known"
    map_unit = "e- and e-^2"

    def apply(self, signal, p, stream, context):
        rows, columns, pixels = (stream.fork(part) for part in ("row", "column", "pixel"))
        out = signal
        if (pattern := context.measured_map(f"{self.name}.map_e", signal)) is not None:
            out = out + pattern
        if (power := self._part("row_power_e2", signal, context)) is not None:
            out = out + _lines(power, rows, context.window[0]).unsqueeze(-1)
        if (power := self._part("column_power_e2", signal, context)) is not None:
            out = out + _lines(power, columns, context.window[1]).unsqueeze(-2)
        if (variance := self._variance(signal, context)) is not None:
            noisy = variance > 0  # the root has no derivative at 0
            out = out + torch.where(noisy, variance, 1.0).sqrt() * noisy * pixels.normal()
        return out

    def moments(self, mean, p, context):
        pattern = context.measured_map(f"{self.name}.map_e", mean)
        powers = [self._part(part, mean, context) for part in ("row_power_e2", "column_power_e2")]
        variance = sum((power.mean() for power in powers if power is not None), torch.zeros_like(mean))
        of_pixels = self._variance(mean, context)
        mean = mean if pattern is None else mean + pattern
        return mean, variance if of_pixels is None else variance + of_pixels

    def _part(self, part, like, context):
        found = context.maps.get(f"{self.name}.{part}")
        return None if found is None else found.to(like.device)

    def _variance(self, signal, context):
        """The additional variance at the signal of each pixel; None if none was measured."""
        at, values = (self._part(part, signal, context) for part in ("level_e", "variance_e2"))
        if at is None or values is None:
            return None
        if len(at) == 1:
            return values.expand_as(signal)
        above = torch.searchsorted(at, signal.detach().to(at.dtype).contiguous()).clamp(1, len(at) - 1)
        share = ((signal - at[above - 1]) / (at[above] - at[above - 1])).clamp(0, 1)
        return values[above - 1] + share * (values[above] - values[above - 1])


def _lines(power: Tensor, stream, window: range) -> Tensor:
    """One offset for each line of the window, (B, C, lines): drawn for the whole sensor, which repeats beyond its edge."""
    count = len(power)
    white = torch.fft.rfft(stream.over(range(1), range(count)).normal("column").squeeze(2))
    noise = torch.fft.irfft(white * power[: count // 2 + 1].sqrt(), n=count)
    return noise[..., torch.arange(window.start, window.stop, device=noise.device) % count]


def fault_of(arrays: dict[str, np.ndarray], resolution: tuple[int, int]) -> tuple[str, str] | None:
    """What is wrong with the arrays of a file, and what was expected; None if they are parts of this effect."""
    for name, values in arrays.items():
        if name not in PARTS:
            return f"holds {name}", f"some of {', '.join(PARTS)}"
        if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
            return f"{name} holds values that are not finite numbers", "numbers"
        if name.endswith("_e2") and (values < 0).any():
            return f"{name} holds negative values", "0 or more"
    if not arrays:
        return "holds no array", f"some of {', '.join(PARTS)}"
    shapes = {"map_e": resolution, "row_power_e2": resolution[:1], "column_power_e2": resolution[1:]}
    for name, shape in shapes.items():
        if name in arrays and arrays[name].shape != shape:
            return f"{name} has shape {arrays[name].shape}", f"{shape}, the camera's resolution"
    at, variance = arrays.get("level_e"), arrays.get("variance_e2")
    if at is not None or variance is not None:
        if at is None or variance is None or at.ndim != 1 or not len(at) or at.shape != variance.shape:
            return "level_e and variance_e2 do not match", "both, of one length"
        if (np.diff(at.astype(np.float32)) <= 0).any():
            return "level_e does not rise", "levels in rising order"
    return None
