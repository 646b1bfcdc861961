"""A law for what no effect of the catalogue explains: the residual torque, regressed on a library of terms.

Inverse dynamics gives the torque that the model lacks, joint by joint (torque.py). It is regressed on products of the tube's
angle, rate, pressure, memories and the time, with the place along the tube; what the base model could take up by itself is
projected out first. Terms are added one at a time while runs that were left out of the regression are foretold better (the idea
of Brunton, Proctor and Kutz 2016, doi:10.1073/pnas.1517384113, on a residual instead of the whole; Kaheman, Kutz and Brunton
2020, doi:10.1098/rspa.2020.0279). The best law is written as an effect file, such as people write by hand.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts.judgement import ModelFit
from rfea_vision.artefacts.measurement import Actuator, Recording
from rfea_vision.critique.diagnosis import refit_artefact
from rfea_vision.critique.floors import binding, floors_of
from rfea_vision.critique.measures import STRUCTURE_FLOORS, errors_of, matters, structure
from rfea_vision.critique.torque import ResidualTorque, residual_torque
from rfea_vision.effects.permission import name_files
from rfea_vision.errors import DataError
from rfea_vision.files import write_text
from rfea_vision.fitting.fit import Fitted, Problem, fit_added, make_problem
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.scoring import options_of
from rfea_vision.tube import inner_radius
from rfea_vision.units import rounded

FloatArray = NDArray[np.float64]
#: A term is kept where it lowers the error on runs left out of the regression by this share of its square (as in docs/formats.md),
#: and a law has no more terms than a person reads.
LEAST_GAIN, MOST_TERMS = 0.1, 4
#: Laws that are refitted, each begun with another quantity: a regression on smoothed torques ranks them no better than that.
MOST_LAWS = 3
#: Relaxation times of the memories on offer (s): a log of four apart, from a fast damper's to a slow creep's.
MEMORIES_S = (0.3, 1.2, 5.0)
#: Rate at which the direction of motion counts as turned (rad/s of the whole tube): that of `coulomb`.
TURNED = 0.05
#: Middles of the places at which a term may act alone.
SPOTS = (0.2, 0.35, 0.5, 0.65, 0.8)
#: Frames of a part of the cross-validation that are looked at: more are correlated and tell nothing new.
FRAMES = 200
#: Bounds of a fitted coefficient, in times of what the regression found.
ROOM = 10.0


@dataclass(frozen=True)
class Term:
    """One term of the library: its law in the words of an effect file, and its values (frames, n) per run."""

    law: str
    words: str
    values: tuple[FloatArray, ...]


@dataclass(frozen=True)
class Law:
    """Terms with their coefficients (N m), and the share of the torque's square that they foretell on runs left out."""

    terms: tuple[Term, ...]
    coefficients: tuple[float, ...]
    r2: float


@dataclass(frozen=True)
class Proposal:
    """The law that was written. Errors in mm (deg without a tip), on the runs that judge, before and after its refit."""

    file: Path
    terms: tuple[str, ...]
    coefficients: tuple[float, ...]
    regression_r2: float
    held_before: float
    held_after: float
    unit: str
    sentence: str


def propose(
    model: ModelFit, recordings: Mapping[str, Recording], file: Path, *, effect_id: str = "proposed"
) -> Proposal:
    """Write the best law for what a model leaves.

    Raises
    ------
    DataError
        Nothing is left that a law could explain, or no law foretells runs that it was not regressed on.
    """
    problem = make_problem(recordings, Actuator(**model.actuator), options_of(model))
    fitted = refit_artefact(model, problem)
    before = errors_of(problem, fitted)
    floor = binding(floors_of(problem, fitted))
    if structure(before, floor) < STRUCTURE_FLOORS:
        raise DataError(f"model {model.name}: what it leaves is at the floor; there is no law to propose")
    runs = _residuals(problem, fitted)
    laws = regress(library(runs), _nuisance(problem, runs), [result.torque for result, *_ in runs])
    if not laws:
        raise DataError(
            f"model {model.name}: no term of the library foretells the residual torque of runs that it was not regressed on; "
            "'rfea compare' says where and when it is large"
        )
    name_files([file])  # what is written here is our own
    tried = []
    for law in laws:
        write_text(file, effect_source(effect_id, law.terms, law.coefficients))
        after = _refitted(problem, fitted, file, effect_id)
        if after is not None:
            tried.append((after.solution.evaluation.cost, law, errors_of(problem, after)))
    _, best, after = min(tried, key=lambda row: row[0], default=(0.0, laws[0], before))
    if not matters(before, after, floor):
        file.unlink(missing_ok=True)
        raise DataError(
            f"model {model.name}: the best law of the library, {_listed(best.terms)}, does not lower the held-out error"
        )
    write_text(file, effect_source(effect_id, best.terms, best.coefficients))
    return _described(file, best, (before.held, after.held), "mm" if problem.train[0].has_tip else "deg")


