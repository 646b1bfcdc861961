"""Tables and small records inside of the artefacts: plain dictionaries with the keys that they have on disk, and no others.

An error is in mm or, where only angles were measured, in deg; null where it is not known.
"""

from __future__ import annotations

from typing import NotRequired

from typing_extensions import TypedDict  # of Python 3.11 the own one is not enough for pydantic

#: What a body that bends about its middle has no use for: slopes over the bore of a tube, and a second damper.
UNUSED_BY_BEAMS = ("k_slope", "b_pos_slope", "b_neg_ref", "b_neg_slope")
#: Where a floor comes from that is no more than a model's own error: that a model is at such a floor says nothing of the model.
LEFT_BY_A_MODEL = "what a model leaves of its worst run (the track's standard errors claim more)"
#: Where one comes from that is what the track claims.
STATED_ERRORS = "standard errors of the track"


class Correlation(TypedDict, total=False):
    """Of the noise of the free parameters `names`: the matrix, and the standard errors in SI."""

    names: list[str]
    matrix: list[list[float | None]]
    stderr: list[float | None]


class SteadyState(TypedDict, total=False):
    """Plateaus and the fit to them, lists of equal length; or a `note` on why there is none."""

    pressure_kPa: list[float]
    experiment: list[str]
    angle_deg: list[float | None]
    fitted_angle_deg: list[float | None]
    rms_mm: float | None
    k_ref: float
    k_slope: float
    note: str


class StartRow(TypedDict):
    """One start of a fit, and the cost at which it ended."""

    start: str
    cost: float | None
    status: str


class ResidualTest(TypedDict):
    """One test of the residual: a time or a share of its variance, and a sentence."""

    correlation_time_s: NotRequired[float | None]
    share: NotRequired[float | None]
    sentence: str


class Profile(TypedDict):
    """Profile likelihood of a parameter: its values in `unit`, and how much the misfit rises at each."""

    unit: str
    value: list[float]
    delta: list[float]
    interval_95: list[float | None]
    sentence: str


class LeftOutRun(TypedDict, total=False):
    """Errors on a run of the fit that has not seen it, and that fit's parameters in SI; or a `note` on why there is none."""

    tip_rmse_mm: float | None
    tip_x_rmse_mm: float | None
    tip_y_rmse_mm: float | None
    midline_rmse_mm: float | None
    angle_rmse_deg: float | None
    tip_rmse_percent_of_length: float | None
    normalised_fit_percent: float | None
    notes: dict[str, str]
    frames_used: int
    step_s: float | None
    parameters: dict[str, float]
    note: str


class LeaveOneOut(TypedDict, total=False):
    """Fits without each run in turn: `relative_spread` is that of each parameter over them."""

    experiments: dict[str, LeftOutRun]
    tip_rmse_mm: float | None
    relative_spread: dict[str, float | None]
    sentence: str


class TipPath(TypedDict, total=False):
    """Path of the tip in mm in a run."""

    experiment: str
    x: list[float | None]
    y: list[float | None]


class StudyRow(TypedDict):
    """Errors of a chain of so many segments."""

    segments: int
    train_tip_rmse_mm: NotRequired[float | None]
    train_tip_x_rmse_mm: NotRequired[float | None]
    train_tip_y_rmse_mm: NotRequired[float | None]
    train_midline_rmse_mm: NotRequired[float | None]
    train_angle_rmse_deg: NotRequired[float | None]
    validate_tip_rmse_mm: NotRequired[float | None]
    validate_tip_x_rmse_mm: NotRequired[float | None]
    validate_tip_y_rmse_mm: NotRequired[float | None]
    validate_midline_rmse_mm: NotRequired[float | None]
    validate_angle_rmse_deg: NotRequired[float | None]
    tip_path_mm: TipPath


class Refit(TypedDict):
    """A set of effects (with forms) that was refitted, and all parameters of the model that then has it, by name, SI."""

    effects: list[str]
    values: dict[str, float]


class PhaseRow(TypedDict):
    """Error of a run in a phase, and what `share` of the run's squared error falls into it."""

    experiment: str
    role: str
    phase: str
    rmse_mm: float | None
    rmse_deg: float | None
    share: float
    frames: int


class PressureRow(TypedDict):
    """Error in a band of pressures."""

    from_kPa: float
    to_kPa: float
    rmse_mm: float | None
    rmse_deg: float | None
    frames: int


