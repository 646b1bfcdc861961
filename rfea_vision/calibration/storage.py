"""`camera.yaml`: an OpenCV FileStorage file, so that other tools can open it; ROS camera_info is read and written too."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import yaml

from rfea_vision.artefacts import Calibration
from rfea_vision.artefacts.lenses import LENSES, lens_of
from rfea_vision.artefacts.rows import CalibrationQuality
from rfea_vision.calibration.scale import assumed_pose_covariance
from rfea_vision.campaign.yaml_file import parse_yaml, read_text
from rfea_vision.errors import InputError
from rfea_vision.files import whole_file, write_text

_CHUNK = 1000  # OpenCV's parser limits the length of a string
_ARRAYS = (
    "plane_rotation",
    "plane_translation_mm",
    "plane_pose_covariance",
    "intrinsics_covariance",
    "joint_covariance",
)
# as OpenCV's samples, ROS 2 messages and common scripts write them
_ALIASES = {
    "camera_matrix": ("cameramatrix", "intrinsic_matrix", "mtx", "k", "m1"),
    "distortion_coefficients": ("distcoeffs", "dist_coeffs", "distortion", "dist", "d", "d1"),
    "image_width": ("width",),
    "image_height": ("height",),
}


def save_calibration(path: Path, calibration: Calibration) -> None:
    """Write `calibration` as OpenCV FileStorage YAML, whole or not at all."""
    with whole_file(path) as temporary:
        storage = cv2.FileStorage(str(temporary), cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_FORMAT_YAML)
        storage.write("image_width", calibration.image_width)
        storage.write("image_height", calibration.image_height)
        storage.write("camera_matrix", calibration.camera_matrix)
        storage.write("distortion_coefficients", np.asarray(calibration.distortion).reshape(-1, 1))
        storage.write("distortion_model", LENSES[calibration.model].names[0])
        storage.write("model", calibration.model)
        storage.write("rms", calibration.rms_px)
        storage.write("avg_reprojection_error", calibration.rms_px)
        storage.write("covariance", calibration.intrinsics_covariance)
        for name in _ARRAYS:
            value = getattr(calibration, name)
            if value is not None:
                storage.write(name, np.atleast_2d(value))
        storage.write("plane_tilt_deg", calibration.plane_tilt_deg)
        storage.write("vertical", calibration.vertical)
        for name, value in (("photos_json", calibration.photos), ("quality_json", calibration.quality)):
            text = json.dumps(value)
            storage.startWriteStruct(name, cv2.FILE_NODE_SEQ)
            for start in range(0, len(text), _CHUNK):
                storage.write("", "|" + text[start : start + _CHUNK])
            storage.endWriteStruct()
        storage.release()


def save_ros(path: Path, calibration: Calibration) -> None:
    """Write a ROS camera_info file, as `camera_calibration_parsers` reads it; whole or not at all.

    The plane of motion and the covariances have no place in such a file.
    """

    def matrix(values: np.ndarray) -> dict[str, Any]:
        table = np.atleast_2d(np.asarray(values, dtype=float))
        return {"rows": table.shape[0], "cols": table.shape[1], "data": [float(v) for v in table.ravel()]}

    content = {
        "image_width": int(calibration.image_width),
        "image_height": int(calibration.image_height),
        "camera_name": "camera",
        "camera_matrix": matrix(calibration.camera_matrix),
        "distortion_model": LENSES[calibration.model].names[0],
        "distortion_coefficients": matrix(np.ravel(calibration.distortion)),
        "rectification_matrix": matrix(np.eye(3)),
        "projection_matrix": matrix(np.column_stack([calibration.camera_matrix, np.zeros(3)])),
    }
    write_text(path, yaml.safe_dump(content, sort_keys=False))


def load_calibration(path: Path) -> Calibration:
    """Read a calibration of this package, of OpenCV, or a ROS camera_info file.

    Raises
    ------
    InputError
        If the file is missing or lacks the camera matrix.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as a camera file; give an OpenCV or ROS YAML file") from error
    try:
        storage = text.startswith("%YAML") or text.lstrip().startswith(("<?xml", "<opencv_storage"))
        values = _with_usual_names(_read_opencv(path) if storage else _read_ros(text))
    except (
        cv2.error,
        yaml.YAMLError,
        TypeError,
        ValueError,
        KeyError,
        SystemError,
        RecursionError,
        AttributeError,
    ) as error:
        raise InputError(f"{path}: not an OpenCV or ROS camera file; calibrate from photos instead") from error
    if values.get("camera_matrix") is None:
        # a profile of calib/
        remedy = "calibrate from photos" if "title" in values else "give an OpenCV or ROS camera file"
        raise InputError(f"{path}: camera_matrix is missing; {remedy}")
    return _from_values(path, values)


def _with_usual_names(values: dict[str, Any]) -> dict[str, Any]:
    """Bring names that other tools use to OpenCV's own; a flat list of nine is a matrix."""
    for name, others in _ALIASES.items():
        for other in others:
            if values.get(name) is None and values.get(other) is not None:
                values[name] = values[other]
    return values


