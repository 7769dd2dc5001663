"""docs/chain.md: the order of the chain, and the physical and the paper's reading in numbers."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image

from visaug.camera import Camera
from visaug.effects import Effect
from visaug.sampling import Stream

SIDE, FRAMES = 128, 16
LEVELS = [0.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0]
COLOURS = {"physical": "#1f5fa8", "paper": "#c0562b"}


def frames(reading: str, photons: float, **given) -> np.ndarray:
    """(B, H, W) DN of a camera without fixed patterns."""
    content = {
        "resolution": [SIDE, SIDE], "reading": reading, "quantum_efficiency": 0.4, "gain_e_per_dn": 0.5,
        "black_level_dn": 100, "read_noise": {"sigma_e": 2.4}, **given,
    }  # fmt: skip
    stream = Stream(range(FRAMES), [1] * FRAMES, 1, (range(SIDE), range(SIDE)))
    light = torch.full((FRAMES, 1, SIDE, SIDE), photons)
    return Camera.load(content).expose(light, stream).squeeze(1).double().numpy()


def write(docs: Path, effects: list[type[Effect]]) -> None:
    """Writes chain.md with its figure."""
    curves = {}
    for reading in COLOURS:
        stacks = [frames(reading, photons) for photons in LEVELS]
        means = np.array([stack.mean() for stack in stacks])
        curves[reading] = means, np.array([stack.var(axis=0, ddof=1).mean() for stack in stacks])
    fine = {reading: frames(reading, 0.0, gain_e_per_dn=0.19) for reading in COLOURS}
    (docs / "figures").mkdir(exist_ok=True)
    _figure(docs / "figures" / "readings.png", curves, fine)
    (docs / "chain.md").write_text(_text(effects, curves, fine))


def _figure(path: Path, curves, fine) -> None:
    figure, (transfer, codes) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for reading, (means, variances) in curves.items():
        transfer.loglog(means - 100 + 1, variances, "o-", ms=4, color=COLOURS[reading], label=reading)
        counts = np.bincount(fine[reading].astype(int).ravel(), minlength=160)[70:131]
        codes.step(np.arange(70, 131), counts / 1000, where="mid", color=COLOURS[reading], label=reading)
    transfer.set(
        xlabel="mean above black level + 1, DN",
        ylabel="variance in time, DN²",
        title="Photon transfer, QE 0.4",
    )
    codes.set(xlabel="DN", ylabel="thousand pixels", title="Codes of a bias frame at 0.19 e-/DN")
    for axis in (transfer, codes):
        axis.legend(frameon=False)
    figure.savefig(path, dpi=90)
    plt.close(figure)
    Image.open(path).convert("RGB").quantize(32).save(path, optimize=True)


def _text(effects: list[type[Effect]], curves, fine) -> str:
    order = []
    for effect in effects:
        if effect.base:
            link = f"[{effect.name}](effects/{effect.name}.md)"
            order.append(f"| {effect.stage.name.lower()} | {effect.order} | {link} | `{effect.equation}` |")
    slopes = {r: (v[-1] - v[0]) / (m[-1] - m[0]) for r, (m, v) in curves.items()}
    table = [
        f"| {photons:g} | {pm:.1f} | {pv:.1f} | {qv:.1f} | {pv / qv:.2f} |"
        for photons, pm, pv, qv in zip(LEVELS, *curves["physical"], curves["paper"][1])
    ]
    comb = {r: _comb(stack) for r, stack in fine.items()}
    return f"""# The chain

A camera turns mean photons per pixel into DN. Effects act in the order of physics, and nothing else
decides it: stage by stage (optics, generation, charge, readout, digital, picture), within a stage in rising
`order`. The order matters: light that is spread by a lens has white noise, charge that is shared by
pixels has not; the sum of two Poisson counts is one Poisson count of the summed mean, so photo-
electrons and dark electrons share one draw; a full well clips charge, noise of the amplifier comes
after it. Frames of a frame set end at the converter; effects of stage picture act on the developed picture
that augmentation gives, and a [colour camera](colour.md) has its filters between optics and generation.

The base chain, always there ([all effects](effects/index.md) stand among these):

| stage | order | effect | law |
| --- | --- | --- | --- |
{chr(10).join(order)}

## Two readings

`reading: physical`, the default, is the linear model of EMVA 1288 (release 4 Linear):

    mu_y      = K (eta mu_p + mu_d) + black level
    sigma_y^2 = K^2 (sigma_d^2 + eta mu_p + mu_d) + 1/12,    K = 1 / gain_e_per_dn

`reading: paper` follows the paper's eqs. 7 to 13 to the letter. It differs in four places:

| | physical | paper |
| --- | --- | --- |
| shot noise | electrons: Poisson of mean QE mu_p | photons: Poisson of mean mu_p, then times QE |
| dark current | joins the mean before the one Poisson draw | a Poisson draw of its own, after PRNU |
| before the converter | a voltage, not rounded | electrons, read noise included, are rounded |
| quantisation | rounding: 1/12 DN^2 | uniform noise of one DN, then rounding: 1/12 + 1/12 DN^2 |

so that its variance is

    sigma_y^2 = K^2 (sigma_read^2 + QE^2 mu_p + mu_d + 1/12) + 1/6

Detection selects photons at random, one by one, and a random selection of a Poisson count is again a
Poisson count. Multiplying a count by QE instead makes its variance too small by the factor QE. The mean
is the same in both.

![photon transfer and codes of both readings](figures/readings.png)

A camera of QE 0.4 and 0.5 e-/DN, {FRAMES} frames of {SIDE} x {SIDE} pixels a level:

| photons | mean, DN | variance, physical | variance, paper | ratio |
| --- | --- | --- | --- | --- |
{chr(10).join(table)}

The slope of variance over mean is {slopes["physical"]:.3f} DN in the physical reading, where it is K =
2 DN/e-, and {slopes["paper"]:.3f} DN in the paper's, QE times that: who measures the gain of such
frames by photon transfer finds {1 / slopes["paper"]:.2f} e-/DN in place of {1 / slopes["physical"]:.2f}.

Rounding electrons before a converter that resolves less than one electron leaves a comb: at 0.19 e-/DN
{comb["paper"]} of the 31 codes about the black level never come in a bias frame, {comb["physical"]} in the physical
reading.

## Gradients

Everything is differentiable but for five effects, which say why on their pages. A Poisson count N of
mean m passes 1 + (N - m) / (2 m), which is unbiased for the derivatives of the mean and of the second
moment; rounding passes the gradient unchanged, the derivative of the mean wherever noise spans a DN;
clipping passes none.
"""


def _comb(stack: np.ndarray) -> int:
    """How many of the 31 codes about the black level of 100 never come."""
    return int((np.bincount(stack.astype(int).ravel(), minlength=160)[85:116] == 0).sum())
