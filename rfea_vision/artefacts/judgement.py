"""What was concluded: a fit, its comparison with the measurement, a diagnosis, the ladder. JSON, typed by pydantic."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from rfea_vision.artefacts.rows import (
    UNUSED_BY_BEAMS,
    Correlation,
    Elongation,
    GoesWith,
    LeaveOneOut,
    PhaseRow,
    PressureRow,
    Profile,
    Refit,
    ResidualTest,
    SegmentRow,
    StartRow,
    SteadyState,
    StudyRow,
    TestScore,
    TorqueSummary,
)
from rfea_vision.errors import InputError
from rfea_vision.files import write_text


class _Json(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="null", populate_by_name=True)

    def save(self, path: Path) -> None:
        # An infinite or undefined number has no place in JSON: it is written as null.
        write_text(path, self.model_dump_json(by_alias=True, indent=1) + "\n")

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read the artefact; InputError if it is not there, or not what this version writes."""
        try:
            return cls.model_validate_json(path.read_bytes())
        except FileNotFoundError as error:
            raise InputError(f"{path}: not found; run the stage that writes it") from error
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            raise InputError(f"{path}: {where}: {first['msg']}; run the stage again with --force") from error


class Parameter(_Json):
    """A fitted value in ``unit``; ``stderr`` and ``interval_95`` are null where the data cannot give them (see ``note``).

    ``text`` says what it is, of the parameters of effects, which declare it.
    """

    value: float
    unit: str
    stderr: float | None = None
    interval_95: tuple[float, float] | None = None
    lower: float | None = None
    upper: float | None = None
    fixed: bool = False
    note: str = ""
    text: str = ""


class Metrics(_Json):
    """Root mean square errors on the centre line; null where the data cannot give them, with the reason in ``notes``."""

    tip_rmse_mm: float | None = None
    tip_x_rmse_mm: float | None = None
    tip_y_rmse_mm: float | None = None
    midline_rmse_mm: float | None = None
    angle_rmse_deg: float | None = None
    tip_rmse_percent_of_length: float | None = None
    normalised_fit_percent: float | None = None
    notes: dict[str, str] = Field(default_factory=dict)


class ExperimentScore(Metrics):
    """Errors of a model on one run; ``nuisance`` holds what the fit left free for this run alone, in SI."""

    role: str
    frames_used: int = 0
    step_s: float | None = None  # longest step of the integrator on this run
    nuisance: dict[str, float] = Field(default_factory=dict)
    pressure_times: float | None = None  # of one run that stands apart: so high its log is beside those of the others