def _read_opencv(path: Path) -> dict[str, Any]:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    values: dict[str, Any] = {}
    root = storage.root()
    for name in root.keys():  # noqa: SIM118 - a FileNode is no dict
        node = root.getNode(name)
        if node.isMap():
            values[name.lower()] = node.mat()
        elif node.isString():
            values[name.lower()] = node.string()
        elif node.isReal() or node.isInt():
            values[name.lower()] = node.real()
        elif node.isSeq() and name.lower() in ("k", "d"):
            values[name.lower()] = [node.at(i).real() for i in range(node.size())]
        elif node.isSeq() and name.endswith("_json"):
            pieces = (node.at(i).string()[1:] for i in range(node.size()))
            values[name.lower()] = json.loads("".join(pieces))
    storage.release()
    values.setdefault("rms", values.get("avg_reprojection_error"))
    return values


def _read_ros(text: str) -> dict[str, Any]:
    raw, _ = parse_yaml(text)
    if not isinstance(raw, dict):
        raise TypeError("no keys in it")
    values: dict[str, Any] = {str(key).lower(): value for key, value in raw.items()}
    for name in ("camera_matrix", "distortion_coefficients"):
        block = values.get(name)
        if isinstance(block, dict):
            values[name] = block.get("data")
    return values


def _from_values(path: Path, values: dict[str, Any]) -> Calibration:
    matrix = _matrix(path, values["camera_matrix"])
    coefficients = _coefficients(path, values)
    used = int(np.max(np.flatnonzero(coefficients), initial=-1)) + 1
    named = str(values.get("distortion_model") or "")
    model = values.get("model") or lens_of(named, used)
    if model is None:
        known = ", ".join(lens.names[0] for lens in LENSES.values())
        raise InputError(f"{path}: distortion_model '{named}' is not supported; use one of {known}")
    if model not in LENSES:
        raise InputError(f"{path}: model '{model}' is not supported; use {' or '.join(LENSES)}")
    count, most = LENSES[model].coefficients, max(lens.coefficients for lens in LENSES.values())
    if used > count:
        more = f"no lens model here has {used} coefficients; calibrate with at most {most}"
        few = f"distortion_coefficients has {len(coefficients)} numbers, {model} has {count}; correct distortion_model"
        raise InputError(f"{path}: {more if used > most else few}")
    distortion = np.zeros(count)
    distortion[: min(count, len(coefficients))] = coefficients[:count]
    width, height = (_pixels(path, values, name) for name in ("image_width", "image_height"))
    if not (0 < matrix[0, 2] < width and 0 < matrix[1, 2] < height):
        raise InputError(
            f"{path}: camera_matrix: its middle ({matrix[0, 2]:g}, {matrix[1, 2]:g}) lies outside of the picture of "
            f"{width} x {height} px; give image_width and image_height as the camera was calibrated, and the matrix row by row"
        )
    parameters = 4 + count
    nothing = np.zeros((parameters, parameters))
    joint = values.get("joint_covariance")
    translation = np.ravel(np.asarray(values.get("plane_translation_mm", np.full(3, np.nan)), dtype=float))
    unassessed = {"note": f"taken from {path.name}: its uncertainty is not known"}
    unknown = assumed_pose_covariance(translation)  # of a plane that was written by hand
    return Calibration(
        image_width=width,
        image_height=height,
        camera_matrix=matrix,
        distortion=distortion,
        model=model,
        rms_px=float(values.get("rms") or np.nan),
        intrinsics_covariance=np.asarray(values.get("intrinsics_covariance", nothing), dtype=float),
        plane_rotation=np.asarray(values.get("plane_rotation", np.eye(3)), dtype=float),
        plane_translation_mm=translation,
        plane_pose_covariance=np.asarray(values.get("plane_pose_covariance", unknown), dtype=float),
        plane_tilt_deg=float(values.get("plane_tilt_deg", np.nan)),
        vertical=str(values.get("vertical", "board")),
        photos=tuple(values.get("photos_json", ())),
        quality=cast(CalibrationQuality, dict(values.get("quality_json", unassessed))),
        joint_covariance=None if joint is None else np.asarray(joint, dtype=float),
    )


def _matrix(path: Path, given: Any) -> np.ndarray:
    """The camera matrix (3, 3): a flat list of nine is one too."""
    try:
        matrix = np.asarray(given, dtype=float).reshape(3, 3)
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: camera_matrix must be nine numbers, fx 0 cx 0 fy cy 0 0 1") from error
    if not np.all(np.isfinite(matrix)) or min(matrix[0, 0], matrix[1, 1]) <= 0 or np.any(matrix[2] != [0, 0, 1]):
        raise InputError(
            f"{path}: camera_matrix must be fx 0 cx 0 fy cy 0 0 1 with positive fx and fy, row by row; correct it"
        )
    return matrix


def _coefficients(path: Path, values: dict[str, Any]) -> np.ndarray:
    given = values.get("distortion_coefficients")
    if given is None:
        raise InputError(f"{path}: distortion_coefficients is missing; write five zeros for a lens without distortion")
    try:
        found = np.ravel(np.asarray(given, dtype=float))
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: distortion_coefficients must be a list of numbers; correct it") from error
    if not np.all(np.isfinite(found)):
        raise InputError(f"{path}: distortion_coefficients must be finite numbers; correct them")
    return found


def _pixels(path: Path, values: dict[str, Any], name: str) -> int:
    if values.get(name) is None:
        raise InputError(f"{path}: {name} is missing; add the size of the picture in pixels")
    try:
        found = int(values[name])
    except (TypeError, ValueError, OverflowError):
        found = 0
    if found <= 0:
        raise InputError(f"{path}: {name} is '{values[name]}'; write the size of the picture in pixels")
    return found
