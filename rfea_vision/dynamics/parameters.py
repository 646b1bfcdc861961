"""The paper's parameters, as printed and as the engine uses them (Table EstimatedParam, eq. SpringCoefficient)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PER_DEGREE = 180 / np.pi  # degrees per radian
REST_RADIUS = 0.003  # m, of the paper's bore: its 6 mm are a diameter (docs/physics.md, erratum 1)


@dataclass(frozen=True)
class PaperParameters:
    """One column of Table EstimatedParam: per joint, per degree, at zero inner radius, joints at the start of each body."""

    segments: int
    k_0: float  # Nm/deg
    m_k: float  # N/deg
    b_0pos: float  # Nms/deg
    m_bpos: float  # Ns/deg
    b_0neg: float  # Nms/deg
    m_bneg: float  # Ns/deg
    r_hyd: float  # m
    source: str

    def vector(self, inner_radius: float = REST_RADIUS) -> NDArray[np.float64]:
        """Value at the rest radius and slope (7,), SI, in the order of `effects.base.BASE_PARAMETERS`."""
        pairs = ((self.k_0, self.m_k), (self.b_0pos, self.m_bpos), (self.b_0neg, self.m_bneg))
        values = [v for zero, slope in pairs for v in ((zero + slope * inner_radius) * PER_DEGREE, slope * PER_DEGREE)]
        return np.array([*values, self.r_hyd])


def scaled(vector: NDArray[np.float64], from_segments: int, to_segments: int) -> NDArray[np.float64]:
    """The same tube, (7,) in SI, with another number of segments: k and b per joint go with n, r_hyd does not."""
    out = np.array(vector, dtype=float)
    out[:6] *= to_segments / from_segments
    return out


def as_paper(vector: NDArray[np.float64], inner_radius: float = REST_RADIUS) -> dict[str, float]:
    """k_0, m_k, b_0pos, ... in the units of the paper's table (per degree, at zero inner radius), of a vector (7,) in SI."""
    out: dict[str, float] = {}
    for index, (zero, slope) in enumerate((("k_0", "m_k"), ("b_0pos", "m_bpos"), ("b_0neg", "m_bneg"))):
        out[zero] = (vector[2 * index] - vector[2 * index + 1] * inner_radius) / PER_DEGREE
        out[slope] = vector[2 * index + 1] / PER_DEGREE
    out["r_hyd"] = float(vector[6])
    return out


def as_paper_matrix(inner_radius: float = REST_RADIUS) -> NDArray[np.float64]:
    """Linear map (7, 7) from the engine's parameters to the paper's, for their covariance."""
    return np.array([[as_paper(row, inner_radius)[key] for row in np.eye(7)] for key in PAPER_UNITS])


PAPER_UNITS = {
    "k_0": "N*m/deg",
    "m_k": "N/deg",
    "b_0pos": "N*m*s/deg",
    "m_bpos": "N*s/deg",
    "b_0neg": "N*m*s/deg",
    "m_bneg": "N*s/deg",
    "r_hyd": "m",
}

_SOURCE = "Momeni Kelageri et al., Kinematics and Dynamic Modeling of a Planar Hydraulic Elastomer Actuator, Table I"
PUBLISHED = {
    "2-DoF": PaperParameters(
        2, 0.00075223, -0.00029452, 2.6171e-05, -0.0038529, 3.7374e-08, -3.0518e-05, 0.0037125, _SOURCE
    ),
    "8-DoF": PaperParameters(8, 0.045257, -14.101, 0.00032813, -0.098948, 0.00058815, -0.18966, 0.0035644, _SOURCE),
}
