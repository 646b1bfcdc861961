"""From fitted curves on the plane to the track in the rig frame, with a standard error on everything."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Calibration
from rfea_vision.artefacts.measurement import Vertical
from rfea_vision.calibration.projection import project
from rfea_vision.lines import from_down, leftwards
from rfea_vision.vision.curve import WIDTH_COEFFICIENTS, basis_matrix, points_on, tangents
from rfea_vision.vision.derive.elongation import angles, beside_kinks, elongation_of
from rfea_vision.vision.derive.markers import elongation_between, marker_elongation
from rfea_vision.vision.derive.picture_errors import PictureErrors
from rfea_vision.vision.derive.rows import Rows
from rfea_vision.vision.derive.shutter import Shutter, at_one_instant
from rfea_vision.vision.derive.smooth import Smoothed, smooth
from rfea_vision.vision.derive.view import View, view_of
from rfea_vision.vision.find.begin import Scene

HEADINGS = 65  # places along the line at which its direction is read for what lies between marks
PRECISE = ("midline", "tip", "bend_angle", "elongation", "length", "hinge_length")  # kept in double precision

AS_RULER = (
    "inextensible inner side as ruler, constant half width: "
    "centre-line over hinge-side length minus one is half width times curvature"
)
#: Share by which the middle may grow otherwise than by half the thickness per rad where an inner side is told to keep it: scale
#: and thickness are known to a tenth each, and a layer gives a little.
AS_ABOUT_SIDE = 0.25
NO_RULER = "absent: a beam bends about its middle, and how its parts stretch is told by marks on it alone"

Derived = dict[str, tuple[tuple[str, ...], NDArray[Any]]]
"""Variables of the track by name: dimensions and values."""


def build_dataset(
    rows: Rows,
    calibration: Calibration,
    scene: Scene,
    clamp_stderr_mm: tuple[float, float | None],
    vertical: Vertical,
    attributes: dict[str, Any],
    shutter: Shutter | None = None,
) -> xr.Dataset:
    """Assemble the track's dataset; what a rolling shutter read early or late is moved to the frame's time."""
    numbers = rows.good_ones("numbers")
    of_body = attributes.get("followed_by") == "body"
    smoothed = _smoothed(rows, scene, shutter, of_body=of_body)
    view = view_of(rows, smoothed, calibration, scene, clamp_stderr_mm, vertical)
    time, lamp, seen_from = (rows.of_all(name) for name in ("time", "lamp", "view"))
    profile = np.array(rows.profiles) if rows.marked else None
    data = _in_parts(rows, smoothed, view)
    marks = _add_marker_elongation(data, rows, numbers, profile, smoothed, view)
    turned = np.degrees(np.diff(angles(smoothed.coefficients, view.sign, np.linspace(0, 1, HEADINGS))[:, [0, -1]], axis=1)[:, 0])
    length_check = _length_check(data["hinge_length"][1], turned, scene, of_body=of_body)
    variables = _of_all_frames(data, rows)
    if np.isfinite(lamp).any():
        variables["lamp"] = (("time",), lamp)
    if np.ptp(seen_from, axis=0).any():
        variables["view"] = (("time", "row", "column"), seen_from)
    dataset = xr.Dataset(
        {name: xr.Variable(dims, values, _units(name)) for name, (dims, values) in variables.items()},
        coords={
            "time": ("time", time, {"units": "s", "long_name": "time on the camera's clock"}),
            "xy": ["x", "y"],
            "side": ["inner", "outer"],
            "node": ("node", np.linspace(0, 1, rows.nodes), {"long_name": "share of the centre line, clamp to tip", "units": "1"}),
            "segment": ("segment", (np.arange(rows.segments) + 0.5) / rows.segments, {"units": "1"}),
        },
    )
    dataset.attrs |= {
        **_said(scene, view, vertical),
        "edge_correlation_inflation": smoothed.inflation,
        "smoothing_tau_mm": smoothed.tau_mm,
        **length_check,
        **marks,
        **attributes,
    }
    return dataset


def _said(scene: Scene, view: View, vertical: Vertical) -> dict[str, Any]:
    """What a track says of its frame, of what it assumes, and of what its errors hold."""
    clamp_px = project(scene.camera, view.origin)
    return {
        "Conventions": "CF-1.10",
        "frame": "rig: origin at the middle of the first visible cross-section, x to the camera's right, y up",
        "bends": scene.actuator.bends,
        "units": "mm",
        "length_kept_by": "inner side" if view.hinge_mm else "middle",
        "elongation_assumption": AS_RULER if view.hinge_mm else NO_RULER,
        "sigma_contains": (
            "edge noise, its correlation along the tube, what the pictures may lead astray, origin and calibration; "
            "*_noise_sigma: edge noise alone"
        ),
        "clamp_px_x": float(clamp_px[0]),
        "clamp_px_y": float(clamp_px[1]),
        "clamp_plane_x_mm": float(view.origin[0]),
        "clamp_plane_y_mm": float(view.origin[1]),
        "down_plane_x": float(view.down[0]),
        "down_plane_y": float(view.down[1]),
        "vertical": str(vertical),
        "px_per_mm": scene.px_per_mm,
        "origin_sigma_along_mm": view.origin_sigma,
        "origin_sigma_across_mm": view.lateral_sigma,
        "origin_sigma_note": "shared by all frames and part of tip_sigma and midline_sigma: along and across the tube at its clamp",
    }


def _smoothed(rows: Rows, scene: Scene, shutter: Shutter | None, *, of_body: bool) -> Smoothed:
    """The curves of all measured frames; that of a body holds what is known of it besides the picture, which no scatter scales."""
    smoothed = smooth(rows, inflated=not of_body)
    if shutter is not None:
        still = at_one_instant(smoothed.coefficients, rows.good_ones("time"), scene.camera, shutter)
        smoothed = replace(smoothed, coefficients=still)
    return smoothed


def _add_marker_elongation(
    data: Derived, rows: Rows, numbers: NDArray[Any], profile: NDArray[Any] | None, smoothed: Smoothed, view: View
) -> dict[str, Any]:
    """Add what marks on the tube tell of its elongation, where there are any; what the track says of them."""
    length = data["length"][1]
    if profile is not None:
        marked = marker_elongation(profile / 256.0, length, numbers["bend"], rows.segments)
    elif any(rows.material):
        errors = np.sqrt(numbers["tip_variance"])
        headings = angles(smoothed.coefficients, view.sign, np.linspace(0, 1, HEADINGS))
        across = view.from_picture.across
        marked = elongation_between(rows.material, length, errors, headings, across, rows.segments)
    else:
        marked = None
    if marked is None:
        return {"marker_elongation_assumption": "absent: no marks on the tube stand out of the noise"}
    data["marker_elongation"] = (("time", "segment"), marked.elongation)
    data["marker_elongation_sigma"] = (("time", "segment"), marked.sigma)
    return marked.attributes


def _of_all_frames(data: Derived, rows: Rows) -> Derived:
    """The same for all frames, NaN where one was not measured, and why it was not; what is taken from `data` is no longer there."""
    valid = rows.valid
    variables: Derived = {}
    for name in list(data):  # one at a time, so that little of a long recording is in memory twice
        dims, values = data.pop(name)
        if not valid.all():
            measured, values = values, np.full((len(valid), *values.shape[1:]), np.nan, dtype=values.dtype)
            values[valid] = measured
        variables[name] = (dims, values)
    variables["valid"] = (("time",), valid.astype(np.int8))
    for name, texts in (
        ("reason", [text.split(":")[0] for text in rows.reasons]),
        ("reason_detail", [text.partition(": ")[2] for text in rows.reasons]),
    ):
        variables[name] = (("time",), np.array(texts, dtype=object).astype(str))
    return variables


def _in_parts(rows: Rows, smoothed: Smoothed, view: View) -> Derived:
    """Everything in the rig frame, valid frames only.

    Block by block, and each block of rows is gone when its part is made: of a long recording little is in memory twice.
    """
    count, done = len(smoothed.coefficients), 0
    out: Derived = {}
    for block in rows.given_back():
        part = slice(done, done + len(block["time"]))
        done = part.stop
        for name, (dims, values) in _derive(rows, block, smoothed, part, view).items():
            if name not in out:
                kind = np.float64 if name in PRECISE else np.float32
                out[name] = (dims, np.empty((count, *values.shape[1:]), dtype=kind))
            out[name][1][part] = values
    return out


@dataclass(frozen=True)
class _Line:
    """Points, tangents and left-hand normals, walking from clamp to tip: (t, nodes, 2); curvature (t, nodes) 1/mm."""

    points: FloatArray
    tangent: FloatArray
    left: FloatArray
    curvature: FloatArray


def _line_of(coefficients: FloatArray, nodes: FloatArray, sign: float) -> _Line:
    points, slope, second = (points_on(coefficients, nodes, derivative) for derivative in range(3))
    speed = np.linalg.norm(slope, axis=-1)
    tangent = slope / speed[..., None]
    # Walking down, the left-hand side is the camera's right: the outside of a bend to the left.
    curvature = -sign * (tangent[..., 0] * second[..., 1] - tangent[..., 1] * second[..., 0]) / speed**2
    return _Line(points, tangent, leftwards(tangent), curvature)


def _derive(rows: Rows, block: NDArray[Any], smoothed: Smoothed, part: slice, view: View) -> Derived:
    """Everything in the rig frame for the frames of `block`, which are `part` of the valid ones."""
    numbers, coefficients = block["numbers"], smoothed.coefficients[part]
    variances = smoothed.variance_factor * block["shift_variance"]
    variance = {name: variances[:, columns] for name, columns in rows.parts.items()}
    nodes = np.linspace(0, 1, rows.nodes)
    from_picture = view.from_picture.part(part)
    line = _line_of(coefficients, nodes, view.sign)
    node_noise = np.sqrt(variance["node"])
    node_sigma = _node_sigma(line, nodes, node_noise, from_picture, view)
    half = block["width"] @ basis_matrix(nodes, WIDTH_COEFFICIENTS).T
    length = numbers["length"]
    reach = int(np.ceil(view.half_mm * (rows.nodes - 1) / float(np.median(length))))
    kinked = beside_kinks(view.half_mm * line.curvature, np.abs(line.curvature), reach)
    bent_noise = np.sqrt(variance["bend2"]) / length[:, None] ** 2
    curvature_sigma = np.hypot(np.hypot(bent_noise, from_picture.bent[:, None]), kinked)
    width_noise = np.sqrt(view.inflation * block["width_variance"].astype(float))
    bend, bend_noise, bend_sigma = _bend(coefficients, variance["tip_slope"], length, from_picture, view)
    elongation, elongation_noise, elongation_sigma, hinge = elongation_of(
        rows.segments, coefficients, view.sign, variance["joint"], length, view.hinge_mm, view.calibrated, from_picture
    )
    tip, tip_noise, tip_sigma = _tip(line, numbers, node_noise[:, -1], from_picture, view)
    to_side = view.sign * half[..., None] * line.left
    sides = [view.in_rig(line.points - to_side), view.in_rig(line.points + to_side)]
    series, space, segments = ("time",), ("time", "node"), ("time", "segment")
    stretched: Derived = {
        "elongation": (segments, elongation),
        "elongation_sigma": (segments, elongation_sigma),
        "elongation_noise_sigma": (segments, elongation_noise),
    }
    return {
        "midline": (("time", "node", "xy"), view.in_rig(line.points)),
        "midline_sigma": (space, node_sigma),
        "midline_noise_sigma": (space, node_noise),
        "edges": (("time", "side", "node", "xy"), np.stack(sides, axis=1)),
        "width": (space, 2 * half),
        "width_sigma": (space, 2 * width_noise),
        "curvature": (space, line.curvature),
        "curvature_sigma": (space, curvature_sigma),
        "tip": (("time", "xy"), tip),
        "tip_sigma": (("time", "xy"), tip_sigma),
        "tip_noise_sigma": (("time", "xy"), tip_noise),
        "bend_angle": (series, np.degrees(bend)),
        "bend_angle_sigma": (series, np.degrees(bend_sigma)),
        "bend_angle_noise_sigma": (series, np.degrees(bend_noise)),
        **(stretched if view.hinge_mm else {}),
        "length": (series, length),
        "hinge_length": (series, hinge),
        "edge_noise": (series, numbers["noise"]),
        "blur": (series, numbers["blur"]),
        "seen": (series, np.minimum(numbers["used"], 1.0)),
    }


def _node_sigma(
    line: _Line, nodes: FloatArray, noise: FloatArray, from_picture: PictureErrors, view: View
) -> FloatArray:
    """Standard errors (t, nodes) across the tube: noise, pictures, calibration and the clamp."""
    return np.sqrt(
        noise**2
        + from_picture.across[:, None] ** 2
        + (from_picture.smear[:, None] * nodes) ** 2
        + np.sum(view.calibrated.displacement(line.points, line.left) ** 2, axis=0)
        + view.origin_sigma**2 * line.left[..., 1] ** 2
        + view.lateral_sigma**2 * line.left[..., 0] ** 2
    )


def _bend(
    coefficients: FloatArray, variance: FloatArray, length: FloatArray, from_picture: PictureErrors, view: View
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angle of the tangent at the tip from that at rest, its noise and its standard error: (t,) rad each."""
    u = np.linspace(0, 1, 65)
    angle = angles(coefficients, view.sign, u) - from_down(view.down, view.sign)
    angle -= 2 * np.pi * np.round((angle[:, :1] - view.clamped) / (2 * np.pi))  # all frames' by the same turns
    noise = np.sqrt(variance[:, 0]) / length
    end = np.ones(1)
    rotation = view.calibrated.rotation(points_on(coefficients, end)[:, 0], tangents(coefficients, end)[:, 0])
    systematic = np.sum(rotation**2, axis=0)
    return angle[:, -1], noise, np.sqrt(noise**2 + systematic + from_picture.turned**2)


