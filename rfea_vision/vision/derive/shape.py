"""From fitted curves on the plane to the track in the rig frame, with a standard error on everything."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Calibration
from rfea_vision.calibration.projection import project
from rfea_vision.scatter import scatter
from rfea_vision.vision.curve import COEFFICIENTS, WIDTH_COEFFICIENTS, basis_matrix
from rfea_vision.vision.derive.elongation import angles, elongation_of
from rfea_vision.vision.derive.markers import elongation_between, marker_elongation
from rfea_vision.vision.derive.picture_errors import ORIGIN_PX, PictureErrors, picture_errors
from rfea_vision.vision.derive.rows import Block, Rows
from rfea_vision.vision.derive.shutter import Shutter, at_one_instant
from rfea_vision.vision.derive.smooth import Smoothed, smooth
from rfea_vision.vision.derive.systematic import CalibrationError
from rfea_vision.vision.edges import fitted
from rfea_vision.vision.find.begin import Scene

STRAIGHTEST_SHARE = 0.1
WITH_BEND = 2.0  # variance that is not noise, over what of it the length shows: not what changes slowly with the bend
HEADINGS = 65  # places along the line at which its direction is read for what lies between marks
STILL = 1.5  # variance of the start across the tube, over what its scatter misses
CLAMP_SHARE = 0.7  # the clamp is read on the tube and on both sides of it, the end by its own light only
PRECISE = ("midline", "tip", "bend_angle", "elongation", "length", "hinge_length")  # kept in double precision


def build_dataset(
    rows: Rows,
    calibration: Calibration,
    scene: Scene,
    clamp_stderr_mm: tuple[float, float | None],
    vertical: str | dict[str, Any],
    attributes: dict[str, Any],
    shutter: Shutter | None = None,
) -> xr.Dataset:
    """Assemble the track's dataset; what a rolling shutter read early or late is moved to the frame's time."""
    valid = rows.valid
    numbers = rows.good_ones("numbers")
    inflation = float(np.clip(np.nanmedian(numbers[:, fitted.INFLATION]), 1.0, 50.0))
    sign = scene.actuator.mirror
    turning = rows.good_ones("shift_variance", rows.part("tip_slope").start)
    beyond = _beyond_noise(numbers, turning, inflation, -sign * scene.half_mm)
    smoothed = smooth(rows, inflation)
    unlike_noise = 1.0 + WITH_BEND * (beyond**2 - 1.0)
    smoothed = replace(smoothed, variance_factor=smoothed.variance_factor * unlike_noise)
    inflation *= unlike_noise
    if shutter is not None:
        still = at_one_instant(smoothed.coefficients, rows.good_ones("time"), scene.camera, shutter)
        smoothed = replace(smoothed, coefficients=still)
    coefficients = smoothed.coefficients
    origin = _origin(coefficients)
    down = _rest_direction(coefficients) if vertical == "rest" else scene.down
    to_rig = np.array([[-down[1], down[0]], [-down[0], -down[1]]])  # rows: camera-right, up
    calibrated = CalibrationError(calibration, scene.camera, coefficients, origin)
    half_mm = float(np.median(rows.good_ones("width")[:, 1:-1]))
    from_picture = picture_errors(numbers, scene.half_mm, scene.px_per_mm)
    start_variance = smoothed.variance_factor[0] * rows.good_ones("shift_variance", 0)
    started = _start_stderr(coefficients, start_variance, scene.px_per_mm)
    from_picture = from_picture.with_camera_moved(_start_across(coefficients), np.sqrt(start_variance))
    origin_sigma = _clamp_stderr(*clamp_stderr_mm, inflation * np.median(numbers[:, fitted.TIP_VARIANCE]))
    view = View(
        origin,
        to_rig,
        sign,
        inflation,
        half_mm,
        calibrated,
        origin_sigma,
        float(np.hypot(from_picture.shared_across, started)),
        from_picture,
    )
    time, lamp = rows.of_all("time"), rows.of_all("lamp")
    profile = rows.good_ones("profile") if rows.marked else None
    data = _in_parts(rows, smoothed, view)
    marks: dict[str, Any] = {"marker_elongation_assumption": "absent: no marks on the tube stand out of the noise"}
    marked = None
    if profile is not None:
        marked = marker_elongation(profile / 256.0, data["length"][1], numbers[:, fitted.BEND], rows.segments)
    elif any(rows.material):
        errors = np.sqrt(numbers[:, fitted.TIP_VARIANCE])
        headings = angles(coefficients, sign, np.linspace(0, 1, HEADINGS))
        marked = elongation_between(rows.material, data["length"][1], errors, headings, from_picture.across, rows.segments)
    if marked is not None:
        marks = marked.attributes
        data["marker_elongation"] = (("time", "segment"), marked.elongation)
        data["marker_elongation_sigma"] = (("time", "segment"), marked.sigma)
    length_check = _length_check(data, scene)
    variables: dict[str, Any] = {}
    for name in list(data):  # one at a time, so that little of a long recording is in memory twice
        dims, values = data.pop(name)
        variables[name] = (dims, _spread(values, valid))
    reason = np.array([text.split(":")[0] for text in rows.reasons], dtype=object).astype(str)
    variables["valid"] = (("time",), valid.astype(np.int8))
    variables["reason"] = (("time",), reason)
    details = [text.partition(": ")[2] for text in rows.reasons]
    variables["reason_detail"] = (("time",), np.array(details, dtype=object).astype(str))
    if np.isfinite(lamp).any():
        variables["lamp"] = (("time",), lamp)
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
        "length_scatter_over_noise": beyond,
        "smoothing_tau_mm": smoothed.tau_mm,
        "px_per_mm": scene.px_per_mm,
        "origin_sigma_along_mm": view.origin_sigma,
        "origin_sigma_across_mm": view.lateral_sigma,
        "origin_sigma_note": "shared by all frames and part of tip_sigma and midline_sigma: along and across the tube at its clamp",
        **length_check,
        **marks,
        **attributes,
    }
    return dataset


def _beyond_noise(numbers: FloatArray, turning: FloatArray, inflation: float, signed_half_mm: float) -> float:
    """By how much the length of the inextensible side scatters beyond the noise of the tube's end; at least 1.

    The side keeps its length, so that what its length does is error: that of a compressed picture, of a background
    that is not even, of a lamp that flickers. Edges suffer from these like the end does. A change with the bend is
    left out: it belongs to the camera.
    """
    if len(numbers) < 12:
        return 1.0
    bend = numbers[:, fitted.BEND]
    hinge = numbers[:, fitted.LENGTH] - signed_half_mm * bend
    smooth_part = np.polyval(np.polyfit(bend, hinge, 2 if np.ptp(bend) > 0.05 else 0), bend)
    seen = float(scatter(hinge - smooth_part))
    by_bend = signed_half_mm**2 * turning / numbers[:, fitted.LENGTH] ** 2
    noise = float(np.sqrt(inflation * np.median(numbers[:, fitted.TIP_VARIANCE] + by_bend)))
    return float(np.clip(seen / noise, 1.0, 10.0))


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


@dataclass(frozen=True)
class View:
    """What all frames share: the rig frame in the plane, the side of the bend, and the errors of clamp and camera."""

    origin: FloatArray
    to_rig: FloatArray
    sign: float
    inflation: float
    half_mm: float
    calibrated: CalibrationError
    origin_sigma: float
    lateral_sigma: float
    from_picture: PictureErrors


def _clamp_stderr(seen: float, scatter: float | None, variance: float) -> float:
    """Standard error of the clamp along the tube, the same in all frames.

    A step in the light at the clamp is read as well as the one at the tube's end, whose variance is known. What the
    frames do not show of it by their scatter is the same in all of them: the still parts of a compressed video.
    """
    if scatter is None:
        return seen
    return float(np.hypot(seen, CLAMP_SHARE * np.sqrt(max(variance - scatter**2, 0.0))))


def _start_stderr(coefficients: FloatArray, variance: FloatArray, px_per_mm: float) -> float:
    """Standard error across the tube of where it begins, the same in all frames.

    Noise that changes from frame to frame averages out. What the edges miss by, and the frames do not show by their
    scatter, is the same in all of them: a compressed video repeats the still parts of its pictures.
    """
    across = _start_across(coefficients)
    noise = float(scatter(np.diff(across))) / np.sqrt(2) if len(across) > 4 else 0.0
    shared = STILL * max(float(np.median(variance)) - noise**2, 0.0)
    return float(np.sqrt((ORIGIN_PX / px_per_mm) ** 2 + shared + 1.57 * noise**2 / max(len(across), 1)))


def _start_across(coefficients: FloatArray) -> FloatArray:
    """Where the curves begin, along the normal of the tube at its clamp (t,) mm."""
    first = basis_matrix(np.array([0.0]), COEFFICIENTS)[0]
    slope = np.matmul(basis_matrix(np.array([0.0]), COEFFICIENTS, 1)[0], coefficients)
    normal = np.column_stack([-slope[:, 1], slope[:, 0]]) / np.linalg.norm(slope, axis=1, keepdims=True)
    return np.sum(np.einsum("k,tkc->tc", first, coefficients) * np.median(normal, axis=0), axis=1)


def _in_parts(rows: Rows, smoothed: Smoothed, view: View) -> dict[str, Any]:
    """Everything in the rig frame, valid frames only: name -> (dims, values).

    Block by block, and each block of rows is gone when its part is made: of a long recording little is in memory twice.
    """
    count, done = len(smoothed.coefficients), 0
    out: dict[str, Any] = {}
    for block in rows.given_back():
        part = slice(done, done + len(block["time"]))
        done = part.stop
        for name, (dims, values) in _derive(rows, block, smoothed, part, view).items():
            if name not in out:
                kind = np.float64 if name in PRECISE else np.float32
                out[name] = (dims, np.empty((count, *values.shape[1:]), dtype=kind))
            out[name][1][part] = values
    return out


def _derive(rows: Rows, block: Block, smoothed: Smoothed, part: slice, view: View) -> dict[str, Any]:
    """Everything in the rig frame for the frames of `block`, which are `part` of the valid ones."""
    origin, to_rig, sign, inflation = view.origin, view.to_rig, view.sign, view.inflation
    calibrated, origin_sigma, lateral = view.calibrated, view.origin_sigma, view.lateral_sigma
    numbers, coefficients = block["numbers"], smoothed.coefficients[part]
    variances = smoothed.variance_factor * block["shift_variance"]
    variance = {name: variances[:, rows.part(name)] for name in ("node", "bend2", "tip_slope", "joint")}
    nodes = np.linspace(0, 1, rows.nodes)
    from_picture = view.from_picture
    from_picture = PictureErrors(from_picture.across[part], from_picture.smear[part], from_picture.beyond[part])
    points = np.matmul(basis_matrix(nodes, COEFFICIENTS), coefficients)
    slope = np.matmul(basis_matrix(nodes, COEFFICIENTS, 1), coefficients)
    second = np.matmul(basis_matrix(nodes, COEFFICIENTS, 2), coefficients)
    speed = np.linalg.norm(slope, axis=-1)
    tangent = slope / speed[..., None]
    left = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)  # left-hand normal, walking from clamp to tip
    half = block["width"] @ basis_matrix(nodes, WIDTH_COEFFICIENTS).T
    # Walking down, the left-hand side is the camera's right: the outside of a bend to the left.
    curvature = -sign * (tangent[..., 0] * second[..., 1] - tangent[..., 1] * second[..., 0]) / speed**2
    node_noise = np.sqrt(variance["node"])
    by_calibration = calibrated.displacement(points, left)
    node_sigma = np.sqrt(
        node_noise**2
        + from_picture.across[:, None] ** 2
        + (from_picture.smear[:, None] * nodes) ** 2
        + np.sum(by_calibration**2, axis=0)
        + origin_sigma**2 * left[..., 1] ** 2
        + lateral**2 * left[..., 0] ** 2
    )
    length = numbers[:, fitted.LENGTH]
    curvature_sigma = np.sqrt(variance["bend2"]) / length[:, None] ** 2
    width_noise = np.sqrt(inflation * block["width_variance"].astype(float))
    bend, bend_noise, bend_sigma = _bend(coefficients, to_rig, sign, variance["tip_slope"], length, calibrated)
    elongation, elongation_noise, elongation_sigma, hinge = elongation_of(
        rows.segments, coefficients, sign, variance["joint"], length, view.half_mm, calibrated
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
        (origin_sigma, lateral),
        from_picture,
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


def _bend(coefficients, to_rig, sign, variance, length, calibrated):
    u = np.linspace(0, 1, 65)
    down_plane = -to_rig[1]
    turned = np.arctan2(-sign * down_plane[0], -down_plane[1])
    angle = angles(coefficients, sign, u) - turned
    angle -= 2 * np.pi * np.round(angle[:, :1] / (2 * np.pi))
    noise = np.sqrt(variance[:, 0]) / length
    ends = np.matmul(basis_matrix(np.array([1.0]), COEFFICIENTS), coefficients)[:, 0]
    slope = np.matmul(basis_matrix(np.array([1.0]), COEFFICIENTS, 1), coefficients)[:, 0]
    tangent = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    systematic = np.sum(calibrated.rotation(ends, tangent) ** 2, axis=0)
    return angle[:, -1], noise, np.sqrt(noise**2 + systematic)


def _tip(tip_plane, tangent, origin, to_rig, inflation, numbers, normal_noise, calibrated, start, from_picture):
    axial = np.sqrt(inflation * numbers[:, fitted.TIP_VARIANCE])
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)

    def seen_in_rig(along: FloatArray, across: FloatArray) -> FloatArray:
        """Variances (t, 2) in x and y of errors along and across the tube."""
        covariance = (
            along[:, None, None] ** 2 * tangent[:, :, None] * tangent[:, None, :]
            + across[:, None, None] ** 2 * normal[:, :, None] * normal[:, None, :]
        )
        return np.einsum("ic,tcd,id->ti", to_rig, covariance, to_rig)

    noise = seen_in_rig(axial, normal_noise)
    moved = np.stack([calibrated.displacement(tip_plane, axis) for axis in to_rig], axis=-1)
    doubtful = seen_in_rig(np.hypot(from_picture.beyond, from_picture.smear), np.hypot(from_picture.across, from_picture.smear))
    total = noise + doubtful + np.sum(moved**2, axis=0)
    total[:, 1] += start[0] ** 2
    total[:, 0] += start[1] ** 2
    return (tip_plane - origin) @ to_rig.T, np.sqrt(noise), np.sqrt(total)


def _spread(values: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    if valid.all():
        return values
    out = np.full((len(valid), *values.shape[1:]), np.nan, dtype=values.dtype)
    out[valid] = values
    return out


def _length_check(data: dict[str, Any], scene: Scene) -> dict[str, Any]:
    """The inextensible side must keep its length over all postures."""
    hinge, bend = data["hinge_length"][1], data["bend_angle"][1]
    spread = float(np.ptp(np.quantile(hinge, [0.02, 0.98])))
    slope = float(np.polyfit(bend, hinge, 1)[0] * np.ptp(bend)) if len(hinge) > 10 and np.ptp(bend) > 2 else 0.0
    change = 100 * slope / float(np.median(hinge))
    off = 100 * (float(np.median(hinge)) / scene.length_mm - 1)
    said = f"the inextensible side keeps its length within {abs(change):.2g} % over all postures"
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
    if name == "lamp":
        return {"long_name": "mean grey level in the lamp's box"}
    if name in ("edge_noise", "reason", "reason_detail"):
        return {}
    units = {"curvature": "1/mm", "bend_angle": "degree", "blur": "px"}
    units |= dict.fromkeys(("valid", "seen", "elongation", "marker_elongation"), "1")
    return {"units": next((unit for begins, unit in units.items() if name.startswith(begins)), "mm")}
