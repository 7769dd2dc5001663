"""Image lag."""

import torch

from visaug.effects.effect import Effect, Parameter, Stage


class ImageLag(Effect):
    """A share of the charge stays in the photodiode and comes with the frames that follow; none is lost.

    Each electron stays or goes on its own: the count that stays is binomial, here in its mean and variance. Below saturation a
    steady scene therefore keeps its Poisson noise; a full well, which has none, gets what the parting brings.

    Of what is held back, each frame gives 1 - decay: decay 0 empties it into the next frame, more makes a tail over several. An
    image on its own is one of a steady scene: as much comes as stays.
    """

    name = "image_lag"
    stage = Stage.CHARGE
    order = 75  # what was collected is transferred
    summary = "A share of the last frame's charge comes again."
    equation = (
        "W_k = min(N_k + (1 - decay) H_k, full well), L_k ~ Binomial(W_k, share), "
        "N_k <- W_k - L_k, H_(k+1) = decay H_k + L_k"
    )
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
    saturates = Parameter(
        "diode",
        options=("diode", "node"),
        source="which is full first: the photodiode, before the transfer, or the node that is read, after it",
    )

    def apply(self, signal, p, stream, context):
        most = torch.where(
            p.share > 0, context.full_well_e, torch.inf
        )  # at zero strength nothing is clipped here
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
