"""What a person points at in a film of known truth: the clamp's two edges, the tip, and a ruler."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rfea_vision.artefacts import Actuator, Calibration, Correction, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from testing.drawn import Truth as DrawnTruth
from testing.phone import Truth as PhoneTruth

RULER_MM = 100.0
CLAMP_PX, TIP_PX = 1.0, 1.5  # how well people point, 1 s.d.
AGAIN_AT = 13, 26, 38, 51, 64  # of 65 stations: where they point again in a later frame


class Pointed(NamedTuple):
    """What is known of a film before it is read."""

    calibration: Calibration
    tube: Actuator
    hints: Hints


def pointed_by_hand(truth: DrawnTruth | PhoneTruth, size: tuple[int, int], rng: np.random.Generator | None = None) -> Pointed:
    """What is pointed at in a film of a size (px): beside its places as people do, by `rng`, or without it at them."""
    high, off = np.array(size) - 1.0, np.zeros((3, 2))
    if rng is not None:
        off = rng.normal(0.0, 1.0, (3, 2)) * np.array([[CLAMP_PX], [CLAMP_PX], [TIP_PX]])
    one, other, tip = np.clip(np.array([*truth.clamp_px, truth.tip_px]) + off, 0.0, high).tolist()
    x, y = np.mean(truth.clamp_px, axis=0)
    calibration = scaled_by_distance(size, [[x, y], [x + RULER_MM * truth.px_per_mm, y]], RULER_MM)
    half_m = truth.half_width_px / truth.px_per_mm / 1e3
    tube = Actuator(outer_radius=half_m, inner_radius=half_m / 2, length=truth.length_mm / 1e3)
    return Pointed(calibration, tube, Hints(clamp=(tuple(one), tuple(other)), tip=tuple(tip)))


def pointed_again(truth: DrawnTruth, frame: int, rng: np.random.Generator) -> Correction:
    """Five points along the body where a later frame shows it, the last one at its tip, as well as people point at that."""
    places = truth.centre_px[frame][list(AGAIN_AT)] + rng.normal(0.0, TIP_PX, (len(AGAIN_AT), 2))
    return Correction(frame, tuple((float(x), float(y)) for x, y in places))
