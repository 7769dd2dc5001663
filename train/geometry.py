"""From a pose to pixels: cameras with lens distortion, keypoints, boxes, what of them lies in the image.

Pixel coordinates count from the outer corner of the first pixel, so the image covers [0, width] x [0, height]
and resizing by s multiplies them by s; SPEED's principal point (960, 600) of a 1920 x 1200 image is meant so.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visaug.core.documents import read_json, read_yaml
from visaug.core.errors import InputError
from visaug.core.nearest import did_you_mean

TANGO = Path(__file__).with_name("tango.yaml")


@dataclass(frozen=True, eq=False)
class Pinhole:
    """Intrinsics of a camera: size in pixels, 3 x 3 matrix in pixels, OpenCV's (k1, k2, p1, p2, k3)."""

    width: int
    height: int
    matrix: np.ndarray
    distortion: np.ndarray

    @classmethod
    def load(cls, path: str | Path) -> "Pinhole":
        path = Path(path)
        content = read_json(path)
        if not isinstance(content, dict):
            raise InputError(f"{path}: expected an object with Nu, Nv and cameraMatrix")
        width, height = (_number(content, key, path) for key in ("Nu", "Nv"))
        if "cameraMatrix" in content or "K" in content:
            key = "cameraMatrix" if "cameraMatrix" in content else "K"
            matrix = finite_array(content[key], (3, 3), f"{path}: {key}")
        else:  # SPEED gives the focal length and the pixel pitch in metres
            fx, fy, ppx, ppy = (_number(content, key, path) for key in ("fx", "fy", "ppx", "ppy"))
            matrix = np.array([[fx / ppx, 0, width / 2], [0, fy / ppy, height / 2], [0, 0, 1.0]])
        given, distortion = content.get("distCoeffs", []), np.zeros(5)
        lens = numbers_in(given).ravel()  # OpenCV writes a row or a column
        if len(lens) not in (0, 4, 5) or not np.isfinite(lens).all():
            raise InputError(f"{path}: distCoeffs: expected 4 or 5 numbers (k1 k2 p1 p2 k3), got {given!r}")
        distortion[: len(lens)] = lens
        place, form = f"{path}: cameraMatrix", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0"
        if not (matrix[0, 0] > 0 and matrix[1, 1] > 0 and np.allclose(matrix[2], [0, 0, 1])):
            raise InputError(f"{place}: expected {form}")
        if not (0 < matrix[0, 2] < width and 0 < matrix[1, 2] < height):
            raise InputError(f"{place}: expected a principal point inside {width} x {height} pixels")
        return cls(int(width), int(height), matrix, distortion)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width, self.height

    def to_json(self) -> dict[str, Any]:
        """In SPEED+'s layout; fx and fy in metres for a pitch of 5.86 um at 1920 pixels."""
        pitch, matrix = 5.86e-6 * 1920 / self.width, self.matrix.tolist()
        (fx, _, cx), (_, fy, cy), _ = matrix
        return {
            **{"Nu": self.width, "Nv": self.height, "ppx": pitch, "ppy": pitch},
            **{"fx": fx * pitch, "fy": fy * pitch, "ccx": cx, "ccy": cy},
            **{"cameraMatrix": matrix, "distCoeffs": self.distortion.tolist()},
        }

    def scaled(self, width: int, height: int) -> "Pinhole":
        """The camera of the same images resized to `width` x `height` pixels."""
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return Pinhole(width, height, scale @ self.matrix, self.distortion)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) in the camera's frame, metres -> pixels (..., 2). Behind the camera: NaN."""
        before = points[..., 2:] > 1e-9
        flat = np.where(before, points, (0.0, 0.0, 1.0)).reshape(-1, 3)
        if not len(flat):
            return np.zeros((*points.shape[:-1], 2))
        pixels = cv2.projectPoints(flat, np.zeros(3), np.zeros(3), self.matrix, self.distortion)[0]
        return np.where(before, pixels.reshape(*points.shape[:-1], 2), np.nan)

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) -> directions (..., 3) with z = 1 that `project` maps to them."""
        distorted = (pixels - self.matrix[:2, 2]) @ np.linalg.inv(self.matrix[:2, :2]).T
        rays = np.concatenate([distorted, np.ones_like(pixels[..., :1])], axis=-1)
        plain = Pinhole(self.width, self.height, np.eye(3), self.distortion)
        for _ in range(20):  # a fixed point; contracts fast for the mild distortion of such lenses
            rays[..., :2] = rays[..., :2] + distorted - plain.project(rays)
        return rays


def rotation_matrix(quaternions: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4), scalar first -> matrices R (..., 3, 3) with p_camera = R p_body + r."""
    unit = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    across = np.cross(np.eye(3), unit[..., None, 1:])  # times p: the vector product of the vector part and p
    return np.eye(3) + 2 * unit[..., :1, None] * across + 2 * across @ across


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Named points of a spacecraft in its body frame, metres, (K, 3).

    `sigmas` (K) are those of COCO's OKS, 1 / K each where left out. `flip` is, for each point, the one that it becomes in a
    mirrored image; None where the spacecraft is not mirror-symmetric.
    """

    name: str
    names: tuple[str, ...]
    points_m: np.ndarray
    sigmas: np.ndarray | None = None
    flip: tuple[int, ...] | None = None

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def load(cls, source: str | Path = "tango") -> "Keypoints":
        """`tango`, or a YAML file.

        Its keys: `points_m` (name: [x, y, z], or a list of points), and where wanted `sigmas` (a list, or by name) and
        `flip_pairs` ([[left, right], ...], names or numbers from 0; points in no pair stay).
        """
        path = TANGO if str(source) == "tango" else Path(source)
        content = read_yaml(path, "`tango`, or YAML with points_m: {name: [x, y, z]}")
        known = {"name", "points_m", "sigmas", "flip_pairs"}
        if isinstance(content, dict) and (more := [str(key) for key in content if key not in known]):
            problem = f"is not a key of keypoints{did_you_mean(more[0], known)}"
            raise InputError(problem, file=path, field=more[0], expected=", ".join(sorted(known)))
        points = content.get("points_m") if isinstance(content, dict) else None
        if isinstance(points, list):
            points = {f"point_{i + 1}": point for i, point in enumerate(points)}
        if not isinstance(points, dict) or len(points) < 4:
            raise InputError(f"{path}: points_m: expected at least 4 points, as name: [x, y, z] in metres")
        array = finite_array(list(points.values()), (len(points), 3), f"{path}: points_m")
        names = tuple(map(str, points))
        name = str(content.get("name", path.stem))
        return cls(name, names, array, _sigmas(content, names, path), _flip(content, names, path))


def _sigmas(content: dict, names: tuple[str, ...], path: Path) -> np.ndarray | None:
    if (given := content.get("sigmas")) is None:
        return None
    if isinstance(given, dict):
        by_name = {str(name): value for name, value in given.items()}
        given = [by_name.pop(name, None) for name in names] if by_name.keys() <= set(names) else None
    sigmas = finite_array(given, (len(names),), f"{path}: sigmas")
    if not (sigmas > 0).all():
        raise InputError("must be above 0", file=path, field="sigmas", expected="one number a point")
    return sigmas


def _flip(content: dict, names: tuple[str, ...], path: Path) -> tuple[int, ...] | None:
    if (given := content.get("flip_pairs")) is None:
        return None
    numbers = range(len(names))
    flip = list(numbers)
    for pair in given if isinstance(given, list) else [given]:
        try:
            left, right = (names.index(each) if isinstance(each, str) else numbers[each] for each in pair)
        except (TypeError, ValueError, IndexError):
            left = right = -1
        if left == right or flip[left] != left or flip[right] != right:
            problem, expected = f"{pair!r} is no pair of points", "[[left, right], ...]"
            raise InputError(problem, file=path, field="flip_pairs", expected=expected)
        flip[left], flip[right] = right, left
    return tuple(flip)


@dataclass(frozen=True, eq=False)
class Targets:
    """What the images show. boxes (N, 4) x0 y0 x1 y1, clipped; points (N, K, 2); inside (N, K); seen (N,).

    A target is seen when its box, cut at the border, is at least one pixel wide and high. Boxes are those of
    the hull of all projected keypoints, so a target that reaches over the border keeps the part inside.
    """

    boxes: np.ndarray
    points: np.ndarray
    inside: np.ndarray
    seen: np.ndarray


def project_targets(
    camera: Pinhole, keypoints: Keypoints, quaternions: np.ndarray, translations: np.ndarray
) -> Targets:
    """Boxes and keypoints in pixels of poses (N, 4), (N, 3)."""
    rotated = np.einsum("nij,kj->nki", rotation_matrix(quaternions), keypoints.points_m)
    points = camera.project(rotated + translations[:, None, :])
    size = np.array([camera.width, camera.height], float)
    whole = np.isfinite(points).all(axis=(1, 2))  # a target that reaches behind the camera has no box
    filled = np.where(np.isfinite(points), points, -1.0)
    low, high = (np.clip(ends, 0, size) for ends in (filled.min(axis=1), filled.max(axis=1)))
    inside = np.isfinite(points).all(axis=2) & (points >= 0).all(axis=2) & (points <= size).all(axis=2)
    seen = whole & ((high - low) >= 1.0).all(axis=1)
    return Targets(np.concatenate([low, high], axis=1), points, inside & seen[:, None], seen)


def _number(content: dict, key: str, path: Path) -> float:
    value = content.get(key)
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0 < value < 1e9:
        raise InputError(f"{path}: {key}: expected a number from 0 to 1e9, got {value!r}")
    return value


def numbers_in(value: Any) -> np.ndarray:
    """A value of a file as numbers; a single NaN where it is anything else."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return np.array(np.nan)


def finite_array(value: Any, shape: tuple[int, ...], where: str) -> np.ndarray:
    """A value of a file as finite numbers of a shape; refused, with `where` it stands, if it is anything else."""
    array = numbers_in(value)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{where}: expected {' x '.join(map(str, shape)) or 1} finite numbers")
    return array
