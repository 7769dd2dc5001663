"""A batched ray-caster in torch: linear radiance of a spacecraft in sunlight and in light from the Earth.

Radiance 1 is a white matt surface that the unit sun hits at a right angle. The sun is a point far away (hard
shadow, one shadow ray); the Earth and its like are a half sky of even light around a direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from visaug_train.geometry import Keypoints, Pinhole, project_targets, rotation_matrix
from visaug_train.render.spacecraft import SceneTensors, spacecraft

FAR = 1e9


@dataclass(frozen=True, eq=False)
class Views:
    """What to render, B images. Directions point from the target to the light, in the camera's frame, unit length.

    quaternions (B, 4), translations (B, 3) m, sun (B, 3), sun_level (B), fill (B, 3), fill_level (B).
    """

    quaternions: np.ndarray
    translations: np.ndarray
    sun: np.ndarray
    sun_level: np.ndarray
    fill: np.ndarray
    fill_level: np.ndarray

    def __len__(self) -> int:
        return len(self.quaternions)


def join(views: Sequence[Views]) -> Views:
    return Views(*map(np.concatenate, zip(*(vars(view).values() for view in views))))


class RayCaster:
    """Renders one scene through one camera with `samples` x `samples` rays a pixel; devices differ by rounding."""

    def __init__(
        self, camera: Pinhole, samples: int = 2, scene: SceneTensors | None = None, device: str = "cpu"
    ) -> None:
        self.camera, self.samples, self.device = camera, samples, torch.device(device)
        with self.device:
            self.scene = scene or SceneTensors.of(spacecraft())
        step = (np.arange(samples) + 0.5) / samples
        x = (np.arange(camera.width)[:, None] + step).ravel()
        y = (np.arange(camera.height)[:, None] + step).ravel()
        rays = camera.rays(np.stack(np.meshgrid(x, y), axis=-1))
        rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        self.rays = torch.tensor(rays, dtype=torch.float32, device=self.device)

    @torch.no_grad()
    def render(self, views: Views) -> tuple[Tensor, Tensor]:
        """Radiance (B, height, width) and the share of each pixel that the target covers, the same shape, on the CPU."""
        with self.device:
            camera, s = self.camera, self.samples
            turns = rotation_matrix(views.quaternions)
            directions, origins, owners, places = self._rays_at_targets(views)
            radiance = torch.zeros(len(views) * camera.height * camera.width)
            covered = torch.zeros_like(radiance)
            sun, fill = (
                torch.tensor(np.einsum("bij,bi->bj", turns, light * level[:, None]), dtype=torch.float32)
                for light, level in ((views.sun, views.sun_level), (views.fill, views.fill_level))
            )  # vectors in each body's frame, whose length is the level
            # rays at a time: few enough to stay in a processor's cache; a GPU wants many
            chunk = 1 << 13 if self.device.type == "cpu" else 1 << 20
            for first in range(0, len(directions), chunk):
                part = slice(first, first + chunk)
                owner = owners[part]
                value, hit = self._radiance(origins[owner], directions[part], sun[owner], fill[owner])
                radiance.index_add_(0, places[part][hit], value / s**2)
                covered.index_add_(0, places[part][hit], torch.full_like(value, 1 / s**2))
            shape = (len(views), camera.height, camera.width)
            return radiance.reshape(shape).cpu(), covered.reshape(shape).cpu()

    def _rays_at_targets(self, views: Views) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Rays that may meet the target, in the body frame: directions, origins by image, image and pixel of each."""
        camera, s = self.camera, self.samples
        keypoints = Keypoints.load("tango")
        boxes = project_targets(camera, keypoints, views.quaternions, views.translations).boxes
        turns = torch.tensor(rotation_matrix(views.quaternions), dtype=torch.float32)
        origins = -torch.einsum("bij,bi->bj", turns, torch.tensor(views.translations, dtype=torch.float32))
        directions, owners, places = [], [], []
        for i, (x0, y0, x1, y1) in enumerate(boxes):
            margin = 2 + 0.12 * max(x1 - x0, y1 - y0)  # parts that stand out of the keypoints' hull
            left, upper = (max(0, int(v - margin)) for v in (x0, y0))
            right = min(camera.width, int(x1 + margin) + 1)
            lower = min(camera.height, int(y1 + margin) + 1)
            rays = self.rays[upper * s : lower * s, left * s : right * s]
            rows = torch.arange(upper * s, lower * s) // s
            columns = torch.arange(left * s, right * s) // s
            place = (i * camera.height + rows[:, None]) * camera.width + columns[None, :]
            directions.append(rays.reshape(-1, 3) @ turns[i])
            owners.append(torch.full((place.numel(),), i))
            places.append(place.reshape(-1))
        return torch.cat(directions), origins, torch.cat(owners), torch.cat(places)

    def _radiance(
        self, origin: Tensor, direction: Tensor, sun: Tensor, fill: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Radiance of the rays that hit, and the indices of these among all given."""
        distance, part, normal = nearest(self.scene, origin, direction)
        hit = torch.nonzero(distance < FAR).squeeze(1)
        normal, part, view = normal[hit], part[hit], -direction[hit]
        point = origin[hit] + distance[hit, None] * direction[hit]
        albedo, f0, roughness, facets, cells = self.scene.materials[part].unbind(1)
        shading_normal = crinkle(normal, point, facets)
        albedo, roughness = solar_cells(point, normal, cells, albedo, roughness)
        level = sun[hit].norm(dim=1).clamp_min(1e-12)
        light = sun[hit] / level[:, None]
        lit = ((normal * light).sum(1) > 0) & ((shading_normal * light).sum(1) > 0)
        lit[lit.clone()] &= nearest(self.scene, (point + 1e-4 * normal)[lit], light[lit])[0] >= FAR
        direct = level * lit * reflect(albedo, f0, roughness, shading_normal, view, light)
        sky = fill[hit].norm(dim=1).clamp_min(1e-12)
        toward = (shading_normal * fill[hit]).sum(1) / sky
        # Half a sky of even light: (1 + cos) / 2 of it is seen; what it mirrors in smooth parts is taken as its mean.
        indirect = sky * (albedo + f0) * (0.5 + 0.5 * toward)
        return direct + indirect, hit


def nearest(scene: SceneTensors, origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """First box that each ray (N, 3) meets: distance (N) (FAR where none), its index (N), its normal (N, 3)."""
    turns = scene.axes.reshape(-1, 3)  # all boxes in one matrix product, laid out (box, axis, ray)
    shift = (scene.axes @ scene.centres[:, :, None]).reshape(-1, 1)
    shape = (len(scene.axes), 3, len(origin))
    o = (turns @ origin.T - shift).reshape(shape)
    inverse = (turns @ direction.T + 1e-12).reciprocal_().reshape(shape)
    middle = o.mul_(inverse).neg_()
    reach = inverse.abs() * scene.halves[:, :, None]
    near, far = middle - reach, middle + reach
    entry = torch.maximum(torch.maximum(near[:, 0], near[:, 1]), near[:, 2])
    leave = torch.minimum(torch.minimum(far[:, 0], far[:, 1]), far[:, 2])
    entry[(entry >= leave) | (entry <= 1e-6)] = FAR
    distance, part = entry.min(dim=0)
    rays = torch.arange(len(part))
    axis = near[part, :, rays].argmax(dim=1)
    normal = scene.axes[part, axis] * -torch.sign(inverse[part, axis, rays])[:, None]
    return distance, part, normal


def reflect(
    albedo: Tensor, f0: Tensor, roughness: Tensor, normal: Tensor, view: Tensor, light: Tensor
) -> Tensor:
    """Radiance under a unit sun: Lambert and GGX with Smith's shadowing (Walter et al. 2007) and Schlick's Fresnel."""
    nl = (normal * light).sum(1).clamp_min(0)
    nv = (normal * view).sum(1).clamp_min(1e-3)
    half = torch.nn.functional.normalize(light + view, dim=1)
    nh = (normal * half).sum(1).clamp(0, 1)
    a2 = roughness**4
    spread = a2 / (nh**2 * (a2 - 1) + 1) ** 2  # GGX times pi, as the sun's irradiance is pi
    masking = nv * (a2 + (1 - a2) * nl**2).sqrt() + nl * (a2 + (1 - a2) * nv**2).sqrt()
    shadowing = 2 * nl * nv / masking.clamp_min(1e-6)
    fresnel = f0 + (1 - f0) * (1 - (view * half).sum(1).clamp(0, 1)) ** 5
    return albedo * nl + spread * shadowing * fresnel / (4 * nv)


def crinkle(normal: Tensor, point: Tensor, amount: Tensor) -> Tensor:
    """Tilt the normals of foil: a facet of 35 mm has one tilt, the same at every look."""
    facet = torch.floor(point / 0.035 + 0.37 * torch.roll(point, 1, dims=1) / 0.035 + 100 + 1e-3)
    weights = torch.tensor([[12.9898, 78.233, 37.719], [39.346, 11.135, 83.155], [73.156, 52.235, 9.151]])
    tilt = torch.frac(torch.sin(facet @ weights) * 43758.5453).abs() * 2 - 1
    return torch.nn.functional.normalize(normal + amount[:, None] * tilt, dim=1)


def solar_cells(
    point: Tensor, normal: Tensor, cells: Tensor, albedo: Tensor, roughness: Tensor
) -> tuple[Tensor, Tensor]:
    """Bright gaps between the cells of the panel's upper side."""
    across = torch.frac((point[:, :2] + 10.0) / torch.tensor([0.1233, 0.0963]))
    gap = ((across < 0.1).any(dim=1) & (normal[:, 2].abs() > 0.5) & (cells > 0)).float()
    return albedo + gap * (0.5 - albedo), roughness + gap * (0.5 - roughness)
