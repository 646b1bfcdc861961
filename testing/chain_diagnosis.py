"""Which effect a torque-driven planar chain lacks, and at which joint, from its motion and joint torques.

Inverse dynamics gives the torque that the known chain does not account for; every candidate effect of the catalogue is
regressed on it, at each joint by itself, and what explains enough is named, one after the other. Everything passes the
same zero-phase low-pass, so that noise differentiated twice does not drown the rest; the samples left independent by
that filter, two per period of the cut-off, are what the evidence counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.signal import butter, sosfiltfilt

from rfea_vision.arrays import FloatArray
from rfea_vision.dynamics.inverse import joint_torques
from rfea_vision.dynamics.simulation import STANDARD_GRAVITY, Chain, Model
from rfea_vision.dynamics.system import FIXED
from rfea_vision.effects.base import BASE_PARAMETERS, Effect
from rfea_vision.effects.catalogue import catalogue
from rfea_vision.errors import InputError

#: Linear terms of the base law that a bare chain may lack, by the parameters that switch them on.
BASE_TERMS: dict[str, tuple[str, ...]] = {"viscous": ("b_pos_ref", "b_neg_ref"), "spring": ("k_ref",)}
#: Effects that make sense without pressure. Those of the bodies act on all joints at once.
JOINT_EFFECTS = ("coulomb", "hysteresis")
BODY_EFFECTS = ("payload", "drag", "gravity_tilt")
LEAST_EVIDENCE = (
    10.0  # fall of BIC for a name ("very strong", Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572)
)


@dataclass(frozen=True)
class ChainRecord:
    """One run: time_s (m,), relative joint angles (m, n) in rad from hanging, joint torques (m, n) in N m."""

    time_s: FloatArray
    angle: FloatArray
    torque: FloatArray


@dataclass(frozen=True)
class ChainMotion:
    """A run on a uniform grid after the low-pass: angle, rate, acceleration (m, n), and residual torque (m, n) in N m."""

    step_s: float
    cutoff_Hz: float
    angle: FloatArray
    rate: FloatArray
    acceleration: FloatArray
    residual: FloatArray

    @property
    def independent(self) -> float:
        """Samples that the low-pass leaves independent."""
        return 2 * self.cutoff_Hz * self.step_s * len(self.angle)


@dataclass(frozen=True)
class ChainCandidate:
    """One effect at one joint (counted from 1; None: the whole chain), with the amplitude that fits best.

    shape : parameters that vanish with the amplitude, at their best grid value
    bic : change of BIC, negative where the effect earns its place
    """

    effect: str
    joint: int | None
    parameter: str
    unit: str
    amplitude: float
    standard_error: float
    shape: dict[str, float]
    bic: float


@dataclass(frozen=True)
class ChainDiagnosis:
    """What was found: `named` in order of discovery, their joint amplitudes refitted together in `amplitudes`.

    rms_before, rms_after : residual torque per joint (n,) in N m; candidates : the first screening, best first
    """

    named: tuple[ChainCandidate, ...]
    amplitudes: tuple[float, ...]
    standard_errors: tuple[float, ...]
    candidates: tuple[ChainCandidate, ...]
    rms_before: FloatArray
    rms_after: FloatArray
    sentences: tuple[str, ...]


def low_pass(values: FloatArray, step_s: float, cutoff_Hz: float) -> FloatArray:
    """Fourth-order Butterworth, run both ways (no delay)."""
    sections = butter(4, cutoff_Hz, fs=1 / step_s, output="sos")
    return np.asarray(sosfiltfilt(sections, values, axis=0), dtype=np.float64)


def residual_torque(
    chain: Chain,
    record: ChainRecord,
    *,
    rotor_inertia: Sequence[float] | None = None,
    gravity: float = STANDARD_GRAVITY,
    cutoff_Hz: float = 15.0,
) -> ChainMotion:
    """Measured torque less that of inverse dynamics of the bare chain.

    rotor_inertia : kg m^2 per joint, seen at the joint (the motor's times its gear ratio squared)

    Raises
    ------
    InputError
        Columns that do not match the chain, or time that does not rise.
    """
    n = chain.bodies
    if record.angle.shape != (record.time_s.size, n) or record.torque.shape != record.angle.shape:
        raise InputError(f"record: angle and torque must have shape ({record.time_s.size}, {n}), one column per joint")
    if np.any(np.diff(record.time_s) <= 0):
        raise InputError("record: time does not rise from row to row; sort it and drop repeated rows")
    step = float(np.median(np.diff(record.time_s)))
    grid = np.arange(record.time_s[0], record.time_s[-1], step)
    angle, torque = (
        low_pass(np.column_stack([np.interp(grid, record.time_s, column) for column in values.T]), step, cutoff_Hz)
        for values in (record.angle, record.torque)
    )
    rate = np.gradient(angle, step, axis=0)
    acceleration = np.gradient(rate, step, axis=0)
    motion = ChainMotion(step, cutoff_Hz, angle, rate, acceleration, torque)
    needed = _needed(Model(chain, gravity=gravity), np.zeros(len(BASE_PARAMETERS)), motion, None)
    rotor = np.zeros(n) if rotor_inertia is None else np.asarray(rotor_inertia, dtype=float)
    residual = low_pass(torque - needed - rotor * acceleration, step, cutoff_Hz)
    return ChainMotion(step, cutoff_Hz, angle, rate, acceleration, residual)


def _absolute(values: FloatArray) -> FloatArray:
    return np.column_stack([np.zeros(len(values)), np.cumsum(values, axis=1)])


def _needed(model: Model, par: FloatArray, motion: ChainMotion, states: FloatArray | None) -> FloatArray:
    frames, n = motion.angle.shape
    if states is None:
        states = np.zeros((frames, n, max(model.law.state_count, 1)))
    moved = (_absolute(motion.angle), _absolute(motion.rate), _absolute(motion.acceleration))
    return joint_torques(model, par, *moved, states, np.zeros(frames))


def _hidden_states(model: Model, par: FloatArray, motion: ChainMotion, substeps: int = 4) -> FloatArray:
    """Hidden states along a known motion, from zero, by small explicit steps."""
    m, n = model.law.state_count, model.chain.bodies
    states, out = np.zeros((len(motion.angle), n, m)), np.zeros((n, model.law.columns))
    z = np.zeros((n, m))
    for k in range(len(motion.angle)):
        states[k] = z
        for _ in range(substeps):
            model.law.loops.joint_law(
                np.ascontiguousarray(motion.angle[k]),
                np.ascontiguousarray(motion.rate[k]),
                z,
                0.0,
                model.chain.position,
                model.chain.arc,
                model._weights,
                par,
                model._constants,
                out,
            )
            for b in range(m):
                z[:, b] += motion.step_s / substeps * out[:, FIXED + m + 4 * b]
        # An explicit step may overshoot where a state turns faster than the samples come; the laws' states are bounded.
        np.clip(z, -1.5, 1.5, out=z)
    return states


@dataclass(frozen=True)
class _Regressor:
    """Torque per unit of an amplitude, one array (m, n) per run."""

    effect: str
    joint: int | None
    parameter: str
    unit: str
    lower: float
    upper: float
    shape: dict[str, float]
    torque: tuple[FloatArray, ...]


def _base_regressors(chain: Chain, motions: Sequence[ChainMotion]) -> list[_Regressor]:
    found = []
    for term, parameters in BASE_TERMS.items():
        par = np.array([1.0 if name in parameters else 0.0 for name in BASE_PARAMETERS])
        unit = "N*m*s/rad" if term == "viscous" else "N*m/rad"
        model = Model(chain, gravity=0.0)
        still = np.zeros(len(BASE_PARAMETERS))
        whole = [_needed(model, par, motion, None) - _needed(model, still, motion, None) for motion in motions]
        for joint in range(chain.bodies):
            only = tuple(
                low_pass(torque * (np.arange(chain.bodies) == joint), motion.step_s, motion.cutoff_Hz)
                for torque, motion in zip(whole, motions, strict=True)
            )
            found.append(_Regressor(term, joint + 1, parameters[0], unit, 0.0, np.inf, {}, only))
    return found


def _effect_regressors(
    chain: Chain, effect: Effect, motions: Sequence[ChainMotion], gravity: float
) -> list[_Regressor]:
    """Regressors of an effect's amplitudes, over the grid of what vanishes with them."""
    places: list[int | None] = list(range(1, chain.bodies + 1)) if effect.id in JOINT_EFFECTS else [None]
    shapes = {name: spec.grid or (spec.start,) for name, spec in effect.parameters.items() if spec.absent is None}
    model = Model(chain, (effect,), gravity=gravity)
    found = []
    for values in product(*shapes.values()):
        shape = dict(zip(shapes, values, strict=True))
        fixed = {f"{effect.id}.{k}": v for k, v in shape.items()}
        still = np.array([fixed.get(name, 0.0) for name in model.names])
        states = [_hidden_states(model, still, motion) if effect.states else None for motion in motions]
        bare = [_needed(model, still, motion, z) for motion, z in zip(motions, states, strict=True)]
        for amplitude in effect.amplitudes():
            spec = effect.parameters[amplitude]
            par = still.copy()
            step = 1e-3 * (abs(spec.start) or 1.0)
            par[model.names.index(f"{effect.id}.{amplitude}")] = step
            moved = [_needed(model, par, motion, z) for motion, z in zip(motions, states, strict=True)]
            for place in places:
                here = np.ones(chain.bodies) if place is None else np.arange(chain.bodies) == place - 1
                torque = tuple(
                    low_pass((high - low) / step * here, motion.step_s, motion.cutoff_Hz)
                    for low, high, motion in zip(bare, moved, motions, strict=True)
                )
                found.append(_Regressor(effect.id, place, amplitude, spec.unit, spec.lower, spec.upper, shape, torque))
    return found


def _design(regressors: Sequence[_Regressor], weights: FloatArray) -> FloatArray:
    """Rows (runs, samples and joints), weighted; one column per regressor."""
    return np.column_stack([np.concatenate([(t * weights).ravel() for t in item.torque]) for item in regressors])


def _fit(
    regressors: Sequence[_Regressor], motions: Sequence[ChainMotion], weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Amplitudes, their standard errors, and the residual (all samples, n) that they leave in N m."""
    target = np.concatenate([motion.residual for motion in motions])
    if not regressors:
        return np.zeros(0), np.zeros(0), target
    design = _design(regressors, weights)
    amplitude = np.asarray(np.linalg.lstsq(design, (target * weights).ravel(), rcond=None)[0], dtype=np.float64)
    left = target - np.einsum("rmn,r->mn", _stacked(regressors), amplitude)
    independent = sum(motion.independent for motion in motions)
    thinning = len(target) / independent
    covariance = np.linalg.pinv(design.T @ design) * float(np.mean((left * weights) ** 2)) * thinning
    return amplitude, np.sqrt(np.diag(covariance)), left


def _stacked(regressors: Sequence[_Regressor]) -> FloatArray:
    return np.stack([np.concatenate(item.torque) for item in regressors])


def _evidence(before: FloatArray, after: FloatArray, parameters: int, motions: Sequence[ChainMotion]) -> float:
    """Change of BIC when each joint has its own noise level."""
    independent = sum(motion.independent for motion in motions)
    gain = np.log(np.mean(after**2, axis=0) / np.mean(before**2, axis=0)).sum()
    return float(independent * gain + parameters * np.log(independent))


def _screen(
    pool: Sequence[_Regressor], chosen: Sequence[_Regressor], motions: Sequence[ChainMotion], weights: FloatArray
) -> list[tuple[ChainCandidate, _Regressor]]:
    """Every regressor of the pool on top of those chosen; the best shape of each effect and joint, best first."""
    before = _fit(chosen, motions, weights)[2]
    best: dict[tuple[str, int | None, str], tuple[ChainCandidate, _Regressor]] = {}
    taken = {(item.effect, item.joint) for item in chosen}
    for item in pool:
        if (item.effect, item.joint) in taken or not any(np.any(t) for t in item.torque):
            continue
        amplitude, error, after = _fit([*chosen, item], motions, weights)
        inside = item.lower <= amplitude[-1] <= item.upper
        bic = _evidence(before, after, 1 + len(item.shape), motions) if inside else np.inf
        row = ChainCandidate(
            item.effect, item.joint, item.parameter, item.unit, float(amplitude[-1]), float(error[-1]), item.shape, bic
        )
        key = (item.effect, item.joint, item.parameter)
        if key not in best or bic < best[key][0].bic:
            best[key] = (row, item)
    return sorted(best.values(), key=lambda pair: pair[0].bic)


def diagnose_chain(
    chain: Chain,
    motions: Sequence[ChainMotion],
    *,
    effects: Mapping[str, type[Effect]] | None = None,
    gravity: float = STANDARD_GRAVITY,
    most: int = 3,
) -> ChainDiagnosis:
    """Name the effects that the residual torque of these runs (`residual_torque`) asks for, at most `most` of them."""
    offered = effects or {name: catalogue()[name] for name in (*JOINT_EFFECTS, *BODY_EFFECTS)}
    pool = _base_regressors(chain, motions)
    for effect in offered.values():
        pool += _effect_regressors(chain, effect(), motions, gravity)
    target = np.concatenate([motion.residual for motion in motions])
    weights = 1 / np.sqrt(np.mean(target**2, axis=0))
    chosen: list[_Regressor] = []
    named: list[ChainCandidate] = []
    first: list[ChainCandidate] = []
    while len(named) < most:
        ranked = _screen(pool, chosen, motions, weights)
        if not first:
            first = [row for row, _ in ranked]
        if not ranked or ranked[0][0].bic > -LEAST_EVIDENCE:
            break
        named.append(ranked[0][0])
        chosen.append(ranked[0][1])
        weights = 1 / np.sqrt(np.mean(_fit(chosen, motions, weights)[2] ** 2, axis=0))
    amplitude, error, left = _fit(chosen, motions, weights)
    before, after = (np.sqrt(np.mean(values**2, axis=0)) for values in (target, left))
    return ChainDiagnosis(
        tuple(named),
        tuple(map(float, amplitude)),
        tuple(map(float, error)),
        tuple(first),
        before,
        after,
        _sentences(named, amplitude, error, before, after),
    )


def _sentences(
    named: Sequence[ChainCandidate], amplitude: FloatArray, error: FloatArray, before: FloatArray, after: FloatArray
) -> tuple[str, ...]:
    found = []
    for row, value, sigma in zip(named, amplitude, error, strict=True):
        where = "on the whole chain" if row.joint is None else f"at joint {row.joint}"
        found.append(f"{row.effect} {where}: {row.parameter} = {value:.4g} +- {1.96 * sigma:.2g} {row.unit}")
    for joint, (old, new) in enumerate(zip(before, after, strict=True), start=1):
        found.append(f"joint {joint}: residual torque {old:.3f} N m, {new:.3f} N m with what was named")
    if not named:
        found.append("nothing on offer explains enough of the residual torque")
    return tuple(found)


__all__ = ["ChainCandidate", "ChainDiagnosis", "ChainMotion", "ChainRecord", "diagnose_chain", "residual_torque"]
