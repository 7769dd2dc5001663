"""The test cameras share no code with the package, and do what they say."""

import ast
import inspect
from dataclasses import replace

import numpy as np

from visaug_train.render import independent_camera
from visaug_train.render.independent_camera import LIGHTBOX_CAMERA, SUNLAMP_CAMERA, IndependentCamera

PLAIN = IndependentCamera(pixel_gain=0, pixel_offset_e=0, column_offset_e=0)


def test_it_imports_nothing_but_numpy():
    tree = ast.parse(inspect.getsource(independent_camera))
    names = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert set(names) == {"numpy", "dataclasses"}


def test_base_chain_has_its_mean_and_variance():
    photons = np.full((400, 400), 400.0)
    dn = PLAIN.expose(photons, np.random.default_rng(0)).astype(float)
    mean_e, variance_e = 0.55 * 400, 0.55 * 400 + 3.0**2 + 0.5**2 / 12
    # 160,000 pixels: standard error of the mean 0.04 e-; of the variance about 0.5 % (heavy tails); 5 of them.
    assert abs((dn.mean() - 64) * 0.5 - mean_e) < 0.2
    assert abs(dn.var() * 0.25 / variance_e - 1) < 0.03


def test_banding_and_taps():
    dark = np.zeros((190, 100))
    banded = replace(PLAIN, row_banding_e=20, black_level_dn=200)
    rows = banded.expose(dark, np.random.default_rng(1)).mean(axis=1)
    spectrum = np.abs(np.fft.rfft(rows - rows.mean()))
    assert spectrum.argmax() == 10  # a period of 19 rows
    two = replace(PLAIN, tap_offset_e=30).expose(dark, np.random.default_rng(2)).astype(float)
    assert abs((two[:, 50:].mean() - two[:, :50].mean()) * 0.5 - 30) < 0.5


def test_charge_above_the_well_spills_along_its_column():
    photons = np.zeros((60, 40))
    photons[30, 20] = 10 * PLAIN.full_well_e / PLAIN.quantum_efficiency
    dn = replace(PLAIN, bloom_share=0.9).expose(photons, np.random.default_rng(3)).astype(int)
    assert dn[28, 20] > 3000
    assert dn[32, 20] > 3000
    assert dn[30, 18] < 100


def test_flare_adds_a_halo_and_a_mirrored_ghost():
    photons = np.zeros((100, 160))
    photons[20:24, 30:34] = 4 * PLAIN.full_well_e / PLAIN.quantum_efficiency
    quiet = replace(PLAIN, read_noise_e=0.01)
    dn = replace(quiet, flare_share=0.3).expose(photons, np.random.default_rng(4)).astype(float)
    assert dn[30, 40] > quiet.expose(photons, np.random.default_rng(4))[30, 40] + 8
    ghost = dn[65:75, 110:118].mean()  # mirrored at the centre (49.5, 79.5) by -0.7
    assert ghost > dn[65:75, 60:68].mean() + 8


def test_domain_cameras_have_two_effects_each_and_can_do_without():
    for camera, names in (
        (LIGHTBOX_CAMERA, {"row_banding_e", "tap_gain", "tap_offset_e"}),
        (SUNLAMP_CAMERA, {"bloom_share", "flare_share"}),
    ):
        bare = camera.without_effects()
        changed = {k for k in vars(camera) if getattr(camera, k) != getattr(bare, k)}
        assert changed == names
