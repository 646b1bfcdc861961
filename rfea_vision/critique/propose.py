"""A law for what no effect of the catalogue explains: a torque on the joints, regressed on a library of terms.

A term is a product of the tube's angle, rate, pressure, memories or the time with the place along the tube. Each is played as a
torque on the joints of the fitted model, and how the model then moves, as the camera would see it, is a column of the regression:
exact where the term is small, and nothing measured is differentiated. What the base parameters and clocks could take up is projected
out. Terms are added one at a time while runs that were left out of the regression are predicted better (the idea of Brunton,
Proctor and Kutz 2016, doi:10.1073/pnas.1517384113, on a residual instead of the whole; Kaheman, Kutz and Brunton 2020,
doi:10.1098/rspa.2020.0279). The best law is written as an effect file, such as people write by hand.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts.judgement import ModelFit
from rfea_vision.artefacts.measurement import Recording
from rfea_vision.critique.diagnosis import reopened
from rfea_vision.critique.floors import binding, floors_of
from rfea_vision.critique.measures import STRUCTURE_FLOORS, errors_of, matters, structure
from rfea_vision.critique.screening import absorbable
from rfea_vision.critique.terms import Term, Trajectory, effect_source, library, listed
from rfea_vision.effects.permission import name_files
from rfea_vision.errors import DataError
from rfea_vision.files import write_text
from rfea_vision.fitting.fit import fit_added
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.problem import Problem
from rfea_vision.fitting.ratio import with_lever_free
from rfea_vision.fitting.refit import Fitted
from rfea_vision.fitting.residuals import Evaluation, as_it_stood, evaluate
from rfea_vision.fitting.uncertainty import frame_of_row
from rfea_vision.units import rounded

#: A term is kept where it lowers the error on runs left out of the regression by this share of its square (as in docs/formats.md),
#: and a law has no more terms than a person reads.
LEAST_GAIN, MOST_TERMS = 0.1, 4
#: Laws that are refitted, each begun with another quantity: a linear step ranks them no better than that.
MOST_LAWS = 3
#: Frames of each run that are looked at: more are correlated and tell nothing new.
FRAMES = 200
#: Size of the torque that a term is played with, in rad of the first spring: small, so that the motion answers in proportion.
SMALL = 1e-3
#: Shares of the linear step from which a law is refitted, until it comes below the model without: a spring may lose more than it has.
STARTS = (1.0, 0.3)


@dataclass(frozen=True)
class Law:
    """Terms with their coefficients (N m), and the share of the residual's square that they predict on runs left out."""

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
        Nothing is left that a law could explain, or no law predicts runs that it was not regressed on.
    """
    problem, fitted = reopened(model, recordings)
    fitted = with_lever_free(problem, fitted)
    before = errors_of(problem, fitted)
    floor = binding(floors_of(problem, fitted))
    if structure(before, floor) < STRUCTURE_FLOORS:
        raise DataError(f"model {model.name}: what it leaves is at the floor; there is no law to propose")
    terms, parts = played(problem, fitted)
    laws = regress(terms, parts)
    if not laws:
        raise DataError(
            f"model {model.name}: no term of the library predicts what is left of runs to which it was not fitted; "
            "'rfea compare' says where and when it is large"
        )
    tried = []
    with tempfile.TemporaryDirectory(prefix="rfea-law-") as folder:  # what stands in `file` stays until a law helps
        draft = Path(folder) / file.name
        name_files([draft])
        for law in laws:
            after = _refitted(problem, fitted, draft, effect_id, law)
            if after is not None:
                found = tuple(after.values[f"{effect_id}.c{k}"] for k in range(1, len(law.terms) + 1))
                found_law = replace(law, coefficients=found)
                tried.append((after.solution.cost, found_law, errors_of(problem, after)))
    helping = [row for row in tried if matters(before, row[2], floor)]
    if not helping:
        raise DataError(
            f"model {model.name}: the best law of the library, {listed(laws[0].terms)}, does not lower the held-out error"
        )
    _, best, after = min(helping, key=lambda row: row[0])
    write_text(file, effect_source(effect_id, best.terms, best.coefficients))
    name_files([file])  # what is written here is our own
    return _described(file, best, (before.held, after.held), "mm" if problem.train[0].has_tip else "deg")


def _described(file: Path, law: Law, held: tuple[float, float], unit: str) -> Proposal:
    sentence = (
        f"What is left goes with {listed(law.terms)}; with that law refitted the held-out error falls from "
        f"{rounded(held[0])} to {rounded(held[1])} {unit}. It is a description, not yet a cause: "
        f"`rfea improve CAMPAIGN --effect-file {file}` weighs it."
    )
    laws = tuple(term.law for term in law.terms)
    return Proposal(file, laws, law.coefficients, law.r2, held[0], held[1], unit, sentence)


def _refitted(problem: Problem, fitted: Fitted, file: Path, effect_id: str, law: Law) -> Fitted | None:
    """The model with a law; None where from no start it comes below the model without."""
    for size in STARTS:
        write_text(file, effect_source(effect_id, law.terms, [size * value for value in law.coefficients]))
        options = replace(
            fitted.options,
            effects=(*fitted.options.effects, effect_id),
            effect_files=(*fitted.options.effect_files, file),
            name=f"{fitted.options.name}+{effect_id}",
        )
        try:
            found = fit_added(problem, options, fitted)
        except DataError:
            continue
        if found.solution.cost < fitted.solution.cost:
            return found
    return None


# -- the regression ---------------------------------------------------------------------------------------------------------


def played(problem: Problem, fitted: Fitted) -> tuple[list[Term], list[FloatArray]]:
    """All terms, and the normal equations (terms + 1, terms + 1) of each part of the training runs; the last is the residual.

    Columns are what a term of one N m changes in what is seen, in standard errors, less what base parameters and clocks can make.

    Raises
    ------
    DataError
        A training run cannot be simulated.
    """
    items = [item.rough(FRAMES) for item in problem.train]
    names = fitted.model.names
    free = [names.index(name) for name in fitted.coordinates.names]
    clocks = fitted.solution.clocks
    before = evaluate(fitted.model, fitted.par, items, free, clocks)
    if before is None:
        raise DataError("a training run cannot be simulated with steps of twice the usual length")
    terms = library([_trajectory(fitted, item) for item in items])
    columns = [_answer(fitted, items, term, SMALL * float(fitted.par[0]), before) for term in terms]
    basis, _ = np.linalg.qr(absorbable(before, fitted, len(free)))
    wide = np.column_stack([*columns, -before.residual])
    wide -= basis @ (basis.T @ wide)
    return terms, [wide[rows].T @ wide[rows] for rows in _parts(items, before)]


def _trajectory(fitted: Fitted, item: Observed) -> Trajectory:
    excitation = item.excitation
    time = excitation.start_s + excitation.step_s * np.arange(excitation.pressure.size, dtype=np.float64)
    motion = as_it_stood(fitted.model, fitted.par, item, time[:-1])
    if not motion.ok:
        raise DataError(f"experiment {item.name}: {motion.message}")
    phi, rate = (np.concatenate([values, values[-1:]]) for values in (motion.phi, motion.rate))
    return Trajectory(time, np.diff(phi, axis=1), np.diff(rate, axis=1), excitation.pressure)


def _answer(fitted: Fitted, items: Sequence[Observed], term: Term, torque: float, before: Evaluation) -> FloatArray:
    """Change of the residual (rows,) for one N m of a term; none where it cannot be played."""
    size = np.sqrt(np.mean([np.mean(values**2) for values in term.values]))
    if not size > 0:
        return np.zeros(before.residual.size)
    driven = [
        replace(item, excitation=replace(item.excitation, drive=torque / size * values))
        for item, values in zip(items, term.values, strict=True)
    ]
    after = evaluate(fitted.model, fitted.par, driven, (), fitted.solution.clocks)
    return np.zeros(before.residual.size) if after is None else (after.residual - before.residual) * (size / torque)


def _parts(items: Sequence[Observed], before: Evaluation) -> list[NDArray[np.int64]]:
    """Rows of each part: a run each, or the halves of a single run."""
    rows = [np.arange(part.start, part.stop) for part in before.slices]
    if len(items) > 1:
        return rows
    late = frame_of_row(items[0], rows[0].size) >= items[0].time.size // 2
    return [rows[0][~late], rows[0][late]]


def regress(terms: Sequence[Term], parts: Sequence[FloatArray]) -> list[Law]:
    """The best laws, each begun with another quantity, cross-validated over `parts`: normal equations as of `played`."""
    total = np.sum(parts, axis=0)

    def solved(chosen: Sequence[int], fold: int | None) -> tuple[FloatArray, float]:
        """Coefficients without one of the parts, and the squared error on it."""
        rest = total if fold is None else total - parts[fold]
        scale = np.sqrt(np.maximum(np.diag(rest)[chosen], 1e-300))
        normal = rest[np.ix_(chosen, chosen)] / np.outer(scale, scale) + 1e-8 * np.eye(len(chosen))
        found = np.linalg.solve(normal, rest[chosen, -1] / scale) / scale
        all_ = np.append(np.zeros(len(terms)), -1.0)
        all_[chosen] = found
        return found, 0.0 if fold is None else float(all_ @ parts[fold] @ all_)

    def error(chosen: Sequence[int]) -> float:
        return sum(solved(chosen, fold)[1] for fold in range(len(parts)))

    before = float(total[-1, -1])
    alone = {k: error([k]) for k in range(len(terms)) if total[k, k] > 0}
    found, begun, seen = list[Law](), set[str](), list[set[int]]()
    for first in sorted(alone, key=lambda k: alone[k]):
        if len(found) == MOST_LAWS or alone[first] > (1 - LEAST_GAIN) * before:
            break
        quantity = re.split(r" \* exp\(| \* \(1 - s\)| \* s$", terms[first].law)[0]
        if quantity in begun:
            continue
        begun.add(quantity)
        chosen, now = [first], alone[first]
        while len(chosen) < MOST_TERMS:
            tried = {k: error([*chosen, k]) for k in alone if k not in chosen}
            best = min(tried, key=lambda k: tried[k])
            if tried[best] > (1 - LEAST_GAIN) * now:
                break
            chosen.append(best)
            now = tried[best]
            for one in chosen[:-1]:  # which another has made idle
                rest = [k for k in chosen if k != one]
                if (1 - LEAST_GAIN) * error(rest) <= now:
                    chosen, now = rest, error(rest)
        if set(chosen) in seen:
            continue
        seen.append(set(chosen))
        coefficients, _ = solved(chosen, None)
        found.append(Law(tuple(terms[k] for k in chosen), tuple(coefficients.tolist()), 1 - now / before))
    return found


__all__ = ["Proposal", "propose", "regress"]
