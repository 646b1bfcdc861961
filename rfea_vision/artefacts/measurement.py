"""What was measured: the tube's dimensions, the camera, the track, and the recording on one clock.

Rig frame everywhere: origin where the centre line leaves the clamp, x to the right as the camera sees it, y up.
Angles and curvature are positive in the direction that ``actuator.bends`` names. Lengths in files are mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.rows import CalibrationQuality, PhotoRecord
from rfea_vision.errors import InputError
from rfea_vision.files import read_dataset, write_dataset

if TYPE_CHECKING:  # quarter of a second of import that a simulation does not need
    import xarray as xr

#: Pa, of what soft actuators are cast and printed of, from the softest silicones (Marechal et al. 2021, doi:10.1089/soro.2019.0115)
#: to soft thermoplastic polyurethanes; rounded outwards, as what is beyond is told and not refused.
ELASTOMER_MODULUS = (0.05e6, 50.0e6)


def bend_sign(bends: str) -> float:
    """+1 of a tube that bends to the camera's left, as in the dynamics, -1 of one that bends right, which is mirrored there."""
    return -1.0 if bends == "right" else 1.0


#: m^2: the tension of a tendon is kept as a pressure on this area, of which 1 N is 100 kPa. The torque (tension times lever) is one
#: on any area; on this one what arms of this size are pulled with (0.5 to 50 N) counts as what tubes are driven with.
TENDON_AREA = 1e-5
#: kPa that stand for 1 N of it.
TENSION_kPa = 1e-3 / TENDON_AREA
#: Roles of the runs that are looked at while a model is chosen: looked at before the end, a test run would prove nothing.
CHOOSING_ROLES = ("train", "validate")
#: What the attribute ``sigma_source`` says of a track that came without standard errors.
ESTIMATED_ERRORS = "estimated from the track's own high frequencies"


@dataclass(frozen=True)
class Actuator:
    """Dimensions and densities of the tube, or beam, at rest, in SI units.

    The radii default to 4 and 3 mm: the 8 and 6 mm that the paper prints are diameters (see docs/physics.md). Of a beam,
    `outer_radius` is half its thickness in the plane of motion, and pi `inner_radius`^2 the area on which a pressure acts.
    `keeps` says which line of a beam keeps its length: its middle, or the side to which it bends (a tube's always is its side).
    `mass_per_length` stands in place of the densities, `material` is a name such as PDMS. Where a tendon pulls, `tendon` is its
    distance from the middle, and pi `inner_radius`^2 the area by which its tension is kept as a pressure (`TENDON_AREA`).
    """

    outer_radius: float = 0.004
    inner_radius: float = 0.003
    length: float = 0.155
    density: float = 965.0
    fluid_density: float = 1000.0
    bends: Literal["left", "right"] = "left"
    kind: Literal["tube", "rod", "rectangle", "custom"] = "tube"
    keeps: Literal["middle", "side"] = "middle"
    width: float | None = None
    area: float | None = None
    second_moment: float | None = None
    mass_per_length: float | None = None
    material: str = ""
    tendon: float | None = None

    def __post_init__(self) -> None:
        if self.kind == "tube" and not 0 < self.inner_radius < self.outer_radius:
            raise InputError("actuator.inner_radius must be positive and smaller than actuator.outer_radius")
        for key in ("outer_radius", "inner_radius", "length", "density", "fluid_density", "width", "area", "second_moment", "tendon"):
            if not (getattr(self, key) is None or getattr(self, key) > 0):
                raise InputError(f"actuator.{key} must be positive")
        if self.mass_per_length is not None and not self.mass_per_length > 0:
            raise InputError("actuator.mass_per_length must be positive")
        if self.kind == "rectangle" and self.width is None:
            raise InputError("actuator.section.width is missing; a rectangle has a width and a thickness")
        if self.kind == "custom" and self.mass_per_length is None and self.area is None:
            raise InputError("actuator.mass_per_length is missing; a custom section needs it, or the mass, or its area")

    @property
    def mirror(self) -> float:
        """+1, or -1 where the tube bends right: see `bend_sign`."""
        return bend_sign(self.bends)

    @property
    def width_key(self) -> str:
        """The key that says how wide it is in the plane of motion."""
        return "actuator.section.thickness" if self.kind == "rectangle" else "actuator.outer_radius"

    @property
    def offset(self) -> float:
        """How far the centre line lies outside the hinge line (m): a tube bends about its side, a beam about the line that it keeps."""
        return self.outer_radius if self.kind == "tube" or self.keeps == "side" else 0.0

    @property
    def bore_offset(self) -> float:
        """By how much a tube's arc grows per angle (m), whose rubber leaves the bore wider then; a beam keeps its section: 0."""
        return self.outer_radius if self.kind == "tube" else 0.0

    @property
    def solid_area(self) -> float:
        """Area (m^2) of what carries the mass: the wall of a tube, the whole section of a beam."""
        if self.area is not None:
            return self.area
        if self.kind == "rectangle":
            return 2 * self.outer_radius * float(self.width or 0.0)
        inner = self.inner_radius if self.kind == "tube" else 0.0
        return float(np.pi * (self.outer_radius**2 - inner**2))

    @property
    def linear_density(self) -> float:
        """Mass per length (kg/m) at rest: as weighed, or of the wall and the water in it."""
        if self.mass_per_length is not None:
            return self.mass_per_length
        water = np.pi * self.inner_radius**2 * self.fluid_density if self.kind == "tube" else 0.0
        return float(self.density * self.solid_area + water)

    @property
    def bending_moment_of_area(self) -> float:
        """Second moment of area (m^4) about the line that does not stretch: an inextensible side, or a beam's middle."""
        if self.second_moment is not None:
            return self.second_moment
        outer, area = self.outer_radius, self.solid_area
        if self.kind == "tube":
            return float(np.pi / 4 * (outer**4 - self.inner_radius**4) + area * outer**2)
        return area * (outer**2 / (3.0 if self.kind == "rectangle" else 4.0) + self.offset**2)

    def as_dict(self) -> dict[str, Any]:
        """The fields by name, in SI, as model.json keeps them."""
        return asdict(self)


