"""Errors that the noise of the edges does not show, from what the pictures themselves say: in mm, frame by frame.

What is claimed here was set by scenes of known truth (`tests/measurement/test_doubts.py`): a highlight along the tube,
a shutter that is open while the tube moves, light beyond what the camera can tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
# Half widths along a body over which what leads its line astray (rims, glare, shadows, what is behind) stays alike: its own width. In
# thirty drawn films (420 to 449, seen) the line's errors, but for the third that is alike all along, are correlated by a half at 1.7.
WAVERS_OVER = 2.0
SATURATED_BLURS = 0.3  # an edge that is cut off at the brightest level moves by about so much of its blur


@dataclass(frozen=True)
class PictureErrors:
    """Standard errors in mm: `across` (t,) all along the tube, `smear` (t,) at its end, `beyond` (t,) of the end itself.

    Part of `across` is not the same all along: by `wavers` (t,) the line is off to and fro, and that is alike over `alike_over` mm.
    """

    across: FloatArray
    smear: FloatArray
    beyond: FloatArray
    wavers: FloatArray
    alike_over: float

    @property
    def turned(self) -> FloatArray:
        """Standard error (t,) of the line's direction, rad: slope of an error that is correlated as a Gaussian of `alike_over`."""
        return self.wavers / self.alike_over

    @property
    def bent(self) -> FloatArray:
        """Standard error (t,) of its curvature, 1/mm, likewise."""
        return 3.0**0.5 * self.wavers / self.alike_over**2

    def turned_over(self, step_mm: FloatArray) -> FloatArray:
        """Standard error of how much the line turns from one place to another that is `step_mm` (t, n) on, rad, likewise."""
        apart = (step_mm / self.alike_over) ** 2
        return self.turned[:, None] * np.sqrt(2.0 * (1.0 - (1.0 - apart) * np.exp(-0.5 * apart)))

    def grown(self, moved_mm: FloatArray, missed_mm: float) -> PictureErrors:
        """With what all of the picture seems to have `moved` (t,) in a frame, and the end to be `missed` in all."""
        beyond = np.hypot(np.hypot(self.beyond, moved_mm), missed_mm)
        return replace(self, across=np.hypot(self.across, moved_mm), beyond=beyond)

    def part(self, frames: slice) -> PictureErrors:
        """Those of some frames."""
        across, smear, beyond, wavers = (values[frames] for values in (self.across, self.smear, self.beyond, self.wavers))
        return PictureErrors(across, smear, beyond, wavers, self.alike_over)


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
    across = np.hypot(PROFILE_SHARE * numbers["profile"] / px_per_mm, one_edge)
    at_end = np.hypot(smear, CONTINUED_SHARE * continued)
    wavers = numbers["wavers"] / px_per_mm
    return PictureErrors(across, at_end, np.hypot(cut_off, rim), wavers, alike_over=WAVERS_OVER * half_mm)