class ModelFit(_Json):
    """`model.json`: the fit. Metrics by role; `test` is present only after the ladder has ended."""

    format: Literal["rfea-model/1"] = "rfea-model/1"
    name: str
    segments: int
    joints: Literal["middle", "start"] = "middle"
    effects: list[str] = Field(default_factory=list)
    observe: str = "midline"
    # what a residual counts: its square, or beyond a few robust standard deviations its size; null in fits of before 0.6
    loss: Literal["linear", "huber"] | None = None
    order: int = 3  # of the integrator with which the values were found and scored
    status: Literal["converged", "not_converged", "refused"] = "converged"
    message: str = ""
    actuator: dict[str, Any] = Field(default_factory=dict)
    parameters: dict[str, Parameter]
    paper_parameters: dict[str, Parameter] = Field(default_factory=dict)
    correlation: Correlation = Field(default_factory=Correlation)
    metrics: dict[str, Metrics]
    noise_floor_mm: float | None = None
    noise_floor_deg: float | None = None  # where only an angle was measured
    noise_floor_source: str = ""
    experiments: dict[str, ExperimentScore]
    ratio_only: bool = False  # whether r_hyd was held because these runs tell only its ratio to the stiffness
    warnings: list[str] = Field(default_factory=list)
    steady_state: SteadyState = Field(default_factory=SteadyState)
    starts: list[StartRow] = Field(default_factory=list)  # the waterfall
    residual_tests: dict[str, ResidualTest] = Field(default_factory=dict)
    effect_files: list[str] = Field(default_factory=list)  # of the user's own effects
    given: dict[str, JsonValue] = Field(default_factory=dict)  # fields of `FitOptions`, in SI
    profiles: dict[str, Profile] = Field(default_factory=dict)
    leave_one_out: LeaveOneOut = Field(default_factory=LeaveOneOut)
    # seconds; written apart, as no two runs agree
    timings: dict[str, float] = Field(default_factory=dict, exclude=True)
    segments_study: list[StudyRow] = Field(default_factory=list)
    laws: dict[str, dict[str, str]] = Field(default_factory=dict)  # effect -> {"title", "latex", "reference", "text"}
    inputs: dict[str, str] = Field(default_factory=dict)

    @property
    def refused(self) -> str:
        """Why a fit was refused; empty where it was not."""
        return self.message if self.status == "refused" else ""

    @property
    def of_tube(self) -> bool:
        """Whether the body is a tube with a bore, and not one that bends about its middle."""
        return self.actuator.get("kind", "tube") == "tube"

    @property
    def told(self) -> dict[str, Parameter]:
        """The parameters without those that its section has no use for, which are held at 0."""
        unused = () if self.of_tube else UNUSED_BY_BEAMS
        return {name: one for name, one in self.parameters.items() if not (name in unused and one.fixed and one.value == 0)}

    @property
    def meets_no_run(self) -> bool:
        """Whether a tube that never moves from its mean would be nearer to every run."""
        fits = [run.normalised_fit_percent for run in self.experiments.values()]
        return bool(fits) and all(fit is not None and fit < 0 for fit in fits)

    def clock_s(self, run: str) -> float | None:
        """Offset (s) that the fit gave the clock of a run; None where it gave none."""
        score = self.experiments.get(run)
        return None if score is None else score.nuisance.get("clock_offset_s")


class WorstPlace(_Json):
    """A stretch of time and tube where model and measurement part."""

    experiment: str
    from_s: float
    to_s: float
    from_sigma: float
    to_sigma: float
    rmse_mm: float | None = None
    rmse_deg: float | None = None  # of the bend angle, where only an angle was measured
    phase: Literal["hold", "rise", "fall", "reversal", "rest", "ringing"]
    sentence: str

    @property
    def rmse(self) -> float:
        """The error in the unit of what was measured."""
        return next((error for error in (self.rmse_mm, self.rmse_deg) if error is not None), 0.0)


class Comparison(_Json):
    """`comparison.json`: where a model fails. Tables as lists of rows; an error in mm or, where only angles were measured, in deg."""

    format: Literal["rfea-comparison/1"] = "rfea-comparison/1"
    model: str
    noise_floor_mm: float | None = None
    by_phase: list[PhaseRow] = Field(default_factory=list)
    by_pressure: list[PressureRow] = Field(default_factory=list)
    by_segment: list[SegmentRow] = Field(default_factory=list)
    where: list[WorstPlace] = Field(default_factory=list)
    residual_torque: TorqueSummary = Field(default_factory=TorqueSummary)
    elongation: Elongation = Field(default_factory=Elongation)
    sentences: list[str] = Field(default_factory=list)


class Candidate(_Json):
    """An effect on offer; ``share`` is null where it was not refitted."""

    effect: str
    title: str = ""
    at: str | None = None
    form: str | None = None  # the form of its law that the data prefer, of an effect that has several
    probability: float | None = Field(default=None, ge=0, le=1)  # that it, or a member of its tie, is really there
    # of the held-out squared error above the irreproducible floor that is gone; may be negative
    share: float | None = None
    score_p: float | None = None
    predicted_rmse_mm: float | None = None
    train_rmse_mm: float | None = None
    validate_rmse_mm: float | None = None
    predicted_rmse_deg: float | None = None  # of the bend angle, where only an angle was measured
    train_rmse_deg: float | None = None
    validate_rmse_deg: float | None = None
    delta_bic: float | None = None
    parameters: dict[str, Parameter] = Field(default_factory=dict)
    # all parameters of the model with it, SI, as the search has found them: where the next rung begins
    values: dict[str, float] = Field(default_factory=dict)
    refitted: bool = False
    matters: bool | None = None
    note: str = ""


