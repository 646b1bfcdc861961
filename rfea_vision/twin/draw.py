"""What chance decides in a generated campaign: the tube's parameters, the runs, their clocks, and the noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import lfilter

from rfea_vision.arrays import FloatArray
from rfea_vision.campaign.specs import gravity_deg
from rfea_vision.errors import DataError
from rfea_vision.twin.excitation import GRID_S, KINDS, Programme, programme
from rfea_vision.twin.options import BaseParameters, TwinOptions, with_partners
from rfea_vision.twin.plant import Plant, PlantMotion
from rfea_vision.twin.shape import hinge_arcs, line_at
from rfea_vision.twin.stress import frame_times

LOG_STEP_S = 0.001  # 1 kHz
BEFORE_S, AFTER_S = 0.5, 0.6  # the log outlasts the video on both sides


@dataclass(frozen=True)
class Run:
    """One experiment to record: its name and role, what drives it, and how its clocks lie.

    ``offset_s`` is the log's clock minus the camera's at the first frame; ``drift`` is by how much a second of the
    camera is longer on the log; ``claimed_offset_s`` is what the experiment file says where it says anything (where
    the clock drifts, it is right in the middle of the recording).
    """

    name: str
    role: str
    programme: Programme
    offset_s: float
    drift: float
    claimed_offset_s: float
    repeat_of: str | None = None


def draw_base(seed: int) -> BaseParameters:
    """Parameters near the published ones, such that stiffness and damping stay positive at every bend reached."""
    generator = np.random.default_rng([seed, 1])
    paper = BaseParameters()
    k, b_pos, b_neg = generator.uniform([0.9, 0.7, 0.9], [1.2, 1.3, 1.8])
    return BaseParameters(
        k_ref=k * paper.k_ref,
        k_slope=k * generator.uniform(0.5, 1.0) * paper.k_slope,
        b_pos_ref=b_pos * paper.b_pos_ref,
        b_pos_slope=b_pos * generator.uniform(0.3, 1.0) * paper.b_pos_slope,
        b_neg_ref=b_neg * paper.b_neg_ref,
        b_neg_slope=b_neg * generator.uniform(0.2, 0.6) * paper.b_neg_slope,
        r_hyd=generator.uniform(0.0033, 0.0040),
    )


def build_plant(options: TwinOptions) -> tuple[Plant, BaseParameters]:
    """The plant of a campaign, with its base parameters drawn where none are given."""
    base = options.base or draw_base(options.seed)
    plant = Plant(
        options.actuator,
        base,
        with_partners(options.hidden),
        joints=options.joints,
        layout=options.layout,
        seed=options.seed,
        gravity_deg=gravity_deg(options.gravity, options.actuator.bends),
    )
    return plant, base


def highest_pressure(plant: Plant, options: TwinOptions) -> float:
    """Highest pressure of the excitations, in Pa: that of the options, or less where the tube would bend too far.

    Raises
    ------
    DataError
        If the tube stands at no pressure.
    """
    highest, why = options.pressure_max_kPa * 1e3, ""
    for _ in range(60):
        try:
            felt = float(plant.felt_pressure(np.array([0.0, 1e6]), np.array([highest, highest]))[-1])
            angles = plant.equilibrium(felt)[-plant.joints :]
            # overshoot must stay clear of the bend at which stiffness or damping vanish
            plant.law.torque(1.6 * angles, np.zeros_like(angles), plant.law.relaxed(angles), felt, 0.0)
            plant.law.torque(1.6 * angles, np.full_like(angles, -1e-9), plant.law.relaxed(angles), felt, 0.0)
            if angles.sum() <= options.angle_max:
                return highest
            why = "it bends too far"
        except DataError as error:
            why = str(error).removeprefix("simulate: ").partition(";")[0]
        highest *= 0.93
    hidden = ", ".join(f"{key}={value:g}" for key, value in options.hidden.items()) or "nothing hidden"
    raise DataError(
        f"simulate: with {hidden} the tube stands at no pressure ({why}); hide less (--hidden), or take another tube (--seed)"
    )


def draw_runs(options: TwinOptions, highest_Pa: float) -> list[Run]:
    """Excitation and clocks of every experiment."""
    runs: list[Run] = []
    end_s = options.duration_s * 1.002 + AFTER_S
    for index, role in enumerate(options.roles):
        generator = np.random.default_rng([options.seed, 2, index])
        kind = options.kinds[index] if options.kinds else KINDS[index % len(KINDS)]
        rest_s = generator.uniform(0.25, 0.45) * min(1.0, options.duration_s)
        drawn = generator.uniform(0.015, 0.085) * generator.choice([-1.0, 1.0])
        offset = 0.0 if options.sync == "common_clock" else drawn
        offset = offset if options.offset_s is None else options.offset_s
        drift = options.hidden.get("clock_drift.d", 0.0)
        share = 1.0 if role == "train" else generator.uniform(0.8, 0.95)
        if options.given is not None:
            kind = options.given.kind
        peak_Pa = options.peaks_kPa[index] * 1e3 if options.peaks_kPa else share * highest_Pa
        runs.append(
            Run(
                name=f"{kind}-{index + 1}",
                role=role,
                programme=_held_before_and_after(options.given, end_s)
                if options.given is not None
                else programme(kind, generator, -BEFORE_S, end_s, rest_s, peak_Pa),
                offset_s=offset,
                drift=drift,
                claimed_offset_s=offset + 0.5 * drift * options.duration_s - options.hidden.get("time_offset.dt", 0.0),
            )
        )
    if options.repeat:
        first = runs[0]
        runs.append(replace(first, name=f"{first.name}-again", repeat_of=first.name))
    return runs


def _held_before_and_after(given: Programme, end_s: float) -> Programme:
    """A given pressure on the whole of the log: the first value before it, the last one after it."""
    time = np.arange(-BEFORE_S, end_s, GRID_S)
    return replace(given, time_s=time, pressure_Pa=given.at(time))


def move(plant: Plant, run: Run, step_s: float) -> PlantMotion:
    """Let the plant play a run."""
    line = run.programme
    felt = plant.felt_pressure(line.time_s, line.pressure_Pa)
    return plant.run(
        lambda time: np.interp(time, line.time_s, felt), float(line.time_s[0]), float(line.time_s[-1]), step_s
    )


def camera_times(options: TwinOptions) -> FloatArray:
    """Time stamps (frames,) in s on the camera's clock, the first at 0."""
    return frame_times(round(options.duration_s * options.rate_Hz), options.rate_Hz, options.scene, options.seed)


