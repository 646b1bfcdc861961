"""What is known of the tube while a video runs, and the arrays and numbers of one frame's fit."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.curve import COEFFICIENTS, VERTEX_U, VERTICES, WIDTH_COEFFICIENTS
from rfea_vision.vision.edges.edgels import LEVEL_COLUMNS, MAX_STATIONS, STATION_COLUMNS
from rfea_vision.vision.edges.step import Steps, steps


class FrameFit(NamedTuple):
    """What comes out of a frame: lengths in mm, blurs in px, the rest shares."""

    length: float
    width: float
    tip_variance: float
    noise: float  # grey levels
    used: float  # share of the edges
    profile: float  # of an edge that is not a blurred step
    blur: float
    cap_used: float
    longest_gap: float  # of the length
    last_step: float  # px
    bend: float  # rad
    tip_x: float  # px
    tip_y: float
    cap_contrast: float
    end_gap: float  # of the length, at the free end
    end_blur: float
    smear: float  # px that the end goes while the shutter is open
    saturated: float
    end_lone: float  # of the length, seen from one side
    end_odd: float
    cap_round: float
    wavers: float  # px by which the line lies off its middle to and fro, 1 s.d.; of edges that are followed their noise says so


#: The same for compiled code, which fills one record frame by frame; of many frames each field is a series.
FRAME = np.dtype([(name, np.float64) for name in FrameFit._fields])

SECTIONS = 64  # along the tube, in which stations are counted


class Shot(NamedTuple):
    """A picture as it lies in memory, how many columns (and rows) of it are the picture's, its camera, and its scale in px per mm.

    A decoder makes rows longer than they need be.
    """

    rows: NDArray[np.uint8]
    width: int
    camera: FloatArray
    px_per_mm: float


class State(NamedTuple):
    """What is known of the tube, updated in place frame by frame.

    coefficients (K, 2) mm; width (Kw,) half width mm; levels (3, V, 2) inside and outside grey levels of the left
    edge, the right edge and the cap; blurs (3, V) px; reference (3, V) contrast at the start; cap (2,) tilt and
    roundness of the tube's end; clamp (4,) point and axis of the clamp line.
    """

    coefficients: FloatArray
    width: FloatArray
    levels: FloatArray
    blurs: FloatArray
    reference: FloatArray
    cap: FloatArray
    clamp: FloatArray


class Buffers(NamedTuple):
    """Arrays that every frame uses again."""

    u: FloatArray
    centre: FloatArray
    normal: FloatArray
    half_width: FloatArray
    edge: FloatArray
    outward: FloatArray
    stations: FloatArray
    residual: FloatArray
    keep: NDArray[np.bool_]
    odd: NDArray[np.bool_]
    sums: FloatArray
    numbers: NDArray[Any]  # (1,) of `FRAME`
    covariance: FloatArray
    sections: FloatArray
    steps: Steps


def new_buffers() -> Buffers:
    """Allocate a workspace."""
    size = COEFFICIENTS + WIDTH_COEFFICIENTS
    return Buffers(
        VERTEX_U.copy(),
        np.empty((VERTICES, 2)),
        np.empty((VERTICES, 2)),
        np.empty(VERTICES),
        np.empty((VERTICES, 2)),
        np.empty((VERTICES, 2)),
        np.zeros((MAX_STATIONS, STATION_COLUMNS)),
        np.empty(MAX_STATIONS),
        np.zeros(MAX_STATIONS, dtype=np.bool_),
        np.zeros(MAX_STATIONS, dtype=np.bool_),
        np.zeros((3, VERTICES, LEVEL_COLUMNS)),
        np.zeros(1, dtype=FRAME),
        np.zeros((size, size)),
        np.zeros((4, SECTIONS)),
        steps(),
    )
