"""From fitted curves on the plane to the track in the rig frame, with a standard error on everything."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numba import njit
from numpy.typing import NDArray

from rfea_vision.artefacts import Calibration
from rfea_vision.calibration.projection import perturbed_cameras, project, unproject
from rfea_vision.vision import fitted
from rfea_vision.vision.begin import Scene
from rfea_vision.vision.curve import COEFFICIENTS, WIDTH_COEFFICIENTS, basis_matrix
from rfea_vision.vision.rows import Rows
from rfea_vision.vision.smooth import Smoothed, smooth

FloatArray = NDArray[np.float64]

FINE = 257
ORIGIN_LATERAL_PX = 0.02  # what an edge of unknown blur leaves, the same in all frames
STRAIGHTEST_SHARE = 0.1


def build_dataset(
    rows: Rows,
    calibration: Calibration,
    scene: Scene,
    origin_sigma: float,
    vertical: str | dict[str, Any],
    attributes: dict[str, Any],
) -> xr.Dataset:
    """Assemble the track's dataset."""
    valid = rows.valid
    inflation = float(np.clip(np.nanmedian(rows["numbers"][valid, fitted.INFLATION]), 1.0, 50.0))
    smoothed = smooth(rows, valid, inflation)
    coefficients = smoothed.coefficients
    sign = 1.0 if scene.actuator.bends == "left" else -1.0
    origin = _origin(coefficients)
    down = _rest_direction(coefficients) if vertical == "rest" else scene.down
    to_rig = np.array([[-down[1], down[0]], [-down[0], -down[1]]])  # rows: camera-right, up
    calibrated = CalibrationError(calibration, scene.camera, coefficients, origin)
    data = _derive(rows, valid, smoothed, origin, to_rig, sign, inflation, scene, calibrated, origin_sigma)
    variables: dict[str, Any] = {name: (dims, _spread(values, valid)) for name, (dims, values) in data.items()}
    time = rows["time"]
    reason = np.array([text.split(":")[0] for text in rows.reasons], dtype=object).astype(str)
    variables["valid"] = (("time",), valid.astype(np.int8))
    variables["reason"] = (("time",), reason)
    if np.isfinite(rows["lamp"]).any():
        variables["lamp"] = (("time",), rows["lamp"])
    dataset = xr.Dataset(
        {name: xr.Variable(dims, values, _units(name)) for name, (dims, values) in variables.items()},
        coords={
            "time": ("time", time, {"units": "s", "long_name": "time on the camera's clock"}),
            "xy": ["x", "y"],
            "side": ["inner", "outer"],
            "node": (
                "node",
                np.linspace(0, 1, rows.nodes),
                {"long_name": "share of the centre line, clamp to tip", "units": "1"},
            ),
            "segment": ("segment", (np.arange(rows.segments) + 0.5) / rows.segments, {"units": "1"}),
        },
    )
    clamp_px = project(scene.camera, origin)
    dataset.attrs |= {
        "Conventions": "CF-1.10",
        "frame": "rig: origin at the middle of the first visible cross-section, x to the camera's right, y up",
        "bends": scene.actuator.bends,
        "units": "mm",
        "elongation_assumption": (
            "inextensible inner side as ruler, constant half width: "
            "centre-line over hinge-side length minus one is half width times curvature"
        ),
        "sigma_contains": "edge noise, its correlation along the tube, origin and calibration; *_noise_sigma: edge noise alone",
        "clamp_px_x": float(clamp_px[0]),
        "clamp_px_y": float(clamp_px[1]),
        "clamp_plane_x_mm": float(origin[0]),
        "clamp_plane_y_mm": float(origin[1]),
        "down_plane_x": float(down[0]),
        "down_plane_y": float(down[1]),
        "vertical": str(vertical),
        "edge_correlation_inflation": inflation,
        "smoothing_tau_mm": smoothed.tau_mm,
        "px_per_mm": scene.px_per_mm,
        **_length_check(data, scene),
        **attributes,
    }
    return dataset


