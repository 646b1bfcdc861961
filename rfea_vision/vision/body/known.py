"""What a fit of the body says on the plane of motion, in mm, and how well that is known."""

from __future__ import annotations

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.calibration.projection import unproject
from rfea_vision.lines import along
from rfea_vision.vision.body.begin import POINTED_PX
from rfea_vision.vision.body.fit import ALONG, NORMAL, SYSTEMATIC, WIDTH, Fit
from rfea_vision.vision.body.model import ALONG_BASIS, NORMAL_BASIS, SHARES, TURNED, WIDTH_BASIS, SeenBody, middle
from rfea_vision.vision.curve import COEFFICIENTS, WIDTH_COEFFICIENTS, basis_matrix, fit_curve, turning, vertices_of
from rfea_vision.vision.derive.picture_errors import PROFILE_SHARE
from rfea_vision.vision.edges import fitted

LAGS = 0.25  # of the lengths that it has had: what is followed from frame to frame lags behind where the skin is smooth
FLOOR = 0.02  # of the half width: noise of a line and of an end that are seen at their best

_TO_LINE = np.linalg.pinv(basis_matrix(SHARES, COEFFICIENTS))
_TO_COEFFICIENTS = _TO_LINE @ NORMAL_BASIS
_WIDTH_OF = np.linalg.pinv(basis_matrix(SHARES, WIDTH_COEFFICIENTS))
_TO_WIDTH = _WIDTH_OF @ WIDTH_BASIS


def as_state(camera: FloatArray, body: SeenBody, work: fitted.Buffers) -> fitted.State:
    """The body as a curve with a width, both in mm."""
    points = unproject(camera, body.points)
    scale = np.linalg.norm(np.gradient(body.points, axis=0), axis=1) / np.maximum(
        np.linalg.norm(np.gradient(points, axis=0), axis=1), 1e-9
    )
    steps = along(points)
    width = _WIDTH_OF @ np.interp(SHARES, steps / steps[-1], body.half / scale)
    blank = np.ones((3, work.centre.shape[0]))
    return fitted.State(fit_curve(points), width, np.zeros((*blank.shape, 2)), blank, blank.copy(), np.zeros(2), np.zeros(4))


def end_variance(covariance: FloatArray, lags: float) -> float:
    """Of the end along the body, px^2, by the `covariance` (25, 25) of a fit and how far it may lag, px."""
    return float(ALONG_BASIS[-1] @ covariance[ALONG, ALONG] @ ALONG_BASIS[-1]) + lags**2


def fill_numbers(
    work: fitted.Buffers,
    state: fitted.State,
    fit: Fit,
    px_per_mm: float,
    scale: float,
    *,
    mistaken: float,
    lags: float,
    pointed: float,
    turned: float = 0.0,
    slipped: float = 0.0,
) -> None:
    """Fill `work` with what the track is derived from, and its covariance in mm^2.

    Parameters
    ----------
    px_per_mm, scale : of the picture that was fitted; and this over the film's own
    mistaken : px by which the first frame's half width differs from the one that was pointed at
    lags : px by which its end may lag behind, or have drifted
    pointed : px of the film, how well the clamp and the tip were pointed at
    turned : rad, how well it is known by how much what holds it has turned
    slipped : px^2, variance of the length of a body that was lost, and whose end was not seen since, beyond the last mark on it
    """
    numbers = work.numbers
    numbers.view(np.float64).fill(0.0)
    numbers["length"] = vertices_of(state.coefficients, state.width, work.centre, work.normal, work.half_width)
    numbers["bend"] = turning(work.normal)
    numbers["noise"] = numbers["used"] = 1.0
    mm2 = px_per_mm**-2
    floor = (FLOOR * (half := float(middle(fit.body.half)))) ** 2 * mm2
    # One edge elsewhere makes the body wider, or narrower, by as much as it moves the line. As a doubt, not as noise: to
    # noise the curves would be smoothed, and the clamp's place with them. Where both edges say that the line lies beside their
    # middle, or more of the body lies on one side of it, one of what was carried and them is wrong.
    aside = 0.5 * scale**2 * (pointed**2 - POINTED_PX**2)  # px^2, of the middle of two clicks
    wavers = float(np.hypot(SYSTEMATIC * half, fit.off))
    numbers["wavers"] = wavers / scale
    numbers["profile"] = float(np.sqrt(wavers**2 + mistaken**2 + aside)) / scale / PROFILE_SHARE
    k = COEFFICIENTS
    work.covariance[:] = 0.0
    seen = mm2 * max(scale, 1.0) ** 2  # a picture that was enlarged tells no more of an edge than the film's own pixels
    work.covariance[:k, :k] = _TO_COEFFICIENTS @ fit.covariance[NORMAL, NORMAL] @ _TO_COEFFICIENTS.T * seen
    work.covariance[k:, k:] = _TO_WIDTH @ fit.covariance[WIDTH, WIDTH] @ _TO_WIDTH.T * seen
    work.covariance[np.diag_indices(len(work.covariance))] += floor
    for strays in (fit.body.strays, turned * SHARES * fit.body.length):
        aside = _TO_LINE @ strays
        work.covariance[:k, :k] += np.outer(aside, aside) * mm2
    along = end_variance(fit.covariance, lags) + slipped + (TURNED * fit.body.untold) ** 2
    numbers["tip_variance"] = along * mm2 + floor + (pointed * scale) ** 2 * mm2
