"""Image lag."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice


class ImageLag(Effect):
    """A fraction of the charge stays in the photodiode and is read with the following frames; none is lost.

    Each electron stays independently, so the retained count is binomial; its mean and variance are reproduced. Below
    saturation, a constant scene keeps its Poisson noise; a full well has no noise and gets that of the binomial split.

    Each frame releases 1 - decay of the retained charge: with decay 0 all of it is read with the next frame, larger values
    give a tail over several frames. A single image is taken from a constant scene: gain and loss are equal.
    """

    name = "image_lag"
    stage = Stage.CHARGE
    order = 75  # what was collected is transferred
    stepwise = True
    aliases = ("ghosting", "persistence", "residual image", "RBI", "after-image", "sticking")
    summary = "A fraction of the charge of a frame appears in the following frames."
    equation = """W_k = min(N_k + (1 - decay) H_k, full well), L_k ~ Binomial(W_k, share), N_k <- W_k - L_k,
    H_(k+1) = decay H_k + L_k"""
    source = "E. Fossum and D. Hondongwa, IEEE J. Electron Devices Soc. 2 (2014) 33, on incomplete transfer"
    separates = """take a dark frame directly after a bright one: lag appears in it and decays; drift is
    independent of the preceding frame"""
    share = Strength(0.01, "fraction", 0.0, 0.5, "pinned photodiodes 0.1 %, others 5 %", trials=(0.01, 0.05))
    decay = Parameter(
        0.0, "fraction", 0.0, 0.99, "of the retained charge, from frame to frame", trials=(0.0, 0.6)
    )
    saturates = choice(
        ("diode", "node"),
        "which saturates first: the photodiode before the transfer, or the sense node after it",
    )

    def apply(self, signal, p, stream, context):
        # at zero strength nothing is clipped here
        most = torch.where(p.share > 0, context.full_well_e, torch.inf)
        if not context.sequence:
            return signal if p.saturates == "node" else torch.minimum(signal, (1 - p.share) * most)
        key = f"{self.name}.held"
        held = context.memory.get(key, torch.zeros_like(signal[:1]))
        share, decay, most = (value.expand(len(signal), -1, -1, -1) for value in (p.share, p.decay, most))
        frames = []
        for k, collected in enumerate(signal.split(1)):
            full, comes = most[k], (1 - decay[k]) * held
            stored = torch.minimum(collected, full) + comes
            if p.saturates == "diode":
                goes = stored = stored.minimum(full)
            else:
                goes = collected + comes
            stays = _share_of(stored, share[k], stream.image(k))
            frames.append(goes - stays)
            held = decay[k] * held + stays
        context.memory[key] = held.detach()
        return torch.cat(frames)


def _share_of(count, share, stream):
    """With the mean and the variance of a binomial count, share (1 - share) count: a Poisson count, drawn to its mean.

    Never more than there is; of a few electrons and a large share that takes a little from the mean.
    """
    mean = share * count
    return torch.minimum(mean + torch.sqrt(1 - share) * (stream.poisson(mean) - mean), count)
