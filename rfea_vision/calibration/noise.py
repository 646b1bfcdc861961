"""The part of the corners' errors that moves a calibration: the slow part.

Errors of corners are not independent. Those that come from where a corner lies within its pixel alternate from corner
to corner and average out; those of a bent board or a wrong lens are alike among neighbours and do not. What counts is
the power that the residuals have in slow fields over the board, per free mode, and not their mean square.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rfea_vision.arrays import FloatArray

DEGREE = 3  # of the polynomials over the board that slow errors are fitted with
LEAST_FREEDOM = 20.0  # a photo with few corners is pulled towards the plain noise


def slow_variance(
    boards_mm: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    pose_jacobians: Sequence[FloatArray],
    lens_count: int,
    plain: float,
) -> float:
    """Variance per coordinate of the slow part of the residuals.

    Parameters
    ----------
    boards_mm : per view the corners (n, 2) on the board
    residuals : per view (n, 2), divided by the view's own scale
    pose_jacobians : per view (2n, 6), divided likewise
    lens_count : parameters of the lens; they lie in the slow fields
    plain : mean square per degree of freedom, towards which few modes are pulled
    """
    power, freedom = 0.0, -float(lens_count)
    for board, residual, by_pose in zip(boards_mm, residuals, pose_jacobians, strict=True):
        slow = _slow_fields(board)
        pose, _ = np.linalg.qr(by_pose)
        power += float(np.sum((slow.T @ residual.ravel()) ** 2))
        freedom += slow.shape[1] - float(np.sum((slow.T @ pose) ** 2))
    freedom = max(freedom, 0.0)
    return (power + LEAST_FREEDOM * plain) / (freedom + LEAST_FREEDOM)


def _slow_fields(board: FloatArray) -> FloatArray:
    """Orthonormal polynomials over the corners, for both coordinates, (2n, modes)."""
    centred = board - board.mean(axis=0)
    x, y = (centred / max(float(np.abs(centred).max()), 1e-12)).T
    degree = DEGREE if len(board) >= 30 else 2 if len(board) >= 15 else 1
    terms = np.column_stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)])
    basis, upper = np.linalg.qr(terms)
    size = np.abs(np.diag(upper))
    basis = basis[:, size > 1e-9 * size.max()]
    out = np.zeros((2 * len(board), 2 * basis.shape[1]))
    out[0::2, : basis.shape[1]] = basis
    out[1::2, basis.shape[1] :] = basis
    return out
