"""Random telegraph signal of the dark current."""

import torch

from visaug.effects.charge.dark_electrons import REFERENCE_C, add_dark_electrons
from visaug.effects.effect import Effect, Parameter, Stage, Strength
from visaug.effects.telegraph import kept_states


class DarkCurrentRTS(Effect):
    """A metastable defect in a few pixels has two configurations with different generation rates.

    Amplitudes are exponential over the pixels and drawn once per camera. A defect keeps its configuration from frame to frame
    with the probability `kept`; its time constants are seconds to days. A defect that hardly ever jumps is a hot pixel. Unlike
    `rts_noise`, the jump grows with the exposure and the temperature.
    """

    name = "dark_current_rts"
    stage = Stage.GENERATION
    order = 32
    aliases = ("DC-RTS", "random telegraph noise", "blinking pixels")
    summary = "The dark current of a few pixels jumps between two levels from frame to frame."
    equation = """mu_e <- mu_e + t A_pixel exp(b (T - 20 C)) s, s in {0, 1} with P(1) = duty, s_k = s_(k-1)
    with probability kept, else drawn anew"""
    source = """I. H. Hopkins and G. R. Hopkinson, IEEE Trans. Nuclear Science 40 (1993) 1567; V. Goiffon et
    al., IEEE Electron Device Letters 32 (2011) 773"""
    separates = """take long series of darks at two exposures: the jumps grow with the exposure; those of
    rts_noise do not, and hot_pixels are constant"""
    differentiable = False
    why_not = "whether a pixel has a defect, and its state in a frame, are discrete; image and amplitude have gradients"
    density = Strength(
        0.002, "share of pixels", 0.0, 1.0, "1e-4 when new to 1e-1 after a mission", trials=(0.002, 0.02)
    )
    amplitude_e_per_s = Parameter(
        50.0, "e-/s", 0.0, 1e7, "mean at 20 C; exponential in Goiffon et al.", trials=(20.0, 100.0)
    )
    b_per_c = Parameter(0.077, "1/C", 0.0, 0.3, "0.57 eV (Hopkins and Hopkinson): E / (k T^2) at 20 C")
    duty = Parameter(0.5, "1", 0.0, 1.0, "fraction of the time in the upper level; 1: hot pixels")
    kept = Parameter(0.8, "1", 0.0, 0.99, "seconds to days (Hopkins and Hopkinson)", trials=(0.0, 0.8))
    special_cases = (({"duty": 1.0}, "hot_pixels"), ({"kept": kept.high}, "hot_pixels"))  # hardly any jumps

    def apply(self, signal, p, stream, context):
        fixed = stream.fixed
        places = fixed.fork("where").uniform(), fixed.fork("amplitude").uniform()
        has_defect = places[0] < p.density
        amplitude = -torch.log(places[1]) * has_defect
        if context.sequence:
            state = kept_states(self.name, has_defect, places, p, stream.fork("state").keys, context)
        else:
            state = (stream.fork("state").uniform() < p.duty).to(signal.dtype)
        return add_dark_electrons(signal, self._mean_e(p, context) * amplitude * state, stream, context)

    def moments(self, mean, p, context):
        rate = self._mean_e(p, context)
        shift = p.density * p.duty * rate
        return mean + shift, 2 * p.density * p.duty * rate**2 - shift**2

    @staticmethod
    def _mean_e(p, context):
        heating = torch.exp(p.b_per_c * (context.temperature_c - REFERENCE_C))
        return context.exposure_s * p.amplitude_e_per_s * heating