def _origin(coefficients: FloatArray) -> FloatArray:
    """Middle of the first visible cross-section: the clamp does not move, so all frames are averaged."""
    first = basis_matrix(np.array([0.0]), COEFFICIENTS)[0]
    starts = np.einsum("k,tkc->tc", first, coefficients)
    return np.median(starts[min(len(starts) // 2, 30) :], axis=0)


def _rest_direction(coefficients: FloatArray) -> FloatArray:
    """Direction of the straightest frames' chord: the resting tube hangs straight down."""
    points = np.matmul(basis_matrix(np.linspace(0, 1, 33), COEFFICIENTS), coefficients)
    chord = points[:, -1] - points[:, 0]
    length = np.linalg.norm(np.diff(points, axis=1), axis=-1).sum(axis=1)
    straight = np.linalg.norm(chord, axis=1) / length
    chosen = straight >= np.quantile(straight, 1 - STRAIGHTEST_SHARE)
    down = np.median(chord[chosen] / np.linalg.norm(chord[chosen], axis=1, keepdims=True), axis=0)
    return down / np.linalg.norm(down)


class CalibrationError:
    """How the plane moves under one standard error of the calibration, along each of its principal axes.

    Every axis gives a smooth displacement field on the plane, kept as a cubic polynomial, relative to the origin.
    """

    def __init__(
        self, calibration: Calibration, camera: FloatArray, coefficients: FloatArray, origin: FloatArray
    ) -> None:
        points = np.matmul(basis_matrix(np.linspace(0, 1, 9), COEFFICIENTS), coefficients).reshape(-1, 2)
        low, high = points.min(axis=0) - 10, points.max(axis=0) + 10
        self.middle, self.half = (low + high) / 2, (high - low) / 2
        grid = np.stack(np.meshgrid(*np.linspace(low, high, 9).T), axis=-1).reshape(-1, 2)
        pixels = project(camera, grid)
        cameras = perturbed_cameras(calibration)
        fields = [unproject(other, pixels) - grid for other in cameras] or [np.zeros_like(grid)]
        terms = self._terms(grid)
        solutions = [np.linalg.lstsq(terms, np.nan_to_num(field), rcond=None)[0] for field in fields]
        self.fields = np.stack(solutions)  # (axes, 10, 2)
        self.at_origin = np.einsum("p,kpc->kc", self._terms(origin[None])[0], self.fields)

    def _scaled(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        return (points[..., 0] - self.middle[0]) / self.half[0], (points[..., 1] - self.middle[1]) / self.half[1]

    def _terms(self, points: FloatArray) -> FloatArray:
        x, y = self._scaled(points)
        return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3], axis=-1)

    def displacement(self, points: FloatArray) -> FloatArray:
        """Displacement (axes, ..., 2) mm of plane points (..., 2), relative to that of the origin."""
        moved = np.einsum("...p,kpc->k...c", self._terms(points), self.fields)
        return moved - self.at_origin.reshape(-1, *(1,) * (points.ndim - 1), 2)

    def rotation(self, points: FloatArray, tangents: FloatArray) -> FloatArray:
        """Turning (axes, ...) in rad of short lines at `points` along unit `tangents`."""
        step = 0.5
        change = self.displacement(points + step * tangents) - self.displacement(points - step * tangents)
        normal = np.stack([-tangents[..., 1], tangents[..., 0]], axis=-1)
        return np.einsum("k...c,...c->k...", change, normal) / (2 * step)


def _derive(
    rows, valid, smoothed: Smoothed, origin, to_rig, sign, inflation, scene, calibrated: CalibrationError, origin_sigma
):
    """Everything in the rig frame, valid frames only: name -> (dims, values)."""
    numbers, coefficients = rows["numbers"][valid], smoothed.coefficients
    variance = {name: smoothed.variance[:, rows.part(name)] for name in ("node", "bend2", "tip_slope", "joint")}
    nodes = np.linspace(0, 1, rows.nodes)
    points = np.matmul(basis_matrix(nodes, COEFFICIENTS), coefficients)
    slope = np.matmul(basis_matrix(nodes, COEFFICIENTS, 1), coefficients)
    second = np.matmul(basis_matrix(nodes, COEFFICIENTS, 2), coefficients)
    speed = np.linalg.norm(slope, axis=-1)
    tangent = slope / speed[..., None]
    left = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)  # left-hand normal, walking from clamp to tip
    half = rows["width"][valid] @ basis_matrix(nodes, WIDTH_COEFFICIENTS).T
    # Walking down, the left-hand side is the camera's right: the outside of a bend to the left.
    curvature = -sign * (tangent[..., 0] * second[..., 1] - tangent[..., 1] * second[..., 0]) / speed**2
    node_noise = np.sqrt(variance["node"])
    by_calibration = np.einsum("ktuc,tuc->ktu", calibrated.displacement(points), left)
    lateral = ORIGIN_LATERAL_PX / scene.px_per_mm
    node_sigma = np.sqrt(
        node_noise**2
        + np.sum(by_calibration**2, axis=0)
        + origin_sigma**2 * left[..., 1] ** 2
        + lateral**2 * left[..., 0] ** 2
    )
    length = numbers[:, fitted.LENGTH]
    curvature_sigma = np.sqrt(variance["bend2"]) / length[:, None] ** 2
    width_noise = np.sqrt(inflation * rows["width_variance"][valid].astype(float))
    bend, bend_noise, bend_sigma = _bend(coefficients, to_rig, sign, variance["tip_slope"], length, calibrated)
    elongation, elongation_noise, elongation_sigma, hinge = _elongation(
        rows.segments, coefficients, sign, variance["joint"], length, half, calibrated
    )
    tip, tip_noise, tip_sigma = _tip(
        points[:, -1],
        tangent[:, -1],
        origin,
        to_rig,
        inflation,
        numbers,
        node_noise[:, -1],
        calibrated,
        origin_sigma,
        ORIGIN_LATERAL_PX / scene.px_per_mm,
    )
    inner, outer = points - sign * half[..., None] * left, points + sign * half[..., None] * left
    rig = lambda p: (p - origin) @ to_rig.T  # noqa: E731
    series, space = ("time",), ("time", "node")
    return {
        "midline": (("time", "node", "xy"), rig(points)),
        "midline_sigma": (space, node_sigma),
        "midline_noise_sigma": (space, node_noise),
        "edges": (("time", "side", "node", "xy"), np.stack([rig(inner), rig(outer)], axis=1)),
        "width": (space, 2 * half),
        "width_sigma": (space, 2 * width_noise),
        "curvature": (space, curvature),
        "curvature_sigma": (space, curvature_sigma),
        "tip": (("time", "xy"), tip),
        "tip_sigma": (("time", "xy"), tip_sigma),
        "tip_noise_sigma": (("time", "xy"), tip_noise),
        "bend_angle": (series, np.degrees(bend)),
        "bend_angle_sigma": (series, np.degrees(bend_sigma)),
        "bend_angle_noise_sigma": (series, np.degrees(bend_noise)),
        "elongation": (("time", "segment"), elongation),
        "elongation_sigma": (("time", "segment"), elongation_sigma),
        "elongation_noise_sigma": (("time", "segment"), elongation_noise),
        "length": (series, length),
        "hinge_length": (series, hinge),
        "edge_noise": (series, numbers[:, fitted.NOISE]),
        "blur": (series, numbers[:, fitted.BLUR]),
        "seen": (series, np.minimum(numbers[:, fitted.USED], 1.0)),
    }


def _angles(coefficients: FloatArray, sign: float, u: FloatArray) -> FloatArray:
    """Unwrapped tangent angle at `u` in the plane frame, from straight down, positive towards the bend, (t, len(u))."""
    slope = np.matmul(basis_matrix(u, COEFFICIENTS, 1), coefficients)
    return np.unwrap(np.arctan2(-sign * slope[..., 0], -slope[..., 1]), axis=1)


def _bend(coefficients, to_rig, sign, variance, length, calibrated):
    u = np.linspace(0, 1, 65)
    down_plane = -to_rig[1]
    turned = np.arctan2(-sign * down_plane[0], -down_plane[1])
    angle = _angles(coefficients, sign, u) - turned
    angle -= 2 * np.pi * np.round(angle[:, :1] / (2 * np.pi))
    noise = np.sqrt(variance[:, 0]) / length
    ends = np.matmul(basis_matrix(np.array([1.0]), COEFFICIENTS), coefficients)[:, 0]
    slope = np.matmul(basis_matrix(np.array([1.0]), COEFFICIENTS, 1), coefficients)[:, 0]
    tangent = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    systematic = np.sum(calibrated.rotation(ends, tangent) ** 2, axis=0)
    return angle[:, -1], noise, np.sqrt(noise**2 + systematic)


@njit(cache=True, nogil=True)
def _centre_over_hinge(hinge, centre, segments):
    """Centre-line length over hinge-side length minus one, (t, segments), for parts even along the hinge side."""
    frames, fine = hinge.shape
    out = np.empty((frames, segments))
    for t in range(frames):
        k = 0
        before = 0.0
        part = hinge[t, fine - 1] / segments
        for j in range(segments):
            target = part * (j + 1)
            while k < fine - 2 and hinge[t, k + 1] < target:
                k += 1
            share = (target - hinge[t, k]) / max(hinge[t, k + 1] - hinge[t, k], 1e-12)
            here = centre[t, k] + share * (centre[t, k + 1] - centre[t, k])
            out[t, j] = (here - before) / part - 1.0
            before = here
    return out


def _elongation(segments, coefficients, sign, variance, length, half, calibrated):
    """Centre-line over hinge-side length minus one, for segments even along the hinge side (PHYSICS 1)."""
    u = np.linspace(0, 1, FINE)
    speed = np.linalg.norm(np.matmul(basis_matrix(u, COEFFICIENTS, 1), coefficients), axis=-1)
    centre = np.concatenate(
        [np.zeros((len(speed), 1)), np.cumsum(0.5 * (speed[:, 1:] + speed[:, :-1]), axis=1) / (FINE - 1)], axis=1
    )
    angle = _angles(coefficients, sign, u)
    radius = float(np.median(half))
    hinge = centre - radius * (angle - angle[:, :1])
    out = _centre_over_hinge(hinge, centre, segments)
    step = hinge[:, -1:] / segments
    noise = radius * np.sqrt(variance) / length[:, None] / step
    at = np.matmul(basis_matrix(np.linspace(0, 1, segments + 1), COEFFICIENTS), coefficients)
    slope = np.matmul(basis_matrix(np.linspace(0, 1, segments + 1), COEFFICIENTS, 1), coefficients)
    tangent = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    turning = np.diff(calibrated.rotation(at, tangent), axis=-1)
    systematic = np.sum((radius * turning / step[None]) ** 2, axis=0)
    return out, noise, np.sqrt(noise**2 + systematic), hinge[:, -1]


def _tip(tip_plane, tangent, origin, to_rig, inflation, numbers, normal_noise, calibrated, origin_sigma, lateral_sigma):
    axial = np.sqrt(inflation * numbers[:, fitted.TIP_VARIANCE])
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    covariance = (
        axial[:, None, None] ** 2 * tangent[:, :, None] * tangent[:, None, :]
        + normal_noise[:, None, None] ** 2 * normal[:, :, None] * normal[:, None, :]
    )
    noise = np.einsum("ic,tcd,id->ti", to_rig, covariance, to_rig)
    moved = calibrated.displacement(tip_plane) @ to_rig.T
    total = noise + np.sum(moved**2, axis=0)
    total[:, 1] += origin_sigma**2
    total[:, 0] += lateral_sigma**2
    return (tip_plane - origin) @ to_rig.T, np.sqrt(noise), np.sqrt(total)


def _spread(values: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    out = np.full((len(valid), *values.shape[1:]), np.nan)
    out[valid] = values
    return out


def _length_check(data: dict[str, Any], scene: Scene) -> dict[str, Any]:
    """The inextensible side must keep its length over all postures."""
    hinge, bend = data["hinge_length"][1], data["bend_angle"][1]
    spread = float(np.ptp(np.quantile(hinge, [0.02, 0.98])))
    slope = float(np.polyfit(bend, hinge, 1)[0] * np.ptp(bend)) if len(hinge) > 10 and np.ptp(bend) > 2 else 0.0
    change = 100 * slope / float(np.median(hinge))
    off = 100 * (float(np.median(hinge)) / scene.length_mm - 1)
    said = f"the inextensible side keeps its length within {abs(change):.2f} % over all postures"
    if abs(change) > 1.0:
        said = f"the inextensible side changes by {change:+.1f} % with the bend: suspect plane tilt, lens or scale"
    if abs(off) > 3.0:
        said += f"; it measures {off:+.1f} % against actuator.length: check the board's square and the length"
    return {
        "hinge_length_mm": float(np.median(hinge)),
        "hinge_length_spread_mm": spread,
        "hinge_length_change_percent": change,
        "length_check": said,
    }


def _units(name: str) -> dict[str, str]:
    if name.startswith("curvature"):
        return {"units": "1/mm"}
    if name.startswith("bend_angle"):
        return {"units": "degree"}
    if name in ("valid", "seen") or name.startswith("elongation"):
        return {"units": "1"}
    if name == "blur":
        return {"units": "px"}
    if name == "lamp":
        return {"long_name": "mean grey level in the lamp's box"}
    if name in ("edge_noise", "reason"):
        return {}
    return {"units": "mm"}
