"""Image lag."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage


class ImageLag(Effect):
    """A share of the charge stays in the photodiode and comes with the frames that follow; none is lost.

    Of what is held back, each frame gives 1 - decay: decay 0 empties it into the next frame, more makes a
    tail over several. An image on its own is one of a steady scene: as much comes as stays.
    """

    name = "image_lag"
    stage = Stage.CHARGE
    order = 10
    summary = "A share of the last frame's charge comes again."
    equation = "N_k <- (1 - share) N_k + (1 - decay) H_k, H_k = share N_(k-1) + decay H_(k-1)"
    source = "E. Fossum and D. Hondongwa, IEEE J. Electron Devices Soc. 2 (2014) 33, on incomplete transfer"
    separates = "a dark frame right after a bright one: lag decays in it, drift does not know the order"
    share = Parameter(
        0.01,
        unit="fraction",
        high=0.5,
        strength=True,
        trials=(0.01, 0.05),
        source="pinned photodiodes 0.1 %, others 5 %",
    )
    decay = Parameter(
        0.0, unit="fraction", high=0.99, trials=(0.0, 0.6), source="of the held charge, from frame to frame"
    )

    def apply(self, signal, p, stream, context):
        charge = torch.minimum(signal, context.full_well_e)  # what a pixel can hold
        held = self._held(p.share * context.previous(self.name, charge), p.decay, context)
        return signal + ((1 - p.decay) * held - p.share * charge)

    def _held(self, caught, decay, context):
        if not context.sequence:
            return caught / (1 - decay)
        key = f"{self.name}.held"
        held = context.memory.get(key, torch.zeros_like(caught[:1]))
        frames = []
        for fresh, keep in zip(caught.split(1), decay.expand(len(caught), -1, -1, -1).split(1)):
            held = fresh + keep * held
            frames.append(held)
        context.memory[key] = held.detach()
        return torch.cat(frames)
