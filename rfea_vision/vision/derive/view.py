"""What all frames of a film share: the rig frame in the plane of motion, and the errors of clamp, camera and pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Calibration
from rfea_vision.artefacts.measurement import Vertical
from rfea_vision.calibration.projection import unproject
from rfea_vision.lines import along, from_down, leftwards, rig_axes
from rfea_vision.scatter import scatter
from rfea_vision.vision.curve import point_and_tangent, points_on, tangents
from rfea_vision.vision.derive.picture_errors import ORIGIN_PX, PictureErrors, camera_moved, picture_errors
from rfea_vision.vision.derive.rows import Rows
from rfea_vision.vision.derive.smooth import Smoothed
from rfea_vision.vision.derive.systematic import CalibrationError
from rfea_vision.vision.find.begin import FIRST_TRIES, POINTING_PX, Scene

STRAIGHTEST_SHARE = 0.1
POINTING_SHARE = 0.2  # of the half width: so far beside an end a hurried hand points, where that is more than `POINTING_PX`
STILL = 1.5  # variance of the start across the tube, over what its scatter misses
CLAMP_SHARE = 0.7  # the clamp is read on the tube and on both sides of it, the end by its own light only


@dataclass(frozen=True)
class View:
    """The rig frame in the plane, the side of the bend, and the errors that frames share.

    Attributes
    ----------
    origin : (2,) mm in the plane, the middle of the first visible cross-section
    to_rig : (2, 2) rows: the rig's x and y as directions in the plane
    sign : 1 where the tube bends to the camera's left, else -1
    clamped : angle (rad) of the clamp's tangent from down, positive towards the bend
    inflation : variance of an edge over that of its noise
    half_mm : half width
    hinge_mm : how far inside of the centre line lies the one that keeps its length
    calibrated : what the camera's uncertainty moves
    origin_sigma, lateral_sigma : standard errors (mm) of the clamp along and across the tube
    from_picture : errors that the pictures tell of
    """

    origin: FloatArray
    to_rig: FloatArray
    sign: float
    clamped: float
    inflation: float
    half_mm: float
    hinge_mm: float
    calibrated: CalibrationError
    origin_sigma: float
    lateral_sigma: float
    from_picture: PictureErrors

    @property
    def down(self) -> FloatArray:
        """Direction (2,) in the plane in which the unloaded tube points."""
        return -self.to_rig[1]

    def in_rig(self, points: FloatArray) -> FloatArray:
        """Points (..., 2) of the plane in the rig frame, mm."""
        return (points - self.origin) @ self.to_rig.T


def view_of(
    rows: Rows,
    smoothed: Smoothed,
    calibration: Calibration,
    scene: Scene,
    clamp_stderr_mm: tuple[float, float | None],
    vertical: Vertical,
) -> View:
    """Gather it from all frames that were measured, whose smoothed curves are given."""
    coefficients, numbers = smoothed.coefficients, rows.good_ones("numbers")
    starts = points_on(coefficients, np.zeros(1))[:, 0]
    origin = np.median(starts[min(len(starts) // 2, 30) :], axis=0)  # the clamp does not move: all frames are averaged
    clamp = np.median(tangents(coefficients, np.zeros(1))[:, 0], axis=0)
    across = starts @ leftwards(clamp)
    down = _rest_direction(coefficients) if vertical == "rest" else scene.down
    start_variance = smoothed.variance_factor[0] * rows.good_ones("shift_variance")[:, 0]
    started = _start_stderr(across, start_variance, scene.px_per_mm)
    moved = camera_moved(across, np.sqrt(start_variance))
    missed = _end_missed(coefficients[0], scene) if rows.valid[:FIRST_TRIES].any() else 0.0
    half_mm = float(np.median(rows.good_ones("width")[:, 1:-1]))
    from_picture = picture_errors(numbers, scene.half_mm, scene.px_per_mm).grown(moved, missed)
    return View(
        origin=origin,
        to_rig=rig_axes(down),
        sign=scene.actuator.mirror,
        clamped=float(from_down(clamp @ rig_axes(down).T, scene.actuator.mirror)),
        inflation=smoothed.inflation,
        half_mm=half_mm,
        hinge_mm=half_mm if scene.hinge_mm else 0.0,
        calibrated=CalibrationError(calibration, scene.camera, coefficients, origin),
        origin_sigma=_clamp_stderr(*clamp_stderr_mm, smoothed.inflation * np.median(numbers["tip_variance"])),
        lateral_sigma=float(np.hypot(np.median(from_picture.across), started)),
        from_picture=from_picture,
    )


def _end_missed(coefficients: FloatArray, scene: Scene) -> float:
    """By how much (mm along itself) a first frame's line ends elsewhere than where its tip was pointed at, beyond what a person misses.

    An end of nearly the wall's colour ends, to its edges, where its colour does, and that as clearly as any.
    """
    if scene.tip_px is None:
        return 0.0
    x, y, tx, ty, _ = point_and_tangent(coefficients, 1.0)
    off = float((unproject(scene.camera, scene.tip_px) - np.array([x, y])) @ np.array([tx, ty]))
    pointing = max(POINTING_PX / scene.px_per_mm, POINTING_SHARE * scene.half_mm)
    return max(off**2 - pointing**2, 0.0) ** 0.5


def _rest_direction(coefficients: FloatArray) -> FloatArray:
    """Direction of the straightest frames' chord: the resting tube hangs straight down."""
    points = points_on(coefficients, np.linspace(0, 1, 33))
    chord = points[:, -1] - points[:, 0]
    length = along(points)[:, -1]
    straight = np.linalg.norm(chord, axis=1) / length
    chosen = straight >= np.quantile(straight, 1 - STRAIGHTEST_SHARE)
    down = np.median(chord[chosen] / np.linalg.norm(chord[chosen], axis=1, keepdims=True), axis=0)
    return down / np.linalg.norm(down)


def _clamp_stderr(seen: float, scatter: float | None, variance: float) -> float:
    """Standard error of the clamp along the tube, the same in all frames.

    A step in the light at the clamp is read as well as the one at the tube's end, whose variance is known. What the
    frames do not show of it by their scatter is the same in all of them: the still parts of a compressed video.
    """
    if scatter is None:
        return seen
    return float(np.hypot(seen, CLAMP_SHARE * np.sqrt(max(variance - scatter**2, 0.0))))


def _start_stderr(across: FloatArray, variance: FloatArray, px_per_mm: float) -> float:
    """Standard error of where the tube begins, `across` (t,) mm along its normal there, the same in all frames.

    Noise that changes from frame to frame averages out. What the edges miss by, and the frames do not show by their
    scatter, is the same in all of them: a compressed video repeats the still parts of its pictures.
    """
    noise = float(scatter(np.diff(across))) / np.sqrt(2) if len(across) > 4 else 0.0
    shared = STILL * max(float(np.median(variance)) - noise**2, 0.0)
    return float(np.sqrt((ORIGIN_PX / px_per_mm) ** 2 + shared + 1.57 * noise**2 / max(len(across), 1)))
