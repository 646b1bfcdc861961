"""All combinations by linear algebra: what would every set of up to four effects remove of the misfit, by one linear step?

The score test (screening.py) gives the slopes of the residual over every amplitude, less what the base model can swallow. The
joint Gauss-Newton step of any set is then a solve of a few unknowns, so that a pair whose members are each too weak alone is
found as surely as a single effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.critique.screening import Sensitivity, bounded_step, room

MOST_TOGETHER = 4  # effects in one set: larger ones are reached from the better set, found first
#: Pairs, and triples, from which larger sets are built. With the sixty columns of the catalogue: some 8,000 small solves.
BEAM = 60


@dataclass(frozen=True)
class CandidateSet:
    """A set of effects with the values of a linear step; `fall` is the share of the squared error that it would remove."""

    effects: tuple[str, ...]
    start: dict[str, float]
    fall: float


@dataclass(frozen=True)
class _Column:
    effect: str
    needs: tuple[str, ...]
    grid: dict[str, float]
    names: tuple[str, ...]
    place: NDArray[np.int64]
    absent: FloatArray
    low: FloatArray
    high: FloatArray


class Combinations:
    """Normal equations of all sensitivities at one fit."""

    def __init__(self, rows: Sequence[Sensitivity]) -> None:
        rows = [row for row in rows if row.residual.size == rows[0].residual.size] if rows else []
        self._columns: list[_Column] = []
        at = 0
        for row in rows:
            self._columns.append(
                _Column(
                    row.effect.id,
                    tuple(row.effect.goes_with),
                    {f"{row.effect.id}.{k}": v for k, v in row.grid.items()},
                    tuple(f"{row.effect.id}.{name}" for name in row.names),
                    np.arange(at, at + len(row.names)),
                    *room(row.effect, row.names),
                )
            )
            at += len(row.names)
        wide = np.concatenate([row.jacobian for row in rows], axis=1) if rows else np.zeros((0, 0))
        # The residual is measured minus modelled; its Jacobian has the sign of minus the model's.
        self._gradient = -wide.T @ rows[0].residual if rows else np.zeros(0)
        self._hessian = wide.T @ wide
        self._cost = float(rows[0].residual @ rows[0].residual) if rows else 1.0

    def best(self, present: frozenset[str], size: int, most: int) -> list[list[CandidateSet]]:
        """The best proposals of every size up to `size`, at most `most` sets of each; of a set its best point of the grids."""
        found: list[list[CandidateSet]] = []
        beam: list[tuple[int, ...]] = [()]
        for step in range(size):
            tried: dict[tuple[int, ...], CandidateSet] = {}
            for picks in beam:
                taken = {self._columns[i].effect for i in picks}
                for k, column in enumerate(self._columns):
                    key = tuple(sorted((*picks, k)))
                    if column.effect not in taken and key not in tried:
                        proposal = self._step(key)
                        if proposal is not None:
                            tried[key] = proposal
            ranked = sorted(tried.items(), key=lambda pair: -pair[1].fall)
            # All pairs are looked at, also those of which one alone would have the wrong sign.
            beam = [picks for picks, _ in ranked[:BEAM]] if step else [(k,) for k in range(len(self._columns))]
            sets: dict[frozenset[str], CandidateSet] = {}
            for picks, proposal in ranked:
                needed = {one for i in picks for one in self._columns[i].needs}
                if needed <= {*present, *proposal.effects}:
                    sets.setdefault(frozenset(proposal.effects), proposal)
                if len(sets) >= most:
                    break
            found.append(list(sets.values()))
        return found

    def _step(self, picks: tuple[int, ...]) -> CandidateSet | None:
        """The joint step, within its bounds; None where an effect would have the wrong sign: the set without it is as good."""
        columns = [self._columns[i] for i in picks]
        place = np.concatenate([column.place for column in columns])
        absent, low, high = (np.concatenate([getattr(c, key) for c in columns]) for key in ("absent", "low", "high"))
        step, fall = bounded_step(self._gradient[place], self._hessian[np.ix_(place, place)], low, high)
        begin = 0
        for column in columns:
            own = slice(begin, begin + column.place.size)
            begin = own.stop
            if not step[own].any():
                return None
        start = {name: value for column in columns for name, value in column.grid.items()}
        names = [name for column in columns for name in column.names]
        start |= dict(zip(names, (absent + step).tolist(), strict=True))
        return CandidateSet(tuple(column.effect for column in columns), start, fall / self._cost)


__all__ = ["MOST_TOGETHER", "CandidateSet", "Combinations"]
