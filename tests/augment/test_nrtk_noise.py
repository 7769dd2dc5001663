"""The NRTK adapter against the released interface (1.x); skipped where NRTK is not installed."""

import json

import numpy as np
import pytest

pytest.importorskip("nrtk.interfaces", exc_type=ImportError)

from nrtk.interfaces import PerturbImage

from visaug import Camera, InputError
from visaug.augment.nrtk_noise import CameraPerturber

IMAGE = np.full((40, 60), 128, np.uint8)


def test_it_keeps_the_contract_of_a_perturber() -> None:
    """Shape, type, the input and the boxes stay; the noise is there; a seed repeats it."""
    boxes = [("a box", {"satellite": 1.0})]
    perturber = CameraPerturber("sony_imx174", gain_db=24.0, seed=3)
    assert isinstance(perturber, PerturbImage)
    noisy, kept = perturber(image=IMAGE, boxes=boxes)
    assert (noisy.shape, noisy.dtype) == (IMAGE.shape, IMAGE.dtype)
    assert (IMAGE == 128).all()
    assert noisy.std() > 1
    assert kept == boxes
    np.testing.assert_array_equal(perturber(image=IMAGE)[0], noisy)


def test_its_configuration_makes_it_again() -> None:
    perturber = CameraPerturber("sony_imx174", gain_db=24.0, exposure=0.1, seed=3)
    again = CameraPerturber.from_config(json.loads(json.dumps(perturber.get_config())))
    np.testing.assert_array_equal(again(image=IMAGE)[0], perturber(image=IMAGE)[0])
    assert CameraPerturber in PerturbImage.get_impls()


def test_a_camera_that_no_configuration_can_hold_is_refused() -> None:
    """Of a `Camera` it would hold a text that names none."""
    for camera in (Camera.load("sony_imx174"), ["sony_imx174"], None):
        with pytest.raises(InputError, match=r"camera: is a .*; expected a camera file or the name"):
            CameraPerturber(camera)


def test_the_gain_in_db_is_the_cameras() -> None:
    """20 dB more are a tenth of the electrons: shot noise grows by the root of ten, here to within 15 %.

    20 images of 2400 pixels: the ratio's standard deviation is below 1 %; read noise and the 8-bit steps take the rest.
    """
    spread = [
        np.std([CameraPerturber("sony_imx174", gain_db=g, seed=i)(image=IMAGE)[0] for i in range(20)])
        for g in (10, 30)
    ]
    assert spread[1] / spread[0] == pytest.approx(10**0.5, rel=0.15)
