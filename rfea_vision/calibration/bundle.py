"""Least squares over lens and board poses together, with the full covariance of the lens and of one pose.

SciPy solves; the covariance has an arrow shape, as every photo couples its own six pose numbers to the lens only: there the
poses are eliminated photo by photo (Schur complement).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.lenses import LENSES
from rfea_vision.calibration.corners import BoardView
from rfea_vision.calibration.noise import slow_variance
from rfea_vision.calibration.projection import lens_vector, rms_distance, rotation_matrix
from rfea_vision.errors import DataError

Pose = tuple[FloatArray, FloatArray]

REWEIGHTINGS = 2  # rounds in which the noise of every photo is estimated again
# evaluations of a least-squares problem; photos that do not determine the lens would have it creep for ever
MOST_LOOKS = 60
PRIOR_FREEDOM = 20  # a photo's own noise is pulled towards that of all photos as if by so many residuals
WIDEST_RAD = 1.48  # between the optical axis and a ray: beyond, a board is seen edge on
SCALE_LIMIT = 4.0  # between the noise of a photo and that of all photos
_NO_TURN = np.zeros(3)


@dataclass(frozen=True)
class Lens:
    """Camera matrix and distortion of one lens model."""

    model: str
    matrix: FloatArray
    distortion: FloatArray

    @property
    def is_fisheye(self) -> bool:
        """Whether the lens projects by the angle of a ray, and not as a pinhole does."""
        return LENSES[self.model].fisheye

    @property
    def vector(self) -> FloatArray:
        """[fx, fy, cx, cy, distortion...], (4 + coefficients,), the first four in px."""
        return lens_vector(self.matrix, self.distortion)

    @staticmethod
    def from_vector(model: str, vector: FloatArray) -> Lens:
        """The lens of a model whose `vector` (4 + coefficients,) this is."""
        fx, fy, cx, cy = vector[:4]
        return Lens(model, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), np.array(vector[4:]))


@dataclass(frozen=True)
class Bundle:
    """The solution: lens, one pose per view, residuals, and covariances (unit: px, mm, rad).

    `joint_covariance` is of [lens vector, rotation vector (left-multiplied, camera frame), translation] of the view
    named by `solve_bundle`'s `joint_view`.
    """

    lens: Lens
    rotations: tuple[FloatArray, ...]
    translations_mm: tuple[FloatArray, ...]
    residuals: tuple[FloatArray, ...]
    sigma_px: float
    lens_covariance: FloatArray
    joint_covariance: FloatArray | None

    @property
    def rms_px(self) -> float:
        """Root mean square distance between corners and model over all views."""
        return rms_distance(np.concatenate(self.residuals))

    def rms_of(self, view: int) -> float:
        """The same for one view."""
        return rms_distance(self.residuals[view])


def project_board(
    lens: Lens, rotation: FloatArray, translation_mm: FloatArray, board_mm: FloatArray, turn: FloatArray = _NO_TURN
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels (n, 2) of board points (n, 2) mm, and their derivatives by the lens (2n, lens parameters) and the pose (2n, 6).

    The board is turned by `rotation` (3, 3), then by the rotation vector `turn` (3,), and shifted; the pose is turn and shift.
    """
    turned = np.ascontiguousarray(board_mm @ rotation[:, :2].T).reshape(-1, 1, 3)
    project = cv2.fisheye.projectPoints if lens.is_fisheye else cv2.projectPoints
    pixels, found = project(turned, turn, translation_mm, lens.matrix, lens.distortion)[:2]
    pixels, found = np.asarray(pixels, dtype=float).reshape(-1, 2), np.asarray(found, dtype=float)
    count = lens.distortion.size
    if lens.is_fisheye:  # OpenCV's order: f, c, distortion, rotation, translation, skew
        return pixels, found[:, : 4 + count], found[:, 8:14]
    return pixels, found[:, 6 : 10 + count], found[:, :6]  # rotation, translation, f, c, distortion


