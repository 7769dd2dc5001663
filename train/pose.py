"""The pose from keypoints (PnP with RANSAC, then refined) and the SPEC score of a pose."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from visaug_train.geometry import Pinhole

# Below these a pose is as exact as the reference poses of the hardware-in-the-loop images are: SPEC 2021 counts no
# error. They are the calibration's of lightbox and sunlamp; rendered images have exact poses and no floor (SPEC 2019).
POSITION_FLOOR, ATTITUDE_FLOOR_DEG = 0.002173, 0.169
FLOORED_DOMAINS = ("lightbox", "sunlamp")


def estimate_pose(
    points: np.ndarray,
    confidence: np.ndarray,
    model_m: np.ndarray,
    camera: Pinhole,
    least_confidence: float = 0.5,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Quaternion (4, scalar first) and translation (3, m) of a target from its keypoints (K, 2) in pixels.

    Points below `least_confidence` are left out as long as six remain. Points further than 4 % of the
    target's size (at least 2 px) from where a pose puts them are outliers. None where no pose before the
    camera is found, or all points fall together.
    """
    order = np.argsort(-confidence, kind="stable")
    used = order[: max(6, int((confidence >= least_confidence).sum()))]
    used = used[np.isfinite(points[used]).all(axis=1)]
    if len(used) < 4:
        return None
    image, model = points[used].astype(float), model_m[used].astype(float)
    extent = float(np.ptp(image, axis=0).max())
    if extent < 1:  # all in one pixel: any pose far enough away would do
        return None
    lens = (camera.matrix, camera.distortion)
    found, turn, shift, inliers = cv2.solvePnPRansac(
        model,
        image,
        *lens,
        flags=cv2.SOLVEPNP_EPNP,
        reprojectionError=max(2.0, 0.04 * extent),
        iterationsCount=300,
    )
    if not found or inliers is None or len(inliers) < 4:
        found, turn, shift = cv2.solvePnP(model, image, *lens, flags=cv2.SOLVEPNP_SQPNP)
        inliers = np.arange(len(used))
    if not found:
        return None
    kept = np.ravel(inliers).astype(int)
    turn, shift = cv2.solvePnPRefineLM(model[kept], image[kept], *lens, turn, shift)
    shift = np.ravel(shift)
    if not (np.isfinite(turn).all() and np.isfinite(shift).all() and shift[2] > 0):
        return None
    x, y, z, w = Rotation.from_rotvec(np.ravel(turn)).as_quat()
    return np.array([w, x, y, z]), shift


def pose_errors(
    quaternion: np.ndarray, translation: np.ndarray, true_quaternion: np.ndarray, true_translation: np.ndarray
) -> tuple[float, float]:
    """e_t = |dr| / |r|, a fraction, and e_q = 2 arccos|<q, q'>| in degrees."""
    position = float(np.linalg.norm(translation - true_translation) / np.linalg.norm(true_translation))
    same = abs(float(quaternion @ true_quaternion))
    opposite = float(np.linalg.norm(quaternion - np.sign(quaternion @ true_quaternion) * true_quaternion))
    # arccos loses all digits near 1; the chord between the quaternions does not.
    angle = 2 * np.arccos(min(same, 1.0)) if same < 0.99 else 4 * np.arcsin(min(opposite / 2, 1.0))
    return position, float(np.degrees(angle))


def spec_score(position: np.ndarray, attitude_deg: np.ndarray, floors: bool = True) -> np.ndarray:
    """e_t + e_q (radians) of each pose; with `floors` each is 0 below the exactness of the reference."""
    if floors:
        position = np.where(position < POSITION_FLOOR, 0, position)
        attitude_deg = np.where(attitude_deg < ATTITUDE_FLOOR_DEG, 0, attitude_deg)
    return position + np.radians(attitude_deg)
