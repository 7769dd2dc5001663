"""Noise of arms and of images, beside figures that are known."""

import json

import cv2
import numpy as np
import pytest
import torch
from torch import nn

from visaug_train.speed import read_poses
from visaug_train.strength import NoiseStrength, Strengths, carried, strength_of


class Known(nn.Module):
    """White noise of 3 and rows of 4 steps of 255."""

    def forward(self, images):
        white = 3 * torch.randn_like(images)
        return images + (white + 4 * torch.randn(*images.shape[:3], 1)) / 255


def test_an_arms_noise_and_its_white_part_are_measured():
    """24 images of 96 rows: 3 % for the rows' share of the total, below 1 % for the white part."""
    strength = strength_of(Known(), (96, 96))
    assert strength.total["20 %"] == pytest.approx(5, rel=0.1)
    assert strength.white["20 %"] == pytest.approx(3, rel=0.03)


def test_noise_of_images_is_found_beside_gradients_rows_and_edges(tmp_path):
    """Smooth levels, rows and a few edges; white noise of 2 in the dark part and 6 in the bright one."""
    rng = np.random.default_rng(5)
    (tmp_path / "synthetic" / "images").mkdir(parents=True)
    camera = {"Nu": 240, "Nv": 150, "cameraMatrix": [[350, 0, 120], [0, 350, 75], [0, 0, 1]]}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    records = []
    for i in range(6):
        level = np.linspace(40, 62, 240) + np.zeros((150, 1))
        level[:, 120:] = np.linspace(115, 140, 120)
        level += 5 * rng.standard_normal((150, 1))
        level[60:66, ::30] += 60
        sigma = np.where(np.arange(240) < 120, 2.0, 6.0)
        image = np.clip(np.rint(level + sigma * rng.standard_normal((150, 240))), 0, 255).astype(np.uint8)
        cv2.imwrite(str(tmp_path / "synthetic" / "images" / f"{i}.png"), image)
        records.append(
            {"filename": f"{i}.png", "q_vbs2tango_true": [1, 0, 0, 0], "r_Vo2To_vbs_true": [0, 0, 6]}
        )
    (tmp_path / "synthetic" / "test.json").write_text(json.dumps(records))
    found = carried(read_poses(tmp_path, "synthetic", "test"), (240, 150), "linear").total
    assert found["20 %"] == pytest.approx(np.hypot(2, 12**-0.5), rel=0.08)
    assert found["50 %"] == pytest.approx(np.hypot(6, 12**-0.5), rel=0.08)
    assert np.isnan(found["white"])


def made(vis):
    flat = dict.fromkeys(("black", "20 %", "50 %", "white"), 0.0)
    there = NoiseStrength(flat | {"black": 4.0, "20 %": 4.0, "50 %": 4.0, "white": float("nan")}, {})
    arms = {"baseline": NoiseStrength(flat, flat), "vis": NoiseStrength(flat | vis, flat)}
    return Strengths(there, {"lightbox": there}, arms, "baseline", ("vis",))


def test_an_arm_below_what_is_there_is_warned_of():
    """1.8 on top of 4 raises it by 10 % less a little; 2 by 12 %."""
    (warning,) = made({"20 %": 1.5, "50 %": 1.8}).warnings()
    assert warning.startswith("invisible arm: vis")
    assert not made({"50 %": 2.0}).warnings()
    table = made({"50 %": 2.0}).table()
    assert table.head == ["", "black", "20 %", "50 %", "white"]
    assert "none" in table.rows[0]
