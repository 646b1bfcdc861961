"""Errors that the noise of the edges does not show, from what the pictures themselves say: in mm, frame by frame.

What is claimed here was set by scenes of known truth (`tests/measurement/test_doubts.py`): a highlight along the tube,
a shutter that is open while the tube moves, light beyond what the camera can tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray

ORIGIN_PX = 0.01  # what is left of the origin's error in any film: the same in all frames
PROFILE_SHARE = 1.5  # of the width of an edge, for each share of its light step that is not a blurred step
WIDTH_SHARE = 0.05  # of the tube's width: so well it is known
SMEAR_SHARE = 0.04  # of the way that the end goes while the shutter is open
CONTINUED_SHARE = 0.35  # of the length at the end whose edges could not be used, where the curve is only continued,
CONTINUED_FREELY = 0.01  # beyond this share of the tube
HALF_CIRCLE = 0.58  # roundness that is fitted to the middle of one
NOT_A_PARABOLA = 0.01  # of the half width: how far the end of a round tube is from where a parabola has it
UNLIKELY_MOVE = 4.0  # standard errors
ORIGIN_MOVE_MM = 0.01
SATURATED_BLURS = 0.3  # an edge that is cut off at the brightest level moves by about so much of its blur


@dataclass(frozen=True)
class PictureErrors:
    """Standard errors in mm: `across` (t,) all along the tube, `smear` (t,) at its end, `beyond` (t,) of the end itself."""

    across: FloatArray
    smear: FloatArray
    beyond: FloatArray

    def grown(self, moved_mm: FloatArray, missed_mm: float) -> PictureErrors:
        """With what all of the picture seems to have `moved` (t,) in a frame, and the end to be `missed` in all."""
        return PictureErrors(np.hypot(self.across, moved_mm), self.smear, np.hypot(np.hypot(self.beyond, moved_mm), missed_mm))

    def part(self, frames: slice) -> PictureErrors:
        """Those of some frames."""
        return PictureErrors(self.across[frames], self.smear[frames], self.beyond[frames])


def camera_moved(start_mm: FloatArray, stderr_mm: FloatArray) -> FloatArray:
    """By how much (t,) all of the picture seems to have moved where the clamp is elsewhere than in most frames, `start_mm` (t,).

    The clamp does not move: where it seems to across the tube, by more than its error allows, the camera did, and in
    the direction that is not seen about as far.
    """
    off = np.abs(start_mm - np.median(start_mm))
    return np.where(off > UNLIKELY_MOVE * np.maximum(stderr_mm, ORIGIN_MOVE_MM), off, 0.0)


def picture_errors(numbers: NDArray[Any], half_mm: float, px_per_mm: float) -> PictureErrors:
    """Read them from the numbers of the fits (t, NUMBERS); `half_mm` is what the tube's half width should be."""
    too_wide = np.abs(numbers["width"] / 2 - half_mm)
    # A highlight as light as the wall, or a shadow as dark: one edge is elsewhere, and the middle by half as much.
    one_edge = np.sqrt(np.maximum(too_wide**2 - (WIDTH_SHARE * half_mm) ** 2, 0.0))
    cut_off = numbers["saturated"] * (too_wide + SATURATED_BLURS * numbers["blur"] / px_per_mm)
    # A round end darkens towards its rim as the sides do, and seems to lie as far inwards as they do.
    rounded = np.clip(numbers["cap_round"] / HALF_CIRCLE, 0.0, 1.0)
    rim = rounded * (too_wide + NOT_A_PARABOLA * half_mm)
    smear = SMEAR_SHARE * numbers["smear"] / px_per_mm
    continued = np.maximum(numbers["end_gap"] - CONTINUED_FREELY, 0.0) * numbers["length"]
    return PictureErrors(
        np.hypot(PROFILE_SHARE * numbers["profile"] / px_per_mm, one_edge),
        np.hypot(smear, CONTINUED_SHARE * continued),
        np.hypot(cut_off, rim),
    )
