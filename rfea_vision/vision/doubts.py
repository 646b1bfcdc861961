"""Errors that the noise of the edges does not show, from what the pictures themselves say: in mm, frame by frame.

What is claimed here was set by scenes of known truth (`tests/measurement/test_doubts.py`): a highlight along the tube,
a shutter that is open while the tube moves, light beyond what the camera can tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfea_vision.vision import fitted

FloatArray = NDArray[np.float64]

PROFILE_SHARE = 1.5  # of the width of an edge, for each share of its light step that is not a blurred step
SMEAR_SHARE = 0.04  # of the way that the end goes while the shutter is open
SATURATED_BLURS = 0.3  # an edge that is cut off at the brightest level moves by about so much of its blur


@dataclass(frozen=True)
class Doubts:
    """Standard errors in mm: `across` (t,) all along the tube, `smear` (t,) at its end, `beyond` (t,) of the end itself."""

    across: FloatArray
    smear: FloatArray
    beyond: FloatArray

    @property
    def shared_across(self) -> float:
        """What all frames have in common: it moves the origin as well."""
        return float(np.median(self.across))


def doubts(numbers: FloatArray, half_mm: float, px_per_mm: float) -> Doubts:
    """Read the doubts from the numbers of the fits (t, NUMBERS); `half_mm` is what the tube's half width should be."""
    too_wide = np.abs(numbers[:, fitted.WIDTH] / 2 - half_mm)
    cut_off = numbers[:, fitted.SATURATED] * (too_wide + SATURATED_BLURS * numbers[:, fitted.BLUR] / px_per_mm)
    return Doubts(
        PROFILE_SHARE * numbers[:, fitted.PROFILE] / px_per_mm,
        SMEAR_SHARE * numbers[:, fitted.SMEAR] / px_per_mm,
        cut_off,
    )