def undistort(lens: Lens, pixels: FloatArray) -> FloatArray:
    """Normalised image coordinates (n, 2) of pixels (n, 2)."""
    points = np.ascontiguousarray(pixels, dtype=float).reshape(-1, 1, 2)
    if lens.is_fisheye:
        flat = cv2.fisheye.undistortPoints(points, lens.matrix, lens.distortion.reshape(-1, 1))
        return np.asarray(flat, dtype=float).reshape(-1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-12)
    flat = cv2.undistortPoints(points, lens.matrix, lens.distortion, criteria=criteria)
    return np.asarray(flat, dtype=float).reshape(-1, 2)


def first_pose(lens: Lens, view: BoardView) -> tuple[FloatArray, FloatArray]:
    """Board pose, rotation (3, 3) and translation (3,) in mm, from the homography of the undistorted corners (Collins, Bartoli 2014).

    Raises
    ------
    DataError
        If the lens bends its corners beyond all measure, or no pose is found.
    """
    flat = np.column_stack([view.board_mm, np.zeros(len(view.board_mm))])
    straight = undistort(lens, view.pixels)
    if not np.all(np.abs(straight) < 1e3):
        raise DataError(f"{view.file}: this lens cannot have seen the board; leave this photo out")
    found, rotation, translation = cv2.solvePnP(flat, straight, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    if not found:
        raise DataError(f"{view.file}: the pose of the board could not be found; leave this photo out")
    return rotation_matrix(rotation.ravel()), np.asarray(translation, dtype=float).ravel()


def solve_pose(lens: Lens, view: BoardView) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Board pose of least squares for a known lens: rotation, translation in mm, residuals (n, 2)."""
    rotation, translation = first_pose(lens, view)

    def at(move: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        return project_board(lens, rotation, move[3:], view.board_mm, move[:3])

    move = least_squares(
        lambda x: (at(x)[0] - view.pixels).ravel(),
        np.concatenate([np.zeros(3), translation]),
        lambda x: at(x)[2],  # type: ignore[arg-type]
        method="lm",
        x_scale="jac",
    ).x
    return rotation_matrix(move[:3]) @ rotation, move[3:], view.pixels - at(move)[0]


def first_fisheye(views: Sequence[BoardView], size: tuple[int, int]) -> Lens:
    """The ideal equidistant lens whose focal length fits the boards best; a fair first guess for any lens of `size` (width, height) px.

    Raises
    ------
    DataError
        If none fits.
    """
    centre = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    radius = max(float(np.linalg.norm(v.pixels - centre, axis=1).max()) for v in views)
    found: list[tuple[float, Lens]] = []
    for focal in np.geomspace(0.22, 2.5, 14) * max(size):
        if radius / focal > WIDEST_RAD:
            continue
        lens = Lens("fisheye", np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]]), np.zeros(4))
        try:
            poses = [first_pose(lens, view) for view in views]
        except (DataError, cv2.error):
            continue
        cost = sum(float(np.sum(e**2)) for e in _residuals(views, lens, poses))
        if np.isfinite(cost):
            found.append((cost, lens))
    if not found:
        raise DataError("camera.photos: no lens fits the photos; check camera.board.inner_corners")
    return min(found, key=lambda item: item[0])[1]


def first_lens(views: Sequence[BoardView], size: tuple[int, int], model: str) -> Lens:
    """OpenCV's closed-form start (Zhang 2000), polished with few coefficients, for pictures of `size` (width, height) px.

    Raises
    ------
    DataError
        If the photos do not determine the lens.
    """
    if LENSES[model].fisheye:
        return first_fisheye(views, size)
    objects = [np.column_stack([v.board_mm, np.zeros(len(v.board_mm))]).astype(np.float32) for v in views]
    images = [v.pixels.astype(np.float32).reshape(-1, 1, 2) for v in views]
    flags = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    start = np.asarray(cv2.initCameraMatrix2D(objects, images, size), dtype=float)
    if not np.all(np.isfinite(start)) or not 0.2 < start[0, 0] / max(size) < 20:
        # Boards seen squarely say nothing of the focal length: begin with that of an ordinary camera.
        focal = 1.1 * max(size)
        start = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # several add up the photos in whatever order they come to them, and each order rounds in another way
    try:
        _, matrix, distortion, _, _ = cv2.calibrateCamera(
            objects, images, size, start, np.zeros(5), flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS
        )
    except cv2.error as error:
        raise DataError(
            "camera.photos: the photos do not determine the lens; add some with the board turned by 20 to 40 deg"
        ) from error
    finally:
        cv2.setNumThreads(threads)
    coefficients = np.zeros(LENSES[model].coefficients)
    coefficients[0] = float(np.ravel(distortion)[0])
    return Lens(model, np.asarray(matrix, dtype=float), coefficients)


def solve_bundle(
    views: Sequence[BoardView],
    size: tuple[int, int],
    model: str,
    *,
    joint_view: int | None = None,
    reweight: bool = True,
) -> Bundle:
    """Least squares over lens and poses; each photo counts by its own noise, found in a first round.

    A board seen level or small is located less well than one seen large and turned, and the covariance must know it.

    Parameters
    ----------
    views : board corners, at least three views
    size : picture width and height in px
    model : one of `LENSES`
    joint_view : view whose pose shares the joint covariance with the lens
    reweight : estimate the noise of every photo by itself

    Raises
    ------
    DataError
        If the photos do not determine the lens.
    """
    poorer = LENSES[model].richer_than
    if poorer is None:
        lens = first_lens(views, size, model)
    else:  # a rich model has valleys of its own: start on the plain one
        plain = solve_bundle(views, size, poorer).lens
        more = np.zeros(LENSES[model].coefficients - plain.distortion.size)
        lens = Lens(model, plain.matrix, np.concatenate([plain.distortion, more]))
    poses = [first_pose(lens, view) for view in views]
    scales = np.ones(len(views))
    for _ in range(REWEIGHTINGS if reweight else 0):
        lens, poses = _descend(views, lens, poses, scales)
        scales = _scales(views, lens, poses)
    lens, poses = _descend(views, lens, poses, scales)
    return _finish(views, lens, poses, scales, joint_view)


def _residuals(views: Sequence[BoardView], lens: Lens, poses: Sequence[Pose]) -> list[FloatArray]:
    return [v.pixels - project_board(lens, r, t, v.board_mm)[0] for v, (r, t) in zip(views, poses, strict=True)]


def _blocks(
    views: Sequence[BoardView], lens: Lens, poses: Sequence[Pose], scales: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    """Derivatives by lens and pose, view by view, divided by the noise."""
    found = [project_board(lens, r, t, v.board_mm)[1:] for v, (r, t) in zip(views, poses, strict=True)]
    return [(a / scale, b / scale) for (a, b), scale in zip(found, scales, strict=True)]


def _scales(views: Sequence[BoardView], lens: Lens, poses: Sequence[Pose]) -> FloatArray:
    """Noise of every photo relative to that of all, from its residuals."""
    residuals = _residuals(views, lens, poses)
    squares = np.array([float(np.sum(e**2)) for e in residuals])
    freedom = np.array([e.size - 6 - len(lens.vector) / len(views) for e in residuals])
    pooled = squares.sum() / max(freedom.sum(), 1.0)
    own = (squares + PRIOR_FREEDOM * pooled) / np.maximum(freedom + PRIOR_FREEDOM, 1.0)
    return np.clip(np.sqrt(own / max(pooled, 1e-30)), 1 / SCALE_LIMIT, SCALE_LIMIT)


def _descend(views: Sequence[BoardView], lens: Lens, poses: list[Pose], scales: FloatArray) -> tuple[Lens, list[Pose]]:
    """Lens and poses of least squares (MINPACK's Levenberg-Marquardt), each view's residuals divided by its noise."""
    size = lens.vector.size
    ends = np.cumsum([0, *(view.pixels.size for view in views)])

    def each(x: FloatArray) -> Iterator[tuple[slice, slice, FloatArray, FloatArray, FloatArray]]:
        tried = Lens.from_vector(lens.model, x[:size])
        for k, (view, (rotation, _), scale) in enumerate(zip(views, poses, scales, strict=True)):
            rows, own = slice(ends[k], ends[k + 1]), slice(size + 6 * k, size + 6 * k + 6)
            pixels, by_lens, by_pose = project_board(tried, rotation, x[own][3:], view.board_mm, x[own][:3])
            yield rows, own, (pixels - view.pixels).ravel() / scale, by_lens / scale, by_pose / scale

    def residual(x: FloatArray) -> FloatArray:
        return np.concatenate([gap for _, _, gap, _, _ in each(x)])

    def jacobian(x: FloatArray) -> FloatArray:
        found = np.zeros((ends[-1], x.size))
        for rows, own, _, by_lens, by_pose in each(x):
            found[rows, :size], found[rows, own] = by_lens, by_pose
        return found

    start = np.concatenate([lens.vector, *(np.concatenate([np.zeros(3), t]) for _, t in poses)])
    asked = {"ftol": 1e-10, "xtol": 1e-12, "gtol": 1e-12, "max_nfev": MOST_LOOKS}
    x = least_squares(residual, start, jacobian, method="lm", x_scale="jac", **asked).x  # type: ignore[arg-type]
    moves = x[size:].reshape(-1, 6)
    turned = [(rotation_matrix(m[:3]) @ rotation, m[3:]) for m, (rotation, _) in zip(moves, poses, strict=True)]
    return Lens.from_vector(lens.model, x[:size]), turned


def _finish(
    views: Sequence[BoardView], lens: Lens, poses: Sequence[Pose], scales: FloatArray, joint_view: int | None
) -> Bundle:
    residuals = _residuals(views, lens, poses)
    blocks = _blocks(views, lens, poses, scales)
    size = len(lens.vector)
    schur = np.zeros((size, size))
    for a, b in blocks:
        ab = a.T @ b
        schur += a.T @ a - ab @ np.linalg.solve(b.T @ b, ab.T)
    freedom = sum(e.size for e in residuals) - size - 6 * len(views)
    if freedom < 1 or not np.all(np.isfinite(schur)):
        raise DataError("calibration: too few corners to determine the lens; add photos of the board")
    variance = sum(float(np.sum((e / s) ** 2)) for e, s in zip(residuals, scales, strict=True)) / freedom
    plain = sum(float(np.sum(e**2)) for e in residuals) / freedom
    variance = slow_variance(
        [v.board_mm for v in views],
        [e / scale for e, scale in zip(residuals, scales, strict=True)],
        [b for _, b in blocks],
        size,
        variance,
    )
    scale = np.sqrt(np.maximum(np.diag(schur), 1e-30))
    inverse = (
        np.linalg.pinv(schur / scale[:, None] / scale[None, :], rcond=1e-13, hermitian=True)
        / scale[:, None]
        / scale[None, :]
    )
    lens_covariance = variance * inverse
    joint = None
    if joint_view is not None:
        a, b = blocks[joint_view]
        bb = np.linalg.inv(b.T @ b)
        gain = -bb @ b.T @ a
        joint = np.zeros((size + 6, size + 6))
        joint[:size, :size] = lens_covariance
        joint[size:, :size] = gain @ lens_covariance
        joint[:size, size:] = joint[size:, :size].T
        joint[size:, size:] = variance * bb + gain @ lens_covariance @ gain.T
    return Bundle(
        lens,
        tuple(r for r, _ in poses),
        tuple(t for _, t in poses),
        tuple(residuals),
        float(np.sqrt(plain)),
        lens_covariance,
        joint,
    )
