"""The lightbox-like camera in the laboratory: its data sheet states its base chain and its frames are its own."""

import numpy as np
import pytest

import visaug
from visaug_train.demo import BIASES, FLATS, LEVELS, data_sheet, take_frames
from visaug_train.render.independent_camera import LIGHTBOX_CAMERA

SHAPE = (64, 96)


def test_frames_without_structure_have_the_moments_of_the_data_sheet():
    """EMVA's relations on the camera without its structured effects: mean and temporal variance of a flat. 6144 pixels
    and six frames know the mean to 0.1 % and the variance to 1 %.
    """
    camera = LIGHTBOX_CAMERA.without_effects()
    sheet = visaug.Camera.load(data_sheet(camera, "x", SHAPE)).spec
    frames = take_frames(camera, SHAPE)
    records = frames.records
    assert sum(record.kind == "bias" for record in records) == BIASES
    level = LEVELS[1] * sheet.full_well_e
    flats = [
        i
        for i, record in enumerate(records)
        if record.photons == pytest.approx(level / sheet.quantum_efficiency)
    ]
    assert len(flats) == FLATS
    dn = np.stack([frames.read(i) for i in flats]).astype(float)
    assert dn.mean() - sheet.black_level_dn == pytest.approx(level / sheet.gain_e_per_dn, rel=0.02)
    variance_e = (dn.var(axis=0, ddof=1).mean() - 1 / 12) * sheet.gain_e_per_dn**2
    assert variance_e == pytest.approx(level + sheet.read_noise.sigma_e**2, rel=0.05)


def test_the_data_sheet_is_silent_about_structure():
    assert "effects" not in data_sheet(LIGHTBOX_CAMERA, "x", SHAPE)
    rows = np.stack([take_frames(LIGHTBOX_CAMERA, SHAPE).read(i).mean(axis=1) for i in range(4)])
    assert rows.std(axis=1).min() > 18 / np.sqrt(2) / LIGHTBOX_CAMERA.e_per_dn * 0.8  # a sine of 18 e-