@dataclass(frozen=True)
class Posture:
    """The plant at given instants: angles (T, m) and lengths (m,) of its arcs, outer radius and clamp (T,)."""

    angles: FloatArray
    lengths: FloatArray
    outer_radius: FloatArray
    clamp_angle: FloatArray
    mirrored: bool

    def line(self, fraction: FloatArray, offset: float | FloatArray = 0.0) -> tuple[FloatArray, FloatArray]:
        """Points (T, k, 2) in mm, camera-right x, and tangent angles (T, k) in rad, positive towards the bend."""
        points, phi = line_at(self.angles, self.lengths, fraction, self.outer_radius, offset, self.clamp_angle)
        points *= 1e3
        if self.mirrored:
            points[..., 0] *= -1
        return points, phi


def posture_at(plant: Plant, motion: PlantMotion, time_s: FloatArray) -> Posture:
    """Postures at times (frames,) in s between the plant's steps, by cubic Hermite interpolation of angles and speeds."""
    theta = CubicHermiteSpline(motion.time_s, motion.theta, motion.rate)(time_s)
    angles, lengths = hinge_arcs(theta, plant.actuator.length, plant.layout)
    return Posture(
        angles=angles,
        lengths=lengths,
        outer_radius=np.interp(time_s, motion.time_s, motion.outer_radius),
        clamp_angle=np.interp(time_s, motion.time_s, motion.clamp_angle),
        mirrored=plant.actuator.bends == "right",
    )


def misread_plane(points_mm: FloatArray, hidden: Mapping[str, float], mirror: float) -> FloatArray:
    """What a wrong scale, a tilted plane or a rolled camera makes of true points (..., 2) in mm.

    `hidden` is that of `camera_scale`, `plane_tilt` and `camera_roll`, `mirror` -1 where the tube bends to the right, else 1.
    """
    metres = points_mm * 1e-3
    factor = 1 + hidden.get("plane_tilt.a", 0.0) * metres[..., 0] + hidden.get("plane_tilt.b", 0.0) * metres[..., 1]
    sized = points_mm * ((1 + hidden.get("camera_scale.s", 0.0)) * factor)[..., None]
    roll = mirror * hidden.get("camera_roll.angle", 0.0)
    return np.asarray(sized @ np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]]))


def noise_like(shape: tuple[int, ...], sigma: float, correlation: float, generator: np.random.Generator) -> FloatArray:
    """Stationary AR(1) noise (as `shape` says) along the first axis, `sigma` its standard deviation in any unit."""
    white = generator.standard_normal(shape)
    white[1:] *= np.sqrt(1 - correlation**2)
    return sigma * np.asarray(lfilter([1.0], [1.0, -correlation], white, axis=0))
