"""Random telegraph signal."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice
from visaug.effects.telegraph import kept_states


class RTSNoise(Effect):
    """A trap next to the source follower of a pixel captures and releases an electron, which shifts the voltage.

    Traps that switch much faster than the frame rate have an independent random state in each frame; slower ones keep their
    state from frame to frame with the probability `kept`. Correlated double sampling subtracts two states of fast traps and
    gives three levels, -A, 0 and A; a trap that keeps its state from frame to frame has the same in both and does not show.
    """

    name = "rts_noise"
    stage = Stage.READOUT
    order = 55
    aliases = ("RTS", "RTN", "random telegraph noise", "blinking pixels", "salt and pepper", "popcorn noise")
    summary = "A few pixels jump between discrete levels from frame to frame."
    equation = """V <- V + A_pixel s, s in {0, 1} with P(1) = duty, s_k = s_(k-1) with probability kept, else
    drawn anew; three levels: s = s_1 - s_2, both drawn anew in each frame"""
    source = """X. Wang et al., Random telegraph signal in CMOS image sensor pixels, IEDM 2006; EMVA 1288
    release 4 General"""
    separates = """take a long series of dark frames: single pixels jump between levels; hot_pixels and dsnu
    are constant; cosmic_rays occur once"""
    differentiable = False
    why_not = """whether a pixel has a trap, and its state in a frame, are discrete; the image and the
    amplitude have gradients"""
    density = Strength(
        0.003, "share of pixels", 0.0, 1.0, "0.1 to 1 % of CMOS pixels (Wang et al.)", trials=(0.001, 0.01)
    )
    amplitude_e = Parameter(
        15.0, "e-", 0.0, 1e4, "mean; a few to tens of electrons (Wang et al.)", trials=(10.0, 30.0)
    )
    duty = Parameter(0.5, "1", 0.0, 1.0, "fraction of the time in the upper level", trials=(0.2, 0.5))
    kept = Parameter(
        0.0,
        unit="1",
        high=0.99,
        trials=(0.0, 0.5),
        source="time constants vary by decades (Wang et al.): some traps are slower than the frame rate",
        of=("two",),
    )
    amplitudes = choice(("exponential", "equal"), "exponential in Wang et al., fig. 5")
    levels = choice(("two", "three"), "three with correlated double sampling")

    def apply(self, signal, p, stream, context):
        fixed = stream.fixed
        places = fixed.fork("trap").uniform(), fixed.fork("amplitude").uniform()
        has_trap = places[0] < p.density
        amplitude = p.amplitude_e * has_trap
        if p.amplitudes == "exponential":
            amplitude = -amplitude * torch.log(places[1])
        if p.levels == "two" and context.sequence:
            state = kept_states(self.name, has_trap, places, p, stream.keys, context)
        else:
            state = (stream.uniform() < p.duty).to(signal.dtype)
        if p.levels == "three":
            state = state - (stream.fork("second sample").uniform() < p.duty).to(signal.dtype)
        return signal + amplitude * state

    def moments(self, mean, p, context):
        square = p.amplitude_e**2 * (2 if p.amplitudes == "exponential" else 1)
        if p.levels == "three":
            return mean, p.density * square * 2 * p.duty * (1 - p.duty)
        shift = p.density * p.duty * p.amplitude_e
        return mean + shift, p.density * p.duty * square - shift**2
