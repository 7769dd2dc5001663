"""Light on its way to the sensor: drift, vignetting."""

import numpy as np
import torch

FLAT = torch.full((1, 1, 100, 120), 1000.0)


def test_white_drift_has_the_stated_spread_and_no_memory(run_effect):
    frames = torch.full((4000, 1, 2, 3), 1000.0)
    levels = run_effect("light_drift", frames, sequence=True, sigma=0.02)
    assert torch.equal(levels, levels[:, :, :1, :1].expand_as(levels))  # one factor a frame
    x = levels[:, 0, 0, 0].double().numpy() / 1000 - 1
    # 4000 draws, each figure within 4.5 of its standard errors: false alarms below 1e-4
    assert abs(x.mean()) < 4.5 * 0.02 / np.sqrt(4000)
    assert abs(x.std() / 0.02 - 1) < 4.5 / np.sqrt(2 * 4000)
    assert abs(np.corrcoef(x[1:], x[:-1])[0, 1]) < 4.5 / np.sqrt(4000)


def test_wandering_drift_keeps_its_spread_and_remembers_over_batches(run_effect):
    memory, batches = {}, []
    for start in range(0, 8000, 2000):
        frames = torch.full((2000, 1, 1, 1), 1.0)
        keys = list(range(start, start + 2000))
        batches.append(
            run_effect(
                "light_drift", frames, keys=keys, sequence=True, memory=memory, sigma=0.02, correlation=0.8
            )
        )
    x = torch.cat(batches).flatten().double().numpy() - 1
    effective = 8000 * (1 - 0.8**2) / (1 + 0.8**2)  # independent draws worth as much, for a variance
    assert abs(x.std() / 0.02 - 1) < 4.5 / np.sqrt(2 * effective)
    for lag in (1, 3):
        assert abs(np.corrcoef(x[lag:], x[:-lag])[0, 1] - 0.8**lag) < 4.5 * 2 / np.sqrt(8000)
    seam = x[1999:7999:2000] * 0.8  # the first frame of a batch goes on from the last of the one before
    assert np.abs(x[2000::2000] - seam).max() < 4.5 * 0.02 * 0.6


def test_drift_of_unrelated_images_is_one_draw_each(run_effect):
    images = torch.ones(3, 1, 2, 2)
    a = run_effect("light_drift", images, keys=[5, 6, 7], sigma=0.1, correlation=0.9)
    b = run_effect("light_drift", images[:1], keys=[7], sigma=0.1, correlation=0.2)
    assert torch.equal(a[2:], b)


def test_vignetting_falls_as_the_power_of_the_distance(run_effect):
    out = run_effect("vignetting", FLAT, corner_loss=0.3, power=4.0)
    y, x = np.mgrid[0.5:100, 0.5:120]
    r = np.hypot(y - 50, x - 60) / np.hypot(50, 60)
    np.testing.assert_allclose(out[0, 0].numpy(), 1000 * (1 - 0.3 * r**4), rtol=1e-5)


def test_vignetting_follows_the_cosine_law(run_effect):
    """cos^4 of the field angle; its first term, 1 - 2 tan^2, is a small field's: at 10 degrees the next one is 0.3 %."""
    y, x = np.mgrid[0.5:100, 0.5:120]
    for degrees, words, tolerance in ((10, {}, 4e-3), (40, {"law": "cos4"}, 1e-5)):
        corner = np.tan(np.deg2rad(degrees))
        angle = np.arctan(np.hypot(y - 50, x - 60) / np.hypot(50, 60) * corner)
        loss = 1 - np.cos(np.deg2rad(degrees)) ** 4 if words else 2 * corner**2
        out = run_effect("vignetting", FLAT, corner_loss=loss, **words)
        np.testing.assert_allclose(out[0, 0].numpy(), 1000 * np.cos(angle) ** 4, rtol=tolerance)


def test_vignetting_belongs_to_the_sensor_not_to_the_crop(run_effect):
    whole = run_effect("vignetting", FLAT, centre_row=0.1)
    part = run_effect(
        "vignetting",
        FLAT[..., 30:70, 5:45],
        window=(range(30, 70), range(5, 45)),
        resolution=(100, 120),
        centre_row=0.1,
    )
    torch.testing.assert_close(part, whole[..., 30:70, 5:45])
    assert whole[0, 0, :, 60].argmax() in (59, 60)  # the axis lies 0.1 of the rows below the centre
