"""What the twin is asked for: the options of one generated campaign, and the effects that may hide in it.

The table `HIDDEN` names every effect parameter that the plant can carry, with its unit and the value at which the
effect is absent. Ids and parameters are those of the catalogue of effects, so that an answer can be compared with the
truth; those under `OUTSIDE` are in no catalogue: a critique that names one of its own effects for them is wrong.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from rfea_vision.artefacts import Actuator
from rfea_vision.drive import ValveCommands
from rfea_vision.errors import InputError
from rfea_vision.twin.excitation import Programme
from rfea_vision.twin.stress import Stress
from rfea_vision.units import parse_quantity, split_quantity


@dataclass(frozen=True)
class HiddenParameter:
    """SI unit, the value at which the effect is absent, and the value taken where only a partner is given."""

    unit: str
    absent: float = 0.0
    usual: float | None = None


HIDDEN: dict[str, HiddenParameter] = {
    "virtual_work.a": HiddenParameter("1"),
    "variable_mass.a": HiddenParameter("1"),
    "payload.m": HiddenParameter("kg"),
    "payload.offset": HiddenParameter("1", usual=1.0),
    "com_offset.a": HiddenParameter("1"),
    "gravity_tilt.angle": HiddenParameter("rad"),
    "rest_curvature.angle": HiddenParameter("rad"),
    "rest_curvature_profile.a1": HiddenParameter("rad"),
    "rest_curvature_profile.a2": HiddenParameter("rad"),
    "nonlinear_stiffness.c": HiddenParameter("1/rad^2"),
    "pressure_stiffening.c": HiddenParameter("1/Pa"),
    "stiffness_profile.a1": HiddenParameter("1"),
    "stiffness_profile.a2": HiddenParameter("1"),
    "stiffness_profile.a3": HiddenParameter("1"),
    "damping_profile.a1": HiddenParameter("1"),
    "damping_profile.a2": HiddenParameter("1"),
    "nonlinear_damping.c": HiddenParameter("s/rad"),
    "maxwell.k1": HiddenParameter("1"),
    "maxwell.T": HiddenParameter("s", usual=1.0),
    "hysteresis.tau_h": HiddenParameter("N m"),
    "hysteresis.w": HiddenParameter("rad", usual=0.2),
    "coulomb.tau_c": HiddenParameter("N m"),
    "coulomb.w": HiddenParameter("rad/s", usual=0.1),
    "mullins.c": HiddenParameter("1"),
    "mullins.s": HiddenParameter("rad", usual=0.7),
    "radial_expansion.c": HiddenParameter("1/Pa"),
    "compressibility.c": HiddenParameter("1/Pa"),
    "fluid_inertia.I": HiddenParameter("Pa s^2/m^3"),
    "fluid_damping.R": HiddenParameter("Pa s/m^3"),
    "drag.c": HiddenParameter("kg/m^3"),
    "contact.k": HiddenParameter("N/m", usual=50.0),
    "contact.d": HiddenParameter("m", usual=0.07),
    "base_rotation.c": HiddenParameter("rad/(N m)"),
    "pressure_lag.T": HiddenParameter("s"),
    "pressure_gain.g": HiddenParameter("1", absent=1.0),
    "pressure_offset.p0": HiddenParameter("Pa"),
    "time_offset.dt": HiddenParameter("s"),
    "clock_drift.d": HiddenParameter("1"),
    "camera_scale.s": HiddenParameter("1"),
    "camera_roll.angle": HiddenParameter("rad"),
    "plane_tilt.a": HiddenParameter("1/m"),
    "plane_tilt.b": HiddenParameter("1/m"),
    # in no catalogue
    "fan.F": HiddenParameter("N/m"),
    "warm_up.c": HiddenParameter("1"),
    "warm_up.T": HiddenParameter("s", usual=4.0),
    "shaking.a": HiddenParameter("m/s^2"),
    "shaking.f": HiddenParameter("Hz", usual=3.0),
    "heavy_section.m": HiddenParameter("kg"),
    "heavy_section.at": HiddenParameter("1", usual=0.5),
    "kink.c": HiddenParameter("1"),
    "kink.at": HiddenParameter("1", usual=0.35),
}

OUTSIDE = ("fan", "warm_up", "shaking", "heavy_section", "kink")


@dataclass(frozen=True)
class BaseParameters:
    """The seven parameters of the RSDA model, per joint of a tube cut into eight; N m, rad, s, m.

    `k_ref`, `b_pos_ref`, `b_neg_ref` are the values at the rest radius, the slopes are over the inner radius. The
    defaults are the paper's 8-DoF table (Table EstimatedParam) at r_o = 4 mm, r_i = 3 mm.
    """

    k_ref: float = math.degrees(0.045257 - 14.101 * 0.003)
    k_slope: float = math.degrees(-14.101)
    b_pos_ref: float = math.degrees(0.00032813 - 0.098948 * 0.003)
    b_pos_slope: float = math.degrees(-0.098948)
    b_neg_ref: float = math.degrees(0.00058815 - 0.18966 * 0.003)
    b_neg_slope: float = math.degrees(-0.18966)
    r_hyd: float = 0.0035644


@dataclass(frozen=True)
class TwinOptions:
    """One generated campaign.

    Attributes
    ----------
    hidden : effect parameters in SI units, keyed ``effect.parameter`` (see `parse_hidden`); empty hides nothing
    name : of the campaign; empty takes the folder's
    seed : draws base parameters, excitations, clocks, camera and noise; the same seed gives the same campaign
    roles : role of every experiment, in order
    duration_s : length of each video or track
    rate_Hz : frames per second
    video : render video and board photos; otherwise ``track.csv`` of the centre line
    observe : what a ``track.csv`` holds: nodes of the centre line, the tip, or the tip's angle
    noise_mm : standard deviation of the noise of a tracked coordinate (per axis and node)
    noise_angle_deg : the same for ``observe="angle"``
    noise_correlation : lag-one correlation of that noise from frame to frame (AR(1)); 0 is white
    pressure_noise_kPa : standard deviation of the logged pressure about the true one
    pressure_max_kPa : highest pressure of the excitations; lowered where the tube would bend beyond `angle_max`
    kinds : programme of every experiment (see `excitation.KINDS`); empty gives each another one
    peaks_kPa : highest pressure of every experiment, instead of what `pressure_max_kPa` and chance make it
    angle_max : bend, in rad, at which the highest pressure is capped
    actuator : dimensions as they are written to the campaign
    base : parameters of the tube; None draws them within sensible ranges of the published ones
    joints : number of joints of the plant
    layout : ``middle`` (each joint in the middle of its arc) or ``start`` (the paper's chain: a rigid body per joint)
    step_s : time step of the plant's integrator
    sync : what the experiment files say about the clocks: ``motion``, ``offset`` (the true value) or ``common_clock``
    offset_s : log clock minus camera clock; None draws tens of milliseconds per experiment
    repeat : also record the first experiment a second time, as ``repeat_of``
    write_truth : write ``<out>-truth.json`` beside the campaign
    exact_tracks : also write noise-free tracks to ``<out>-truth/``
    frame_size : width and height of the video, pixels
    codec_qp : constant quantiser of the H.264 encoder; of 1.5 grey levels of noise 0.7 are left at 20, 0.25 at 22
    image_noise : standard deviation of the sensor noise, grey levels
    dark_tube : a dark tube before a light wall, or the reverse; None draws one
    photos : number of board photos
    scene : what makes the pictures hard
    drive : what makes the pressure: None, a smooth valve; valve commands for a digital hydraulic drive; or ``duty``,
        the same drive following the drawn pressure with a duty cycle
    gravity : where gravity points in the frame in which the unloaded tube points down: ``down``, ``left``, ``right``, ``up``,
        ``none``, or degrees from down in the direction of the bend; the camera stays level
    given : the pressure that every run plays, instead of one that is drawn; it starts at 0 s
    """

    hidden: Mapping[str, float] = field(default_factory=dict)
    name: str = ""
    seed: int = 0
    roles: tuple[str, ...] = ("train", "train", "validate", "test")
    duration_s: float = 6.0
    rate_Hz: float = 240.0
    video: bool = False
    observe: Literal["midline", "tip", "angle"] = "midline"
    noise_mm: float = 0.06
    noise_angle_deg: float = 0.1
    noise_correlation: float = 0.0
    pressure_noise_kPa: float = 0.05
    pressure_max_kPa: float = 270.0
    kinds: tuple[str, ...] = ()
    peaks_kPa: tuple[float, ...] = ()
    angle_max: float = 2.3
    actuator: Actuator = field(default_factory=Actuator)
    base: BaseParameters | None = None
    joints: int = 48
    layout: Literal["middle", "start"] = "middle"
    step_s: float = 0.001
    sync: Literal["motion", "offset", "common_clock"] = "motion"
    offset_s: float | None = None
    repeat: bool = False
    write_truth: bool = True
    exact_tracks: bool = False
    frame_size: tuple[int, int] = (720, 1280)
    codec_qp: int = 20
    image_noise: float = 1.5
    dark_tube: bool | None = None
    photos: int = 14
    scene: Stress = field(default_factory=Stress)
    drive: ValveCommands | Literal["duty"] | None = None
    gravity: str | float = "down"
    given: Programme | None = None

    def __post_init__(self) -> None:
        for key in self.hidden:
            if key not in HIDDEN:
                raise InputError(unknown_parameter(key))
        for key in ("duration_s", "rate_Hz", "pressure_max_kPa", "angle_max", "step_s"):
            if not getattr(self, key) > 0:
                raise InputError(
                    f"simulate: {key.partition('_')[0]} must be positive ({key} is {getattr(self, key):g})"
                )
        for key, given in (("kinds", self.kinds), ("peaks_kPa", self.peaks_kPa)):
            if given and len(given) != len(self.roles):
                raise InputError(f"simulate: {key} must have one entry for each of the {len(self.roles)} experiments")
        if not self.roles:
            raise InputError("simulate: experiments must be at least 1")
        if not -1 < self.noise_correlation < 1:
            raise InputError("simulate: noise_correlation must lie between -1 and 1")
        if self.video and self.layout != "middle":
            raise InputError("simulate: a video needs layout 'middle'; rigid bodies have no smooth outline")


def paper_campaign(roles: tuple[str, ...] = ("train", "validate")) -> TwinOptions:
    """Return the twin of the paper's tube: its 8-DoF table as truth, joints at the start, steps to 270 kPa (train) and 220 kPa.

    Parameters
    ----------
    roles : role of every experiment, in order
    """
    return TwinOptions(
        base=BaseParameters(),
        joints=8,
        layout="start",
        roles=roles,
        kinds=("steps",) * len(roles),
        peaks_kPa=tuple(270.0 if role == "train" else 220.0 for role in roles),
        sync="common_clock",
        step_s=0.00025,
    )


def unknown_parameter(key: str) -> str:
    """One sentence that says what may stand where `key` stood."""
    effect = key.split(".")[0]
    own = [name for name in HIDDEN if name.startswith(f"{effect}.")]
    known = own or sorted({name.split(".")[0] for name in HIDDEN})
    close = [] if own else difflib.get_close_matches(key, HIDDEN, n=1, cutoff=0.8)
    hint = f"did you mean '{close[0]}'?" if close else f"known are {', '.join(known)}"
    return f"--hidden {key}: not known to the twin; {hint}"


def parse_hidden(items: Iterable[str]) -> dict[str, float]:
    """Read ``effect.parameter=value unit`` into SI values.

    Parameters
    ----------
    items : strings such as ``maxwell.k1=0.03``, ``maxwell.T=1.2s``, ``payload.m=2 g``

    Returns
    -------
    dict
        Value in SI by ``effect.parameter``; a partner that is not given takes its usual value.

    Raises
    ------
    InputError
        If the parameter is unknown, the value is not a finite number, or its unit is missing or of the wrong kind.
    """
    values: dict[str, float] = {}
    for item in items:
        key, separator, text = (part.strip() for part in item.partition("="))
        if not separator or "." not in key:
            raise InputError(f"--hidden {item}: write effect.parameter=value, as in maxwell.T=1.2s")
        if key not in HIDDEN:
            raise InputError(unknown_parameter(key))
        if key in values:
            raise InputError(f"--hidden {key}: given twice; keep one")
        values[key] = _quantity(key, text)
    return with_partners(values)


def with_partners(values: Mapping[str, float]) -> dict[str, float]:
    """Add the usual value of every parameter whose effect is named but which is not itself given."""
    effects = {key.split(".")[0] for key in values}
    usual = {
        key: parameter.usual
        for key, parameter in HIDDEN.items()
        if parameter.usual is not None and key.split(".")[0] in effects
    }
    return {**usual, **values}


def _quantity(key: str, text: str) -> float:
    unit = HIDDEN[key].unit
    if "," in text:  # pint takes a comma for one between thousands
        raise InputError(f"--hidden {key}: '{text}' has a decimal comma; write {text.replace(',', '.')}")
    try:
        if unit == "1" and not (bare := split_quantity(text))[1]:
            return bare[0]
        return parse_quantity(text, unit, example=f"2 {unit}")
    except ValueError as error:
        raise InputError(f"--hidden {key}: {error}") from error