class Tie(_Json):
    """Effects that the data cannot tell from one another, and what would."""

    effects: list[str]
    split_by: str


class NextExperiment(_Json):
    """The run that would tell effects apart; ``pressure`` names a CSV file (time_s, pressure_kPa) beside the diagnosis."""

    separates: list[str] = Field(alias="for")
    pressure: str
    sentence: str
    decides: bool = True  # whether the predictions part by more than the noise floor


class EffectSet(_Json):
    """Effects that were refitted together; empty for the model as it is, and so for causes outside of the catalogue."""

    effects: list[str]
    probability: float | None = Field(default=None, ge=0, le=1)
    share: float | None = None
    validate_rmse_mm: float | None = None
    validate_rmse_deg: float | None = None


class Remainder(_Json):
    """What the best set leaves: ``share`` of the squared error above the floor, the held-out error, and what it goes with."""

    share: float | None = None
    rmse_mm: float | None = None
    rmse_deg: float | None = None
    goes_with: list[GoesWith] = Field(default_factory=list)
    sentence: str = ""


class Floors(_Json):
    """Errors below tell nothing: noise of the measurement, motion that does not come again, calibration; null if unknown."""

    measurement: float | None = None
    irreproducible: float | None = None
    calibration: float | None = None
    unit: Literal["mm", "deg"] = "mm"
    source: str = ""  # of `measurement`, as `ModelFit.noise_floor_source`: what was refitted tells more of the noise than one fit


UNCERTAIN = "uncertain"
#: Why a verdict is none to rest on, as clauses: over a floor that would hide what matters (files without a reason), of a refused fit.
TRACK_UNCERTAIN, RAN_AWAY = "the track is too uncertain", "the fit ran away"


def outcome_of(verdict: str, uncertain: bool) -> str:
    """The verdict, or `UNCERTAIN` where nothing is named and it is none to rest on."""
    return UNCERTAIN if uncertain and verdict != "missing" else verdict


def verdict_in_words(verdict: str, asks_less: bool, uncertain: bool) -> str:
    """The verdict as people read it: of a model that is complete for its held-out runs alone, no more than that."""
    if uncertain:
        return UNCERTAIN if verdict != "missing" else f"{verdict}, but {UNCERTAIN}"
    return f"{verdict} as far as the held-out runs ask" if asks_less else verdict


def undecided(because: str) -> str:
    """That nothing can be said, the reason first; without the end of the sentence."""
    because = because or TRACK_UNCERTAIN
    return f"{because[0].upper()}{because[1:]}: whether something is missing cannot be said"