def _described(file: Path, law: Law, held: tuple[float, float], unit: str) -> Proposal:
    sentence = (
        f"The residual torque goes with {_listed(law.terms)}; with that law refitted the held-out error falls from "
        f"{rounded(held[0])} to {rounded(held[1])} {unit}. It is a description, not yet a cause: "
        f"`rfea improve CAMPAIGN --effect-file {file}` weighs it."
    )
    laws = tuple(term.law for term in law.terms)
    return Proposal(file, laws, law.coefficients, law.r2, held[0], held[1], unit, sentence)


def _listed(terms: Sequence[Term]) -> str:
    return " and ".join(term.words for term in terms)


def _refitted(problem: Problem, fitted: Fitted, file: Path, effect_id: str) -> Fitted | None:
    options = replace(
        fitted.options,
        effects=(*fitted.options.effects, effect_id),
        effect_files=(*fitted.options.effect_files, file),
        name=f"{fitted.options.name}+{effect_id}",
    )
    try:
        return fit_added(problem, options, fitted)
    except DataError:
        return None


def _residuals(problem: Problem, fitted: Fitted) -> list[tuple[ResidualTorque, Observed, float]]:
    found = []
    for item, clock in zip(problem.train, fitted.solution.clocks, strict=True):
        result = residual_torque(fitted.model, fitted.par, item, float(clock))
        if result is not None:
            found.append((result, item, float(clock)))
    if not found:
        raise DataError(
            "the residual torque needs at least 25 valid frames in a training run that the model can be simulated on"
        )
    return found


def _near(place: FloatArray, at: float) -> FloatArray:
    return np.exp(-(((place - at) / 0.1) ** 2))


# -- the library -----------------------------------------------------------------------------------------------------------


def library(runs: Sequence[tuple[ResidualTorque, Observed, float]]) -> list[Term]:
    """All terms: a quantity, alone and with the place along the tube."""
    each = [_quantities(*run) for run in runs]
    places = {
        "": ("", np.ones_like),
        " * (1 - s)": (" near the clamp", lambda place: 1 - place),
        " * s": (" near the tip", lambda place: place),
    }
    for at in SPOTS:
        places[f" * exp(-((s - {at}) / 0.1)**2)"] = (f" at {100 * at:.0f} % of the length", partial(_near, at=at))
    terms = []
    for law, (words, _) in each[0].items():
        for factor, (where, shape) in places.items():
            values = []
            for quantities, (result, *_) in zip(each, runs, strict=True):
                n = result.theta.shape[1]
                values.append(quantities[law][1] * shape((np.arange(n) + 0.5) / n))
            terms.append(Term(law + factor, words + where, tuple(values)))
    return terms


def _quantities(result: ResidualTorque, item: Observed, clock_s: float) -> dict[str, tuple[str, FloatArray]]:
    """Law and words of every quantity with its values (frames, n): a, r, p, t, m and z stand for what `effect_source` declares."""
    n = result.theta.shape[1]
    a, r = n * result.theta, n * result.rate
    p = np.broadcast_to(item.excitation.at(item.time + clock_s)[:, None] / 1e5, a.shape)
    t = np.broadcast_to((item.time - item.excitation.start_s)[:, None], a.shape)
    most = np.maximum.accumulate(np.maximum(a, 0.0), axis=0)
    out: dict[str, tuple[str, FloatArray]] = {
        "1": ("a constant torque", np.ones_like(a)),
        "a": ("the angle", a),
        "a * Abs(a)": ("the angle times its size", a * np.abs(a)),
        "a**3": ("the cube of the angle", a**3),
        "cos(a)": ("the cosine of the angle", np.cos(a)),
        "r": ("the rate", r),
        "r * Abs(r)": ("the rate times its size", r * np.abs(r)),
        "r * a": ("the rate times the angle", r * a),
        f"tanh(r / {TURNED})": ("the direction of motion", np.tanh(r / TURNED)),
        "p": ("the pressure", p),
        "p * a": ("the pressure times the angle", p * a),
        "p**2": ("the square of the pressure", p**2),
        "m": ("the largest bend so far", most),
        "m * a": ("the angle times the largest bend so far", most * a),
        "t": ("the time into the run", t),
        "t * a": ("the angle times the time into the run", t * a),
    }
    for k, period in enumerate(MEMORIES_S):
        z = _relaxed(item.time, a, period)
        out[f"(a - z{k})"] = (f"the angle less its memory of {period:g} s", a - z)
    return out


