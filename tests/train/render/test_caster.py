"""The ray-caster against closed forms, and hard shadows."""

import numpy as np
import pytest
import torch

from visaug_train.geometry import Pinhole
from visaug_train.render.caster import FAR, RayCaster, Views, nearest, reflect
from visaug_train.render.spacecraft import SceneTensors, box, spacecraft

CAMERA = Pinhole(64, 64, np.array([[100.0, 0, 32], [0, 100.0, 32], [0, 0, 1]]), np.zeros(5))


def looking_at(sun, fill=(0, 0, -1.0), sun_level=1.0, fill_level=0.0, distance=5.0):
    return Views(
        np.array([[1.0, 0, 0, 0]]),
        np.array([[0, 0, distance]]),
        np.array([sun]) / np.linalg.norm(sun),
        np.array([sun_level]),
        np.array([fill]),
        np.array([fill_level]),
    )


def scene(*parts):
    return SceneTensors.of(list(parts))


def test_ray_meets_the_near_face_of_a_box():
    one = scene(box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5), "white"))
    origin = torch.tensor([[0.0, 0, -3], [0.0, 2, -3], [3.0, 0.1, 0.2]])
    direction = torch.tensor([[0.0, 0, 1], [0.0, 0, 1], [-1.0, 0, 0]])
    distance, _, normal = nearest(one, origin, direction)
    assert distance.tolist() == pytest.approx([2.5, FAR, 2.5])
    assert normal[0].tolist() == [0, 0, -1]
    assert normal[2].tolist() == [1, 0, 0]


def test_matt_white_in_the_sun_has_radiance_of_its_albedo():
    flat = scene(box((-3, -3, 0.0), (3, 3, 0.1), "white"))
    image, cover = RayCaster(CAMERA, scene=flat).render(looking_at((0, 0, -1.0)))
    centre = image[0, 28:36, 28:36]
    # Lambert gives 0.8; Fresnel's mirror part of a rough surface adds a few per cent.
    assert 0.8 < float(centre.mean()) < 0.9
    slanted, _ = RayCaster(CAMERA, scene=flat).render(looking_at((1.0, 0, -1.0)))
    assert float(slanted[0, 28:36, 28:36].mean()) == pytest.approx(0.8 * 2**-0.5, rel=0.05)
    assert float(cover.max()) == 1.0


def test_light_is_linear_in_its_level():
    flat = scene(box((-3, -3, 0.0), (3, 3, 0.1), "foil"))
    once, _ = RayCaster(CAMERA, scene=flat).render(looking_at((0.3, 0, -1.0), fill_level=0.1))
    twice, _ = RayCaster(CAMERA, scene=flat).render(looking_at((0.3, 0, -1.0), sun_level=2, fill_level=0.2))
    torch.testing.assert_close(twice, 2 * once)


def test_a_body_throws_a_hard_shadow():
    parts = (box((-3, -3, 0.0), (3, 3, 0.1), "white"), box((-0.2, -0.2, -1.0), (0.2, 0.2, -0.8), "white"))
    image, _ = RayCaster(CAMERA, scene=scene(*parts)).render(looking_at((1.0, 0, -1.0)))
    # The plate stands 0.9 m before the wall and the sun comes from the right: its shadow falls 0.9 m to the left.
    shadow = CAMERA.project(np.array([[-0.9, 0.0, 5.0]]))[0].astype(int)
    assert float(image[0, shadow[1], shadow[0]]) == 0
    assert float(image[0, shadow[1], shadow[0] + 8]) > 0.4


def test_reflection_conserves_energy():
    """White furnace by quadrature: light from all sides never leaves brighter than it came."""
    rng = np.random.default_rng(0)
    light = rng.normal(size=(200_000, 3))
    light[:, 2] = np.abs(light[:, 2])
    light = torch.tensor(light / np.linalg.norm(light, axis=1, keepdims=True), dtype=torch.float32)
    normal = torch.tensor([0.0, 0, 1]).expand_as(light)
    for view_cosine in (1.0, 0.5, 0.2):
        view = torch.tensor([(1 - view_cosine**2) ** 0.5, 0, view_cosine]).expand_as(light)
        one = torch.ones(len(light))
        mirror = reflect(0 * one, 1.0 * one, 0.4 * one, normal, view, light)
        # Radiance under a unit sun is pi times BRDF times cosine: the half sky's mean of it is half the albedo.
        assert 0.35 < 2 * float(mirror.mean()) < 1.02


def test_parts_end_at_the_keypoints():
    tips = np.array([[-0.5427, 0.4877, 0.2535], [0.305, -0.579, 0.2515]])
    ends = [np.array(part.centre) + np.array(part.axes[2]) * part.half[2] for part in spacecraft()]
    assert all(min(np.linalg.norm(end - tip) for end in ends) < 1e-6 for tip in tips)
