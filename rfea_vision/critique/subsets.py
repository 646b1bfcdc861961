"""All combinations by linear algebra: what would every set of up to four effects remove of the misfit, by one linear step?

The score test (screening.py) gives the slopes of the residual over every amplitude, less what the base model can absorb. The
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
            ranked = self._ranked(beam, present, most)
            # All pairs are looked at, also those of which one alone would have the wrong sign.
            beam = [picks for picks, _ in ranked[:BEAM]] if step else [(k,) for k in range(len(self._columns))]
            sets: dict[frozenset[str], CandidateSet] = {}
            for picks, proposal in ranked:
                if len(sets) < most and self._whole(picks, proposal, present):
                    sets.setdefault(frozenset(proposal.effects), proposal)
            found.append(list(sets.values()))
        return found

    def _ranked(
        self, beam: Sequence[tuple[int, ...]], present: frozenset[str], most: int
    ) -> list[tuple[tuple[int, ...], CandidateSet]]:
        """Sets of the beam with one effect more, best first; without those that even unbounded would be none of the best."""
        keys = dict[tuple[int, ...], None]()
        for picks in beam:
            taken = {self._columns[i].effect for i in picks}
            keys |= {tuple(sorted((*picks, k))): None for k, c in enumerate(self._columns) if c.effect not in taken}
        ceilings = dict(zip(keys, self._ceilings(list(keys)), strict=True))
        tried: dict[tuple[int, ...], CandidateSet] = {}
        for place, key in enumerate(sorted(keys, key=lambda key: -ceilings[key])):
            if place % BEAM == 0:
                above = {picks: one for picks, one in tried.items() if one.fall >= ceilings[key]}
                whole = {frozenset(one.effects) for picks, one in above.items() if self._whole(picks, one, present)}
                if len(above) >= BEAM and len(whole) >= most:
                    break
            proposal = self._step(key)
            if proposal is not None:
                tried[key] = proposal
        return sorted(((key, tried[key]) for key in keys if key in tried), key=lambda pair: -pair[1].fall)

    def _whole(self, picks: tuple[int, ...], proposal: CandidateSet, present: frozenset[str]) -> bool:
        """Whether a set has with each effect what that goes with."""
        return {one for i in picks for one in self._columns[i].needs} <= {*present, *proposal.effects}

    def _ceilings(self, keys: Sequence[tuple[int, ...]]) -> list[float]:
        """The share of the squared error that each set would remove if nothing bounded it."""
        out = np.zeros(len(keys))
        places = [np.concatenate([self._columns[i].place for i in key]) for key in keys]
        for count in {place.size for place in places}:
            rows = [k for k, place in enumerate(places) if place.size == count]
            at = np.array([places[k] for k in rows])
            size = np.sqrt(np.maximum(np.diag(self._hessian)[at], 1e-300))
            normed = self._hessian[at[:, :, None], at[:, None, :]] / (size[:, :, None] * size[:, None, :])
            slope = (self._gradient[at] / size)[:, :, None]
            fall = np.sum(slope * np.linalg.solve(normed + 1e-9 * np.eye(count), slope), axis=(1, 2)) * (1 + 1e-9)
            out[rows] = fall / self._cost
        return out.tolist()

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