class Diagnosis(_Json):
    """`diagnosis.json`: which effects are missing, how probable each is, and what share of the misfit it explains."""

    format: Literal["rfea-diagnosis/1"] = "rfea-diagnosis/1"
    model: str
    verdict: Literal["missing", "complete", "unexplained"]
    sentence: str = ""
    named: list[str] = Field(default_factory=list)
    # what lowers the held-out error together, though hardly its cause
    stand_ins: list[str] = Field(default_factory=list)
    tied: list[Tie] = Field(default_factory=list)
    candidates: list[Candidate] = Field(default_factory=list)
    sets: list[EffectSet] = Field(default_factory=list)
    sufficient: bool | None = None  # whether what is left once everything named is added is at the floor
    asks_less: bool = False  # whether `complete` holds for the held-out runs alone: training runs ask more, and are farther off
    uncertain: bool = False  # whether the verdict is none to rest on
    uncertain_because: str = ""
    remainder: Remainder | None = None
    floors: Floors | None = None
    where: list[WorstPlace] = Field(default_factory=list)
    noise_floor_mm: float | None = None
    noise_floor_deg: float | None = None  # where only an angle was measured
    explained_fraction: float | None = None
    next_experiment: NextExperiment | None = None
    warnings: list[str] = Field(default_factory=list)
    # every model that the search has fitted: where the search from the next rung takes up those that it meets again
    refits: list[Refit] = Field(default_factory=list)

    @property
    def said(self) -> str:
        """The verdict as people read it."""
        return verdict_in_words(self.verdict, self.asks_less, self.uncertain)

    @property
    def outcome(self) -> str:
        """The verdict, or that it is too uncertain."""
        return outcome_of(self.verdict, self.uncertain)

    def rivals_of(self, effect: str) -> list[str]:
        """The other members of the tie that an effect belongs to: the data cannot tell it from these."""
        return [other for tie in self.tied if effect in tie.effects for other in tie.effects if other != effect]


class Rung(_Json):
    """A step of the ladder; ``tied`` are effects that the data could not tell from the one that was added."""

    model: str
    added: str | None
    tied: list[str] = Field(default_factory=list)
    train_tip_rmse_mm: float | None
    validate_tip_rmse_mm: float | None
    train_angle_rmse_deg: float | None = None
    validate_angle_rmse_deg: float | None = None
    delta_bic: float | None
    verdict: str
    asks_less: bool = False  # as in `Diagnosis`
    uncertain: bool = False
    uncertain_because: str = ""
    grade: Literal["named", "stand-in"] | None = None  # null on the first rung, to which nothing was added
    probability: float | None = Field(default=None, ge=0, le=1)  # in the diagnosis below, which chose
    share: float | None = None  # gone with the rung's own fit, over its floor; null while the ladder is climbed

    @classmethod
    def of(cls, fit: ModelFit, **more: Any) -> Rung:
        """The rung of a model with its errors on both kinds of runs; `more` are its other fields."""
        train, validate = fit.metrics.get("train"), fit.metrics.get("validate")
        known = {
            "model": fit.name,
            "train_tip_rmse_mm": train.tip_rmse_mm if train else None,
            "validate_tip_rmse_mm": validate.tip_rmse_mm if validate else None,
            "train_angle_rmse_deg": train.angle_rmse_deg if train else None,
            "validate_angle_rmse_deg": validate.angle_rmse_deg if validate else None,
            "delta_bic": None,
        }
        return cls(**{**known, **more})

    @property
    def said(self) -> str:
        """The verdict as people read it."""
        return verdict_in_words(self.verdict, self.asks_less, self.uncertain)

    @property
    def outcome(self) -> str:
        """The verdict, or that it is too uncertain."""
        return outcome_of(self.verdict, self.uncertain)

    @property
    def unit(self) -> Literal["mm", "deg"]:
        """Unit of the errors: deg where only an angle was measured."""
        tips = (self.train_tip_rmse_mm, self.validate_tip_rmse_mm)
        angles = (self.train_angle_rmse_deg, self.validate_angle_rmse_deg)
        return "deg" if tips == (None, None) and angles != (None, None) else "mm"

    def error(self, role: Literal["train", "validate"]) -> float | None:
        """Error on the training or the held-out runs, in `unit`."""
        what = "tip_rmse_mm" if self.unit == "mm" else "angle_rmse_deg"
        return getattr(self, f"{role}_{what}")


class Ladder(_Json):
    """`ladder.json`: every rung so far."""

    format: Literal["rfea-ladder/1"] = "rfea-ladder/1"
    rungs: list[Rung]
    test: TestScore | None = None
    noise_floor_mm: float | None = None
    noise_floor_deg: float | None = None  # where only an angle was measured
    stopped_because: str = ""
    findings: list[str] = Field(default_factory=list)

    FILE: ClassVar[str] = "ladder.json"
