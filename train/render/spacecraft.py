"""The spacecraft that is rendered: boxes with materials, drawn so that its corners are Tango's 11 keypoints.

The shape is our own. Only the corners of the solar panel and of the body and the tips of the antennas
coincide with the keypoints; nothing is taken from a model of the real spacecraft.
"""

from dataclasses import dataclass

import numpy as np
import torch

from visaug_train.geometry import Keypoints

# Gray reflectances. `facets` tilts the normals of crinkled foil, `cells` draws the grid of solar cells.
MATERIALS = {
    #            albedo  f0    roughness facets cells
    "cells": (0.13, 0.06, 0.22, 0.00, 1.0),
    "panel_back": (0.55, 0.04, 0.50, 0.00, 0.0),
    "foil": (0.42, 0.45, 0.35, 0.22, 0.0),
    "white": (0.80, 0.04, 0.60, 0.00, 0.0),
    "metal": (0.25, 0.60, 0.30, 0.00, 0.0),
    "black": (0.06, 0.04, 0.40, 0.00, 0.0),
}


@dataclass(frozen=True)
class Box:
    """An oriented box: `centre` and `half` sizes in metres, `axes` its unit vectors as rows, in the body frame."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    material: str
    axes: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def box(low: tuple[float, float, float], high: tuple[float, float, float], material: str) -> Box:
    """A box along the axes of the body, from corner to corner."""
    a, b = np.array(low, float), np.array(high, float)
    return Box(tuple((a + b) / 2), tuple((b - a) / 2), material)


def rod(start: np.ndarray, end: np.ndarray, radius: float, material: str) -> Box:
    """A thin square rod from `start` to `end`."""
    along = end - start
    length = float(np.linalg.norm(along))
    w = along / length
    u = np.cross(w, [0.0, 0.0, 1.0])
    u /= np.linalg.norm(u)
    axes = tuple(map(tuple, (u, np.cross(w, u), w)))
    return Box(tuple((start + end) / 2), (radius, radius, length / 2), material, axes)


def spacecraft() -> list[Box]:
    keypoints = Keypoints.load("tango")
    p = dict(zip(keypoints.names, keypoints.points_m))
    top = p["panel_3"][2]
    parts = [
        box(tuple(p["body_1"]), (p["body_3"][0], p["body_3"][1], top - 0.02), "foil"),
        box((*p["panel_1"][:2], top - 0.02), (*p["panel_3"][:2], top - 0.006), "panel_back"),
        box((*p["panel_1"][:2], top - 0.006), tuple(p["panel_3"]), "cells"),
        # Parts that distinguish the sides: a radiator, a dark window, a sensor head and feet under the body.
        box((0.3695, -0.16, 0.05), (0.376, 0.06, 0.25), "white"),
        box((-0.376, 0.02, 0.08), (-0.3695, 0.22, 0.22), "black"),
        box((-0.28, -0.272, 0.04), (-0.02, -0.2635, 0.26), "white"),
        box((0.05, 0.3035, 0.06), (0.27, 0.312, 0.20), "black"),
        box((-0.20, -0.10, -0.030), (-0.02, 0.10, 0.001), "white"),
        box((0.12, 0.06, -0.045), (0.22, 0.16, 0.001), "metal"),
        box((0.17, -0.20, -0.015), (0.29, -0.10, 0.001), "black"),
    ]
    bases = np.array([[-0.36, 0.30, 0.24], [0.36, 0.30, 0.24], [0.305, -0.26, 0.24]])
    for name, base in zip(("antenna_1", "antenna_2", "antenna_3"), bases):
        along = (p[name] - base) / np.linalg.norm(p[name] - base)
        parts.append(rod(base, p[name], 0.012, "metal"))
        parts.append(rod(p[name] - 0.05 * along, p[name], 0.022, "white"))
    return parts


@dataclass(frozen=True, eq=False)
class SceneTensors:
    """The parts as tensors: centres, halves (K, 3), axes (K, 3, 3), materials (K, 5)."""

    centres: torch.Tensor
    halves: torch.Tensor
    axes: torch.Tensor
    materials: torch.Tensor

    @classmethod
    def of(cls, parts: list[Box]) -> "SceneTensors":
        rows = [(part.centre, part.half, part.axes, MATERIALS[part.material]) for part in parts]
        return cls(*(torch.tensor(np.array(column), dtype=torch.float32) for column in zip(*rows)))