Pixel = tuple[float, float]
Box = tuple[float, float, float, float]
Colour = tuple[int, int, int]
Vertical = str | Mapping[str, Sequence[Sequence[float]]]
"""The rig's axis: ``board``, ``rest`` or ``image``; or ``{"plumb": [[x, y], [x, y]]}``, two pixels on a line that hangs plumb."""


@dataclass(frozen=True)
class Correction:
    """Where the tube is in a later frame: points on its centre line in px of that frame, in order from the clamp, the tip last."""

    frame: int
    points: tuple[Pixel, ...]


@dataclass(frozen=True)
class Hints:
    """What a person points at in the first frame of a film, in pixels; boxes are x, y, width and height.

    Attributes
    ----------
    clamp : two points across the first visible cross-section
    tip : the end of the tube
    centre_line : points on the centre line between the two, in order from the clamp
    corrections : where it is in later frames, each in that frame's own pixels
    region : where in the picture the tube moves
    exclude : where it never is: a hose, a hand, another tube
    colour : of the tube, red, green and blue of 255
    marks : colour of marks on it, red, green and blue of 255
    masks : folder with one mask per frame, made by another program
    keypoints : table of points along the tube in every frame, made by another program
    """

    clamp: tuple[Pixel, Pixel] | None = None
    tip: Pixel | None = None
    centre_line: tuple[Pixel, ...] = ()
    corrections: tuple[Correction, ...] = ()
    region: Box | None = None
    exclude: tuple[Box, ...] = ()
    colour: Colour | None = None
    marks: Colour | None = None
    masks: Path | None = None
    keypoints: Path | None = None


@dataclass(frozen=True)
class Calibration:
    """Lens, and the plane of motion seen through it.

    Pixel origin: the centre of the top left pixel is (0, 0), as in OpenCV.

    Attributes
    ----------
    camera_matrix : (3, 3) pixels
    distortion : (5,), (8,) or fisheye (4,) coefficients in OpenCV's order
    model : ``brown5``, ``brown8`` or ``fisheye``
    rms_px : root mean square reprojection error of the photos used
    intrinsics_covariance : (m, m) covariance of [fx, fy, cx, cy, distortion...]
    plane_rotation, plane_translation_mm : pose of the plane of motion, board to camera: X_cam = R X_board + t
    plane_pose_covariance : (6, 6) of [rotation vector, translation in mm]
    joint_covariance : covariance of [fx, fy, cx, cy, distortion..., rotation vector, translation], if solved together
    plane_tilt_deg : angle between the optical axis and the plane's normal
    photos : one record per photo
    quality : how far all this is to be trusted
    """

    image_width: int
    image_height: int
    camera_matrix: FloatArray
    distortion: FloatArray
    model: str
    rms_px: float
    intrinsics_covariance: FloatArray
    plane_rotation: FloatArray
    plane_translation_mm: FloatArray
    plane_pose_covariance: FloatArray
    plane_tilt_deg: float
    vertical: str
    photos: tuple[PhotoRecord, ...]
    quality: CalibrationQuality
    joint_covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.camera_matrix.shape != (3, 3) or self.plane_rotation.shape != (3, 3):
            raise InputError("camera_matrix and plane_rotation must be 3 x 3")


