"""Intervals that allow for correlated residuals, and a refusal where the data say nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from rfea_vision.fitting.observation import Observed

FloatArray = NDArray[np.float64]
BLOCK_S = 0.4
#: A direction of parameter space whose singular value is this much below the largest carries no information.
UNIDENTIFIABLE = 1e-7


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of the optimiser's coordinates, the t quantile of its 95 % intervals, and which coordinates are undetermined."""

    covariance: FloatArray
    quantile: float
    undetermined: NDArray[np.bool_]


def _frame_of_row(item: Observed, rows: int) -> NDArray[np.int64]:
    """Frame index of each residual row, in the order in which `residuals.rows` stacks them."""
    frames = item.time.size
    if item.observe in ("angle", "tip_y"):
        return np.arange(frames)
    tip = np.repeat(np.arange(frames), 2)
    nodes = (rows - tip.size) // frames
    return np.concatenate([np.repeat(np.arange(frames), nodes), tip])


def sandwich(
    items: list[Observed], residual: FloatArray, jacobian: FloatArray, slices: tuple[slice, ...]
) -> Uncertainty:
    """Cluster-robust covariance over blocks of time: J^-1 (sum over blocks of g g') J^-1.

    Nodes of one frame, and frames of one block, may be correlated in any way. The blocks' number gives the degrees of
    freedom. The classical covariance, scaled by the residual variance, is a lower bound.
    """
    count = jacobian.shape[1]
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    normed = jacobian / scale
    _, singular, rows_v = np.linalg.svd(normed, full_matrices=False)
    weak = singular < UNIDENTIFIABLE * max(singular[0], 1e-300)
    undetermined = np.any(np.abs(rows_v[weak]) > 0.1, axis=0) if np.any(weak) else np.zeros(count, dtype=bool)
    undetermined |= np.sqrt(np.sum(jacobian**2, axis=0)) == 0
    strong = ~weak
    inverse = (rows_v[strong].T / singular[strong] ** 2) @ rows_v[strong]
    meat = np.zeros((count, count))
    blocks = 0
    for item, part in zip(items, slices, strict=True):
        gradient = normed[part] * residual[part, None]
        frame = _frame_of_row(item, gradient.shape[0])
        block = ((item.time - item.time[0]) / BLOCK_S).astype(int)[frame]
        for index in np.unique(block):
            total = gradient[block == index].sum(axis=0)
            meat += np.outer(total, total)
            blocks += 1
    freedom = max(blocks - count, 1)
    robust = inverse @ meat @ inverse * blocks / freedom
    classical = inverse * float(residual @ residual) / max(residual.size - count, 1)
    # Take whichever is wider, parameter by parameter, keeping the robust correlations.
    widen = np.sqrt(np.maximum(1.0, np.diag(classical) / np.maximum(np.diag(robust), 1e-300)))
    covariance = robust * np.outer(widen, widen) / np.outer(scale, scale)
    return Uncertainty(covariance, float(student.ppf(0.975, freedom)), undetermined)
