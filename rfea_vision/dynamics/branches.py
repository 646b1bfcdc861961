"""Steady states along a branch: from the unloaded tube to a pressure, or to a force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rfea_vision.arrays import FloatArray

#: How far (rad) any body may turn between two neighbours on the way to a steady state, so that no branch is jumped over.
LARGEST_STRIDE = 1.5


def followed(solve: Callable[[float, FloatArray], bool], phi: FloatArray, target: float) -> tuple[FloatArray, float]:
    """Follow a branch of steady states from `phi` (n + 1,) at nothing towards `target`: where it was left, and at how much."""
    reached, stride = 0.0, target
    while reached != target:
        guess = phi.copy()
        aim = target if abs(target - reached) <= abs(stride) else reached + stride
        if solve(aim, guess) and np.max(np.abs(guess - phi)) < LARGEST_STRIDE:
            phi, reached = guess, aim
        elif abs(stride) > 1e-3 * abs(target):
            stride /= 2
        else:
            break
    return phi, reached
