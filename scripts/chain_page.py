"""Generates docs/chain.md: the order of the chain, and a numerical comparison of the two readings."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image

from visaug.camera import Camera
from visaug.core.sampling import Stream
from visaug.effects import Effect

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

A camera converts mean photons per pixel to DN. Effects act in physical order: stage by stage (optics,
generation, charge, readout, digital, picture), and by increasing `order` within a stage. The order matters:

- A blur by the optics acts before shot noise, so the noise stays white; crosstalk between pixels acts after it
  and correlates the noise.
- The sum of two Poisson counts is a Poisson count of the summed mean, so photo-electrons and dark electrons
  share one draw.
- The full well clips the charge; read noise is added afterwards.

Frames of a frame set end at the converter. Effects of stage picture act on the developed picture, which is the
output of augmentation. The filters of a [colour camera](colour.md) act between optics and generation.

Every camera has the base chain. [Further effects](effects/index.md) are inserted by stage and order.

| stage | order | effect | law |
| --- | --- | --- | --- |
{chr(10).join(order)}

## Two readings

`reading: physical`, the default, is the linear model of EMVA 1288 (release 4 Linear):

    mu_y      = K (eta mu_p + mu_d) + black level
    sigma_y^2 = K^2 (sigma_d^2 + eta mu_p + mu_d) + 1/12,    K = 1 / gain_e_per_dn

`reading: paper` follows eqs. 7 to 13 of the paper literally. It differs in four places:

| | physical | paper |
| --- | --- | --- |
| shot noise | electrons: Poisson of mean QE mu_p | photons: Poisson of mean mu_p, then multiplied by QE |
| dark current | added to the mean before the Poisson draw | a separate Poisson draw, after PRNU |
| before the converter | a voltage, not rounded | electrons, including read noise, are rounded |
| quantisation | rounding: 1/12 DN^2 | uniform noise of one DN, then rounding: 1/12 + 1/12 DN^2 |

Its variance is therefore

    sigma_y^2 = K^2 (sigma_read^2 + QE^2 mu_p + mu_d + 1/12) + 1/6

Detection selects photons at random, and a random selection from a Poisson count is again a Poisson count.
Multiplying the count by QE instead gives a variance that is too small by the factor QE. The mean is the same in
both readings.

![photon transfer and codes of both readings](figures/readings.png)

A camera with QE 0.4 and 0.5 e-/DN, {FRAMES} frames of {SIDE} x {SIDE} pixels per level:

| photons | mean, DN | variance, physical | variance, paper | ratio |
| --- | --- | --- | --- | --- |
{chr(10).join(table)}

The slope of variance against mean is {slopes["physical"]:.3f} DN in the physical reading, which is K = 2 DN/e-, and
{slopes["paper"]:.3f} DN in the paper's reading, which is QE K. Photon transfer applied to frames of the paper's
reading therefore gives a gain of {1 / slopes["paper"]:.2f} e-/DN instead of {1 / slopes["physical"]:.2f}.

Rounding to electrons before a converter that resolves less than one electron leaves gaps in the histogram: at
0.19 e-/DN, {comb["paper"]} of the 31 codes around the black level do not occur in a bias frame, and
{comb["physical"]} in the physical reading.

## Gradients

All effects are differentiable except a few, whose pages give the reason. The gradient of a Poisson count N with
mean m is 1 + (N - m) / (2 m), which is unbiased for the derivatives of the mean and of the second moment.
Rounding passes the gradient unchanged, which is the derivative of the mean if the noise is wider than one DN.
Clipping passes no gradient.
"""


def _comb(stack: np.ndarray) -> int:
    """Number of the 31 codes around the black level of 100 that do not occur."""
    return int((np.bincount(stack.astype(int).ravel(), minlength=160)[85:116] == 0).sum())