def _relaxed(time: FloatArray, values: FloatArray, period: float) -> FloatArray:
    out = np.empty_like(values)
    out[0] = values[0]
    for k in range(1, time.size):
        decay = np.exp(-(time[k] - time[k - 1]) / period)
        out[k] = decay * out[k - 1] + (1 - decay) * 0.5 * (values[k] + values[k - 1])
    return out


def _nuisance(problem: Problem, runs: Sequence[tuple[ResidualTorque, Observed, float]]) -> list[tuple[FloatArray, ...]]:
    """Torques that the base parameters can make: what of a term they take up is not credited to it."""
    columns: list[list[FloatArray]] = [[] for _ in range(7)]
    for result, item, clock in runs:
        n = result.theta.shape[1]
        radius = inner_radius(problem.actuator, result.theta, problem.actuator.length / n)
        wide = radius - problem.actuator.inner_radius
        p = item.excitation.at(item.time + clock)[:, None]
        up, down = np.maximum(result.rate, 0.0), np.minimum(result.rate, 0.0)
        parts = (result.theta, result.theta * wide, up, up * wide, down, down * wide, p * radius**2)
        for column, part in zip(columns, parts, strict=True):
            column.append(np.broadcast_to(part, result.theta.shape))
    return [tuple(column) for column in columns]


# -- the regression ---------------------------------------------------------------------------------------------------------


def regress(
    terms: Sequence[Term], nuisance: Sequence[tuple[FloatArray, ...]], torque: Sequence[FloatArray]
) -> list[Law]:
    """The best laws, each begun with another quantity; cross-validated over runs, or over the halves of a single one."""
    parts = _folds(torque)
    base = [np.stack([values[r][rows].ravel() for values in nuisance], axis=1) for r, rows in parts]
    target = [torque[r][rows].ravel() for r, rows in parts]
    columns = {term.law: [term.values[r][rows].ravel() for r, rows in parts] for term in terms}

    def solved(laws: Sequence[str], fold: int | None) -> tuple[FloatArray, float]:
        """Coefficients without one of the parts, and the squared error on it."""
        wide = [np.column_stack([base[k], *(columns[law][k] for law in laws)]) for k in range(len(parts))]
        used = [k for k in range(len(parts)) if k != fold]
        design, goal = np.concatenate([wide[k] for k in used]), np.concatenate([target[k] for k in used])
        scale = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
        solution = np.asarray(np.linalg.lstsq(design / scale, goal, rcond=1e-6)[0] / scale, dtype=np.float64)
        return solution, 0.0 if fold is None else float(np.sum((target[fold] - wide[fold] @ solution) ** 2))

    def error(laws: Sequence[str]) -> float:
        return sum(solved(laws, fold)[1] for fold in range(len(parts)))

    before = error([])
    alone = {law: error([law]) for law in columns}
    found, begun = list[Law](), set[str]()
    for first in sorted(alone, key=lambda law: alone[law]):
        if len(found) == MOST_LAWS or alone[first] > (1 - LEAST_GAIN) * before:
            break
        quantity = re.split(r" \* exp\(| \* \(1 - s\)", first)[0]
        if quantity in begun:
            continue
        begun.add(quantity)
        chosen, now = [first], alone[first]
        while len(chosen) < MOST_TERMS:
            tried = {law: error([*chosen, law]) for law in columns if law not in chosen}
            best = min(tried, key=lambda law: tried[law])
            if tried[best] > (1 - LEAST_GAIN) * now:
                break
            chosen.append(best)
            now = tried[best]
        solution, _ = solved(chosen, None)
        picked = tuple(next(term for term in terms if term.law == law) for law in chosen)
        found.append(Law(picked, tuple(solution[-len(chosen) :].tolist()), 1 - now / before))
    return found


