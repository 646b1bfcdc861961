"""Intervals that allow for correlated residuals, and a refusal where the data say nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve
from scipy.stats import t as student

from rfea_vision.arrays import FloatArray
from rfea_vision.fitting.observed import Observed
from rfea_vision.fitting.residual_tests import autocorrelation, correlation_time
from rfea_vision.fitting.solver import Solution

BLOCK_S = 0.4  # a block may be this long, however short the run
#: A residual that forgets itself within this many frames counts as white.
WHITE_FRAMES = 0.75
#: Length of a block in correlation times; cutting a memory at the blocks' ends loses about one part in this many.
BLOCK_IN_MEMORIES = 8.0
FEWEST_BLOCKS = 10
#: Below this an autocorrelation is taken for lost.
LOST = 0.05
#: A direction of parameter space whose singular value is this much below the largest carries no information.
UNIDENTIFIABLE = 1e-5


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of the optimiser's coordinates, the t quantile of its 95 % intervals, and which coordinates are undetermined.

    `weak` are the directions, one per row, along which the data tell nothing.
    """

    covariance: FloatArray
    quantile: float
    undetermined: NDArray[np.bool_]
    weak: FloatArray


def frame_of_row(item: Observed, rows: int) -> NDArray[np.int64]:
    """Frame index (rows,) of each residual row, in the order in which `residuals.rows` stacks them."""
    frames = item.time.size
    if item.observe in ("angle", "tip_y"):
        return np.arange(frames)
    tip = np.repeat(np.arange(frames), 2)
    nodes = (rows - tip.size) // frames
    return np.concatenate([np.repeat(np.arange(frames), nodes), tip])


def block_length_s(item: Observed, residual: FloatArray) -> float:
    """Length (s) of the blocks over which a run's residual (rows,) may be correlated: one frame where it is white."""
    frames, period = item.time.size, item.period_s
    tail = residual[-(frames * (2 if residual.size >= 2 * frames else 1)) :]  # the tip's rows come last
    memory = correlation_time(tail.reshape(frames, -1), period)
    if memory < WHITE_FRAMES * period:
        return period
    longest = max(BLOCK_S, (item.time[-1] - item.time[0]) / FEWEST_BLOCKS)
    return float(np.clip(BLOCK_IN_MEMORIES * memory, period, longest))


def _by_autocorrelation(item: Observed, residual: FloatArray, jacobian: FloatArray) -> FloatArray:
    """J' C J (p, p) of one run, C the autocorrelation over time that all its coordinates share, up to where it is lost."""
    frames = item.time.size
    tip = 2 * frames if residual.size >= 2 * frames else frames
    parts = [slice(0, residual.size - tip), slice(residual.size - tip, residual.size)]
    columns = [residual[part].reshape(frames, -1) for part in parts if part.stop > part.start]
    correlation = autocorrelation(np.concatenate(columns, axis=1))
    lost = np.flatnonzero(correlation < LOST)
    correlation = correlation[: max(int(lost[0]) if lost.size else frames // FEWEST_BLOCKS, 1)]
    kernel = np.concatenate([correlation[:0:-1], correlation])
    out = np.zeros((jacobian.shape[1], jacobian.shape[1]))
    for part in parts:
        if part.stop > part.start:
            own = jacobian[part].reshape(frames, -1)
            spread = own if kernel.size == 1 else fftconvolve(own, kernel[:, None], mode="same", axes=0)
            out += own.reshape(-1, out.shape[0]).T @ spread.reshape(-1, out.shape[0])
    return out


def uncertainty_of(solution: Solution, items: Sequence[Observed]) -> Uncertainty:
    """Uncertainty of the optimiser's coordinates and free clocks at a solution; `items` are the runs, as they were fitted.

    Cluster-robust covariance over blocks of time: J^-1 (sum over blocks of g g') J^-1 (Liang and Zeger 1986,
    doi:10.1093/biomet/73.1.13). Nodes of one frame, and frames of one block, may be correlated in any way; a block lasts several
    correlation times of the residual, and the number of blocks gives the degrees of freedom. From few blocks the estimate may be
    too small; so the covariance from the residual's variance and autocorrelation alone is a lower bound, and so is the classical one.
    """
    weight = np.sqrt(solution.row_weight)
    residual, jacobian = solution.evaluation.residual * weight, solution.scaled_jacobian * weight[:, None]
    count, known = jacobian.shape[1], solution.prior_jacobian
    scale = np.sqrt(np.sum(jacobian**2, axis=0) + np.sum(known**2, axis=0))
    seen = scale > 0
    scale = np.where(seen, scale, 1.0)
    normed, known = jacobian / scale, known / scale
    _, singular, rows_v = np.linalg.svd(np.concatenate([normed, known]), full_matrices=False)
    weak = singular < UNIDENTIFIABLE * max(singular.max(initial=0.0), 1e-300)
    undetermined = np.any(np.abs(rows_v[weak]) > 0.1, axis=0) if np.any(weak) else np.zeros(count, dtype=bool)
    undetermined |= ~seen
    strong = ~weak
    inverse = (rows_v[strong].T / singular[strong] ** 2) @ rows_v[strong]
    meat, smooth = known.T @ known, np.zeros((count, count))
    blocks = 0
    for item, part in zip(items, solution.evaluation.slices, strict=True):
        gradient = normed[part] * residual[part, None]
        frame = frame_of_row(item, gradient.shape[0])
        block = ((item.time - item.time[0]) / block_length_s(item, residual[part]) + 1e-6).astype(int)[frame]
        totals = np.zeros((int(block.max()) + 1, count))
        np.add.at(totals, block, gradient)
        meat += totals.T @ totals
        blocks += np.unique(block).size
        smooth += _by_autocorrelation(item, residual[part], normed[part])
    freedom = max(blocks - count, 1)
    robust = inverse @ meat @ inverse * blocks / freedom
    variance = float(residual @ residual) / max(residual.size - count, 1)
    parametric = np.maximum(
        np.diag(inverse @ (variance * normed.T @ normed + known.T @ known) @ inverse),
        np.diag(inverse @ (variance * smooth + known.T @ known) @ inverse),
    )
    # Take whichever is wider, parameter by parameter, keeping the robust correlations.
    widen = np.sqrt(np.maximum(1.0, parametric / np.maximum(np.diag(robust), 1e-300)))
    covariance = robust * np.outer(widen, widen) / np.outer(scale, scale)
    return Uncertainty(covariance, float(student.ppf(0.975, freedom)), undetermined, rows_v[weak] / scale)