_TRACK_DIMS: dict[str, tuple[str, ...]] = {
    "valid": ("time",),
    "reason": ("time",),
    "midline": ("time", "node", "xy"),
    "midline_sigma": ("time", "node"),
    "edges": ("time", "side", "node", "xy"),
    "width": ("time", "node"),
    "width_sigma": ("time", "node"),
    "curvature": ("time", "node"),
    "curvature_sigma": ("time", "node"),
    "tip": ("time", "xy"),
    "tip_sigma": ("time", "xy"),
    "bend_angle": ("time",),
    "bend_angle_sigma": ("time",),
    "elongation": ("time", "segment"),
    "elongation_sigma": ("time", "segment"),
}


def _check(dataset: xr.Dataset, noun: str) -> None:
    for name, dims in _TRACK_DIMS.items():
        if name in dataset and dataset[name].dims != dims:
            raise InputError(f"{noun}: '{name}' has dimensions {dataset[name].dims}, expected {dims}")
    for name in ("valid", "reason"):
        if name not in dataset:
            raise InputError(f"{noun}: '{name}' is missing")
    if not any(name in dataset for name in ("tip", "midline", "bend_angle")):
        raise InputError(f"{noun}: none of tip, midline and bend_angle is there")
    time = dataset["time"].values
    if time.ndim != 1 or not np.all(np.isfinite(time)) or np.any(np.diff(time) < 0):
        raise InputError(f"{noun}: time must be finite and must not run backwards")


@dataclass(frozen=True)
class _Frames:
    """Labelled data with one row per frame, as a netCDF file holds it."""

    dataset: xr.Dataset

    @property
    def time_s(self) -> FloatArray:
        """Times (frames,) in s."""
        return self.dataset["time"].values

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which frames (frames,) count."""
        return self.dataset["valid"].values.astype(bool)

    def save(self, path: Path) -> None:
        """Write the file whole."""
        write_dataset(path, self.dataset)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what `save` wrote; InputError where it is not there or not whole."""
        return cls(read_dataset(path))


@dataclass(frozen=True)
class Track(_Frames):
    """The tube in every frame, on the camera's clock; one row per frame, none missing.

    ``dataset`` holds (lengths mm, angles deg, time s, curvature 1/mm, elongation as a ratio; NaN where ``valid`` is 0):
    time; valid (int8); reason (str, empty where valid); midline (time, node, xy), nodes evenly spaced along the centre
    line from clamp to tip; midline_sigma (time, node), the standard error along the normal; edges (time, side, node, xy)
    with side = ["inner", "outer"] of the bend; width; curvature; tip (time, xy); tip_sigma (time, xy); bend_angle (time),
    the tangent's angle at the tip; elongation (time, segment); and their ``*_sigma``. A track from another tool may
    lack any but one of tip, midline and bend_angle.
    """

    def __post_init__(self) -> None:
        _check(self.dataset, "track")


@dataclass(frozen=True)
class Recording(_Frames):
    """A track and its pressure log on one clock, the log's.

    ``dataset`` is that of `Track` with ``time`` on the log's clock, plus ``log_time`` (s) and ``pressure`` (log_time)
    in kPa gauge; attributes ``experiment``, ``role``, ``bends``, ``sync_method``, ``offset_s`` (log clock minus camera
    clock), ``offset_stderr_s``, ``drift_ppm``, ``drift_stderr_ppm``, and optionally ``repeat_of``; of another rig than the
    paper's ``gravity_deg`` from down, positive in the direction of the bend, or ``gravity: none``; ``held_until_s`` on the
    camera's clock where the tube was let go by hand (NaN: when it is seen to move), with ``pulled_N`` and ``pulled_deg`` (from down,
    positive in the direction of the bend) where a force at its tip held it; ``conditions``, a JSON mapping of SI
    values. A run that carries the memory of others has ``earlier_pressure`` (earlier_time) too, in kPa before the log begins.
    Of several chambers ``pressure`` is the sum, each times its ``chamber_sign``, and ``chamber_pressure`` (chamber, log_time)
    what each had.
    """

    def __post_init__(self) -> None:
        _check(self.dataset, "recording")
        if "pressure" not in self.dataset or self.dataset["pressure"].dims != ("log_time",):
            raise InputError("recording: 'pressure' over 'log_time' is missing")

    @property
    def name(self) -> str:
        """The experiment that was recorded."""
        return str(self.dataset.attrs["experiment"])

    @property
    def role(self) -> str:
        """What the run is for: train, validate or test."""
        return str(self.dataset.attrs["role"])