def _folds(torque: Sequence[FloatArray]) -> list[tuple[int, NDArray[np.int64]]]:
    """Rows of each part: a run each, or the halves of a single run."""
    parts = []
    for run, values in enumerate(torque):
        rows = np.arange(values.shape[0])
        for part in np.array_split(rows, 2) if len(torque) == 1 else [rows]:
            parts.append((run, part[:: max(1, part.size // FRAMES)]))
    return parts


# -- the file ----------------------------------------------------------------------------------------------------------------


def effect_source(effect_id: str, terms: Sequence[Term], coefficients: Sequence[float]) -> str:
    """The law as an effect file, as people write it by hand."""
    laws = [term.law for term in terms]
    text = " ".join(laws)
    memories = [k for k in range(len(MEMORIES_S)) if f"z{k}" in text]
    states, rates, relaxed, names = [], [], [], []
    if "m" in _words(text):
        states.append('"m": "rad"')
        rates.append(
            '"m": sp.Piecewise(((joint.tube_angle - self.m) / self.follow, joint.tube_angle > self.m), (0, True))'
        )
        relaxed.append('"m": sp.Piecewise((joint.tube_angle, joint.tube_angle > 0), (0, True))')
        names.append("m = self.m")
    if "t" in _words(text):
        states.append('"t": "s"')
        rates.append('"t": sp.Integer(1)')
        relaxed.append('"t": sp.Integer(0)')
        names.append("t = self.t / self.second")
    for k in memories:
        states.append(f'"z{k}": "rad"')
        rates.append(f'"z{k}": (joint.tube_angle - self.z{k}) / ({MEMORIES_S[k]} * self.second)')
        relaxed.append(f'"z{k}": joint.tube_angle')
        names.append(f"z{k} = self.z{k}")
    for name, meaning in (
        ("a", "joint.tube_angle"), ("r", "joint.tube_rate * self.second"), ("p", "joint.pressure / self.bar"), ("s", "joint.position"),
    ):  # fmt: skip
        if name in _words(text):
            names.append(f"{name} = {meaning}")
    parameters = []
    for k, (term, value) in enumerate(zip(terms, coefficients, strict=True), 1):
        limit = ROOM * max(abs(value), 1e-9)
        parameters.append(
            f'"c{k}": EffectParameter("N*m", 0.0, {-limit:.6g}, {limit:.6g}, {value:.6g}, "{term.words}"),'
        )
    sum_ = " + ".join(f"self.c{k} * {_sympy(law)}" for k, law in enumerate(laws, 1))
    join = "\n        ".join
    hooks = ""
    if states:
        hooks = f"""
    states = {{{", ".join(states)}}}

    def state_rates(self, joint: Joint) -> dict[str, sp.Expr]:
        return {{
            {("," + chr(10) + "            ").join(rates)},
        }}

    def relaxed_states(self, joint: Joint) -> dict[str, sp.Expr]:
        return {{
            {("," + chr(10) + "            ").join(relaxed)},
        }}
"""
    return f'''"""A law for what the model leaves, as `rfea propose` has read it from the residual torque: {_listed(terms)}."""

import sympy as sp

from rfea_vision.effects.base import Effect, EffectParameter, Joint


class Proposed(Effect):
    """Torque per joint: {" + ".join(f"c{k} {law}" for k, law in enumerate(laws, 1))}.

    a is the tube's angle (rad), r its rate (rad/s), p the pressure (bar), s the place from clamp to tip, t the time (s),
    m the largest angle so far, z0.. the angle as it was remembered.
    """

    id = "{effect_id}"
    title = "Proposed: torque that goes with {_listed(terms)}"
    reference = "regression of the residual torque; give the cause a name and a reference"
    parameters = {{
        {join(parameters)}
    }}
    constants = {{"second": ("s", 1.0), "bar": ("Pa", 1e5), "follow": ("s", 0.0002)}}
{hooks}
    def joint_torque(self, joint: Joint) -> sp.Expr:
        {join(names) if names else "pass"}
        return {sum_}
'''


def _words(text: str) -> set[str]:
    return set(re.findall(r"[a-z]\w*", text))


def _sympy(law: str) -> str:
    return re.sub(r"\b(tanh|cos|exp|Abs)\b", r"sp.\1", f"({law})" if "-" in law or "+" in law else law)


__all__ = ["Proposal", "effect_source", "library", "propose"]
