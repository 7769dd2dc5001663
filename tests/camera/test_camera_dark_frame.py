"""The paper's dark frame, 0.5 s at 30 C, against densities convolved by quadrature: theory that shares no code."""

import numpy as np
import pytest
import torch
from paper_model import dark_law

from visaug.camera import Camera
from visaug.core.sampling import Stream, derive_key

SENSORS, ROWS, COLUMNS = 64, 32, 640


@pytest.mark.parametrize("meaning", ["standard_deviation", "scale"])
@pytest.mark.parametrize("reading", ["physical", "paper"])
def test_mean_and_deviation_of_the_clipped_dark_frame(meaning, reading):
    """64 sensors of 640 columns. The columns' scatter, 2.82 e-, rules the mean's error: 5 standard errors.

    Heavy tails (a Tukey-lambda of shape -0.23 has an excess kurtosis of 58) rule the deviation's: 3 %.
    """
    camera = Camera.load("flir_cm3_u3_13y3c").replace({"reading": reading, "read_noise.meaning": meaning})
    keys = [derive_key(i) for i in range(SENSORS)]
    stream = Stream(keys, keys, 1, (range(ROWS), range(COLUMNS)))
    dark = camera.expose(
        torch.zeros(SENSORS, 1, ROWS, COLUMNS), stream, {"exposure_s": 0.5, "temperature_c": 30.0}
    )
    electrons = dark.double().numpy() * camera.spec.gain_e_per_dn
    law = dark_law(accurate=False, meaning=meaning, rounded=reading == "paper")
    error = np.hypot(2.82 / np.sqrt(SENSORS * COLUMNS), law.deviation_e / np.sqrt(electrons.size))
    assert electrons.mean() == pytest.approx(law.mean_e, abs=5 * error)
    assert electrons.std() == pytest.approx(law.deviation_e, rel=0.03)


def test_the_ratio_that_table_1_speaks_to():
    """Mean over deviation needs no gain: 65.4 / sqrt(3736.9) = 1.07 lies between the two meanings of sigma_read."""
    as_deviation, as_scale = (dark_law(False, meaning) for meaning in ("standard_deviation", "scale"))
    published = 65.4 / np.sqrt(3736.9)
    assert as_scale.mean_e / as_scale.deviation_e < published < as_deviation.mean_e / as_deviation.deviation_e
