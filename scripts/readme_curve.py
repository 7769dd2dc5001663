"""Make the README's curve of a diagnosis: python scripts/readme_curve.py BETTER.yaml docs/pictures/diagnosis_curve.png

BETTER.yaml is what `visaug diagnose` wrote for the example frames. The variance of the mean of n pixels of a column, from
differences of bias frames, falls as 1/n where pixels are independent; a noise of whole columns stays.
"""

import sys
from pathlib import Path

import visaug
from visaug.report.plots.style import MEASURED, MODELLED, THIRD, blank, styled

COUNTS = (1, 2, 4, 8, 16, 32, 64)


def variances_e2(frames: visaug.FrameSet, gain_e_per_dn: float) -> list[float]:
    """Temporal variance of the means of n rows, e-^2, for each of COUNTS: pairs of bias frames."""
    bias = [i for i, record in enumerate(frames.records) if record.kind == "bias"]
    stack = frames.read_many(bias).astype(float)
    differences = stack[0::2] - stack[1::2]
    count, rows, columns = differences.shape
    return [
        float(differences.reshape(count, rows // n, n, columns).mean(2).var() / 2) * gain_e_per_dn**2
        for n in COUNTS
    ]


def main(better: Path, output: Path) -> None:
    frames = visaug.FrameSet.load(visaug.data.example_frames())
    sheet, found = visaug.Camera.load(visaug.data.example_camera()), visaug.Camera.load(better)
    gain = found.spec.gain_e_per_dn
    with styled():
        figure = blank(6.4, 3.6)
        axes = figure.subplots()
        for camera, name, colour in ((sheet, "data sheet", MODELLED), (found, "with column_noise", THIRD)):
            axes.loglog(
                COUNTS, variances_e2(visaug.simulate(camera, frames, seed=0), gain), color=colour, label=name
            )
        axes.loglog(COUNTS, variances_e2(frames, gain), "o", color=MEASURED, label="measured")
        axes.set(
            xlabel="pixels of a column in the mean",
            ylabel="temporal variance, e-²",
            title="Bias frames: the mean of a column is noisier than its pixels tell",
        )
        axes.set_xticks(COUNTS, [str(n) for n in COUNTS], minor=False)
        axes.minorticks_off()
        axes.legend()
        figure.savefig(output, dpi=130)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
