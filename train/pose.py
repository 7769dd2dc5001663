"""The pose from keypoints (PnP with RANSAC, then refined) and the SPEC score of a pose."""

from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from visaug_train.geometry import Pinhole

FLOORED_DOMAINS = ("lightbox", "sunlamp")  # rendered images have exact poses and no floor (SPEC 2019)


def estimate_pose(
    points: np.ndarray, confidence: np.ndarray, model_m: np.ndarray, camera: Pinhole
) -> tuple[np.ndarray, np.ndarray] | None:
    """Quaternion (4, scalar first) and translation (3, m) of a target from its keypoints (K, 2) in pixels.

    Used are the points whose confidence (K) is above 0 and at least half the highest one: what a
    confidence means differs between networks, what 0 means does not. Six or more go through RANSAC with EPnP, where points
    further than 4 % of the target's size (at least 2 px) from where a pose puts them are outliers; four and five are
    solved by SQPnP. All are refined by Levenberg and Marquardt. None with fewer than four points, with points that all
    fall into one pixel, and where no pose before the camera is found.
    """
    finite = np.isfinite(points).all(axis=1) & np.isfinite(confidence) & (confidence > 0)
    used = np.flatnonzero(finite)
    # Of the confidence of an image's surest keypoint: YOLO's visibility of a clear point is near 1 and is cut at 0.5; heatmap
    # networks give clear points 0.2 to 0.6, and AlphaPose up to 6.
    least_confidence = 0.5
    used = used[confidence[used] >= least_confidence * confidence[used].max(initial=0)]
    if len(used) < 4:
        return None
    image, model = points[used].astype(float), model_m[used].astype(float)
    extent = float(np.ptp(image, axis=0).max())
    if extent < 1:  # any pose far enough away would do
        return None
    lens = (camera.matrix, camera.distortion)
    kept, poses = np.arange(len(used)), []
    if len(used) > 5:  # EPnP samples of RANSAC are five points
        how: dict[str, Any] = {"reprojectionError": max(2.0, 0.04 * extent), "iterationsCount": 300}
        found, turn, shift, inliers = cv2.solvePnPRansac(model, image, *lens, flags=cv2.SOLVEPNP_EPNP, **how)
        if found and inliers is not None and len(inliers) >= 4:
            kept, poses = np.ravel(inliers).astype(int), [(turn, shift)]
    if not poses:
        # of four points SQPnP misses the pose now and then, and so does P3P with a fourth point: not both
        for method in (cv2.SOLVEPNP_SQPNP, cv2.SOLVEPNP_AP3P)[: 2 if len(used) == 4 else 1]:
            _, turns, shifts, _ = cv2.solvePnPGeneric(model, image, *lens, flags=method)
            poses += [(turn, shift) for turn, shift in zip(turns, shifts) if shift[2] > 0]
    refined = [cv2.solvePnPRefineLM(model[kept], image[kept], *lens, *pose) for pose in poses]
    refined = [(np.ravel(t), np.ravel(s)) for t, s in refined if np.isfinite([t, s]).all() and s[2] > 0]
    if not refined:
        return None

    def distance(pose: tuple[np.ndarray, np.ndarray]) -> float:
        return float(np.square(cv2.projectPoints(model[kept], *pose, *lens)[0][:, 0] - image[kept]).sum())

    turn, shift = min(refined, key=distance)
    x, y, z, w = Rotation.from_rotvec(turn).as_quat()
    return np.array([w, x, y, z]), shift


def pose_errors(
    quaternions: np.ndarray,
    translations: np.ndarray,
    true_quaternions: np.ndarray,
    true_translations: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """e_t = |dr| / |r|, a fraction, and e_q = 2 arccos|<q, q'>| in degrees; unit quaternions (..., 4), translations (..., 3)."""
    off = np.linalg.norm(translations - true_translations, axis=-1)
    # arccos loses all digits near 1; the chords to q' and to -q', which is the same attitude, do not.
    chords = [np.linalg.norm(quaternions + sign * true_quaternions, axis=-1) for sign in (-1, 1)]
    angle = 4 * np.arctan2(np.minimum(*chords), np.maximum(*chords))
    return off / np.linalg.norm(true_translations, axis=-1), np.degrees(angle)


def spec_score(position: np.ndarray, attitude_deg: np.ndarray, floors: bool = True) -> np.ndarray:
    """e_t + e_q (radians) of each pose; with `floors` each is 0 below the exactness of the reference poses of the
    hardware-in-the-loop images, which is the calibration's of lightbox and sunlamp (SPEC 2021).
    """
    if floors:
        position = np.where(position < 0.002173, 0, position)
        attitude_deg = np.where(attitude_deg < 0.169, 0, attitude_deg)
    return position + np.radians(attitude_deg)