def _tip(
    line: _Line, numbers: NDArray[Any], normal_noise: FloatArray, from_picture: PictureErrors, view: View
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place of the tip in the rig frame, its noise and its standard errors: (t, 2) mm each."""
    tip_plane, tangent = line.points[:, -1], line.tangent[:, -1]
    axial = np.sqrt(view.inflation * numbers["tip_variance"])
    normal = line.left[:, -1]

    def seen_in_rig(along: FloatArray, across: FloatArray) -> FloatArray:
        """Variances (t, 2) in x and y of errors along and across the tube."""
        covariance = (
            along[:, None, None] ** 2 * tangent[:, :, None] * tangent[:, None, :]
            + across[:, None, None] ** 2 * normal[:, :, None] * normal[:, None, :]
        )
        return np.einsum("ic,tcd,id->ti", view.to_rig, covariance, view.to_rig)

    noise = seen_in_rig(axial, normal_noise)
    moved = np.stack([view.calibrated.displacement(tip_plane, axis) for axis in view.to_rig], axis=-1)
    doubtful = seen_in_rig(np.hypot(from_picture.beyond, from_picture.smear), np.hypot(from_picture.across, from_picture.smear))
    total = noise + doubtful + np.sum(moved**2, axis=0)
    total[:, 1] += view.origin_sigma**2
    total[:, 0] += view.lateral_sigma**2
    return view.in_rig(tip_plane), np.sqrt(noise), np.sqrt(total)


def _length_check(hinge: FloatArray, bend: FloatArray, scene: Scene, *, of_body: bool) -> dict[str, Any]:
    """The inextensible side must keep its length over all postures; a body that was followed may have none, and a beam stretch.

    `hinge` (t,) mm is that length, or a beam's own, `bend` (t,) deg the turn from the clamp's tangent to the tip's: how the rig stands
    is no posture.
    """
    line, may_stretch = ("inextensible side", of_body) if scene.hinge_mm else ("middle", True)
    spread = float(np.ptp(np.quantile(hinge, [0.02, 0.98])))
    slope = float(np.polyfit(bend, hinge, 1)[0]) if len(hinge) > 10 and np.ptp(bend) > 2 else 0.0
    change = 100 * slope * float(np.ptp(bend)) / float(np.median(hinge))
    # The length that is given is that at rest: of a body that stretches with the bend, that of its straightest posture.
    rest = float(np.median(hinge)) - (slope * float(np.median(bend) - bend[np.argmin(np.abs(bend))]) if may_stretch else 0.0)
    off = 100 * (rest / scene.length_mm - 1)
    said = f"the {line} keeps its length within {abs(change):.2g} % over all postures"
    if abs(change) > 1.0:
        said = f"the {line} changes by {change:+.1f} % with the bend"
        tilted = ", as one that stretches does, or one in a plane that is tilted"
        said += tilted if may_stretch else ": suspect plane tilt, lens or scale"
        # a body whose inner side keeps its length has a middle that grows by half its thickness for each rad
        if not scene.hinge_mm and abs(np.degrees(slope) / scene.half_mm - 1) < AS_ABOUT_SIDE:
            said += ", or one that bends about a layer on its inner side that does not stretch ('keeps: side' in actuator.section)"
    if abs(off) > 3.0:
        scales = "the board's square (or camera.scale)"
        checked = "the length, and that camera.clamp and camera.tip are its ends"
        seen = "the length, and by 'rfea track --preview' that the line ends at the tip (camera.tip says where it is)"
        checks = f"{scales}, {checked if scene.is_pointed_at else seen}"
        said += f"; it measures {off:+.1f} % against actuator.length: check {checks}"
    return {
        "hinge_length_mm": float(np.median(hinge)),
        "hinge_length_spread_mm": spread,
        "hinge_length_change_percent": change,
        "length_check": said,
    }


def _units(name: str) -> dict[str, str]:
    told = {"lamp": "mean grey level in the lamp's box", "view": "affine map from a pixel of the first frame to that in this one"}
    if name in told:
        return {"long_name": told[name]}
    if name in ("edge_noise", "reason", "reason_detail"):
        return {}
    units = {"curvature": "1/mm", "bend_angle": "degree", "blur": "px"}
    units |= dict.fromkeys(("valid", "seen", "elongation", "marker_elongation"), "1")
    return {"units": next((unit for begins, unit in units.items() if name.startswith(begins)), "mm")}
