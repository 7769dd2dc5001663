"""The real frames that come with the package, and what is shown of them."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import visaug
from visaug.frames import FrameRecord, FrameSet
from visaug.report.real_camera import FOLDER, difference, load_real_camera, real_camera_section, sensor_curves


def records() -> list[FrameRecord]:
    """Pairs of flats and darks at three exposures, then a stack of 16 darks."""
    rows = [
        FrameRecord(0, "", kind, exposure, photons=level if kind == "flat" else None)
        for exposure, level in ((0.01, 100.0), (0.02, 200.0), (0.03, 300.0))
        for kind in ("flat", "flat", "dark", "dark")
    ] + [FrameRecord(0, "", "dark", 0.015) for _ in range(16)]
    return [FrameRecord(i, f"{i}.npy", r.kind, r.exposure_s, photons=r.photons) for i, r in enumerate(rows)]


def frames(row_sigma: float = 0.0, alternate_sigma: float = 0.0, seed: int = 0) -> FrameSet:
    """Gaussian frames with known parts, written here: 3 DN of pixel noise, variance 9 + 0.5 mean."""
    rng = np.random.default_rng(seed)
    shape = (96, 128)
    plan = records()
    stack = []
    for record in plan:
        mean = record.photons or 0.0
        frame = 500 + mean + rng.normal(0, (9 + 0.5 * mean) ** 0.5, shape)
        frame += rng.normal(0, row_sigma, (shape[0], 1)) if row_sigma else 0
        frame += (
            rng.normal(0, alternate_sigma, (shape[0], 1)) * (-1.0) ** np.arange(shape[1])
            if alternate_sigma
            else 0
        )
        stack.append(frame.astype(np.float32))
    return FrameSet.from_arrays(plan, stack)


def test_photon_transfer_and_dark_noise():
    """Variance is chi-square with 12288 degrees of freedom: 1.3 % each; four deviations are allowed."""
    curves = sensor_curves(frames())
    assert curves.mean_dn == pytest.approx([100, 200, 300], abs=0.5)
    assert curves.variance_dn2 == pytest.approx(9 + 0.5 * np.array([100, 200, 300]), rel=0.052)
    assert curves.dark_noise_dn == pytest.approx(3.0, rel=0.02)
    assert curves.counts.sum() == 16 * 96 * 128


def test_row_spectrum_shows_what_rows_share_and_what_alternates():
    """White: 1 everywhere. Row noise s: 1 + 128 s²/9 at 0. Alternation s: the same at half the sampling."""
    white, rows, alternate = (sensor_curves(frames(*sigmas)) for sigmas in ((0, 0), (1, 0), (0, 1)))
    # the mean of 16 x 96 exponential powers: 2.6 %; half that again for the frame mean that is taken off
    assert white.row_power == pytest.approx(np.ones(65), abs=0.2)
    assert rows.row_noise == pytest.approx(1 + 128 / 9, rel=0.15)
    assert rows.half_sampling == pytest.approx(1, abs=0.2)
    assert alternate.half_sampling == pytest.approx(1 + 128 / 9, rel=0.15)
    assert alternate.row_noise == pytest.approx(1, abs=0.2)


def test_the_sentence_names_what_differs_and_nothing_else():
    plain = sensor_curves(frames())
    assert "nothing else" in difference(sensor_curves(frames(seed=1)), plain)
    said = difference(sensor_curves(frames(row_sigma=1, seed=1)), plain)
    assert "row" in said
    assert "half the sampling" not in said
    assert "half the sampling" in difference(sensor_curves(frames(alternate_sigma=1, seed=1)), plain)


def test_shipped_frames_are_small_and_carry_their_licence():
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 8e6
    licence = (FOLDER / "LICENSE").read_text()
    for piece in ("Basler AG", "Marco Grimm", "ShareAlike 3.0", "creativecommons.org/licenses/by-sa/3.0"):
        assert piece in licence


def test_shipped_frames_are_those_of_the_reference_set(shared_data):
    source = shared_data / "emva1288_ccd12" / "images"
    camera, shipped = load_real_camera()
    assert isinstance(camera, visaug.Camera)
    first, last = (
        np.asarray(Image.open(source / name)) for name in ("b_000_snap_001.png", "d_s_000_snap_023.png")
    )
    assert (shipped.read(0) == first[144:336, 192:448]).all()
    assert (shipped.read(len(shipped) - 1) == last[144:336, 192:448]).all()


def test_the_section_says_what_this_camera_has():
    section = real_camera_section()
    said = section.blocks[1].text
    assert said.startswith("Photon transfer agrees")
    assert "row" in said
    assert "half the sampling" in said
    assert sum(hasattr(block, "uri") for block in section.blocks) == 4
    assert Path(FOLDER, "frames.csv").exists()