class SegmentRow(TypedDict):
    """Error, and its mean across the centre line, on a part of the tube from clamp (0) to tip (1)."""

    from_sigma: float
    to_sigma: float
    rmse_mm: float | None
    bias_mm: float | None


class Dependence(TypedDict):
    """How much of the residual torque's variance goes with `what`; `on` is its short name."""

    on: str
    what: str
    score: float
    sentence: str


class TorqueSummary(TypedDict, total=False):
    """Root mean square of the residual torque and its standard error, and what it depends on, best first."""

    rms_mNm: float | None
    sigma_mNm: float | None
    depends_on: list[Dependence]
    note: str


class ElongationProfile(TypedDict):
    """Elongation along the tube at a pressure (shares of 1), and the test of whether it is uniform."""

    pressure_kPa: float
    experiment: str
    position: list[float]
    measured: list[float | None]
    sigma: list[float | None]
    modelled: list[float | None]
    chi2: float | None
    degrees_of_freedom: int


class Elongation(TypedDict, total=False):
    """Profiles at up to three pressures, and the test of uniformity in a sentence."""

    sentence: str
    assumption: str
    profiles: list[ElongationProfile]


class GoesWith(TypedDict):
    """What the residual torque goes with, and the share of its variance that does."""

    what: str
    r2: float


class TestScore(TypedDict, total=False):
    """Errors of the last and the first model on runs that nothing chose on; in `experiments` of the last by run."""

    model: str
    tip_rmse_mm: float | None
    angle_rmse_deg: float | None
    first_model: str
    first_model_tip_rmse_mm: float | None
    first_model_angle_rmse_deg: float | None
    experiments: dict[str, float | None]
    first_model_experiments: dict[str, float | None]


class PhotoRecord(TypedDict):
    """A photo of the board: whether the calibration used it, why not, and its RMS residual in px."""

    file: str
    used: bool
    reason: str
    rms_px: float | None


class Coverage(TypedDict):
    """Corners counted in fields of the picture, by rows and columns, and the edges of these in px."""

    counts: list[list[int]]
    x_edges_px: list[float]
    y_edges_px: list[float]


class PhotoResiduals(TypedDict):
    """Corners of a photo, and how far from them the model is, in px."""

    file: str
    rms_px: float
    x_px: list[float]
    y_px: list[float]
    dx_px: list[float]
    dy_px: list[float]


class CrossValidation(TypedDict, total=False):
    """How far lenses from either half of the photos lie apart, beside what chance makes; or a `note` on why that is not known.

    `halves` are the two packed cameras (29,), `ratio` the difference over what was predicted, `inflation` a factor on standard errors.
    """

    difference_mm: float
    predicted_mm: float
    ratio: float
    inflation: float
    halves: list[list[float]]
    sentence: str
    note: str


class UncertaintyMap(TypedDict):
    """Standard error in mm of a place on the plane, by rows and columns of pixels."""

    x_px: list[float]
    y_px: list[float]
    sigma_mm: list[list[float]]
    caption: str


class PlaneQuality(TypedDict, total=False):
    """The photo of the plane of motion and its RMS residual, the standard error of its tilt, and how far it is from the camera."""

    file: str
    rms_px: float
    tilt_stderr_deg: float
    distance_mm: float


class RegionQuality(TypedDict, total=False):
    """Standard error of places in a region, root mean square and worst, and by how much halves of the photos disagree there."""

    sigma_mm: float
    sigma_worst_mm: float
    sigma_percent_of_length: float
    sigma_worst_percent_of_length: float
    cross_validated_mm: float
    sentence: str


class CalibrationQuality(TypedDict, total=False):
    """How far a calibration is to be trusted; of one from a scale or from the file of another tool a `note` alone."""

    note: str
    noise_px: float
    scale_stderr_percent: float
    tilt_stderr_deg: float
    lens_scores_px: dict[str, float]
    lens_reason: str
    sigma_px: float
    board_offset_mm: float
    corners_left_out: dict[str, int]
    coverage: Coverage
    residual_fields: list[PhotoResiduals]
    warnings: list[str]
    largest_turn_deg: float
    advice: str
    cross_validation: CrossValidation
    uncertainty_map: UncertaintyMap
    plane: PlaneQuality
    region: RegionQuality
