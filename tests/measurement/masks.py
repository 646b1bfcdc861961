"""Masks of a body in a single picture, by colour or by light, and the centre line of a clamped one."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.body.midline import Midline, Refusal, midline_from_mask

NEAR_BACKGROUND = 25.0  # of Lab's 256 steps: what still is background
FAR_FROM_BACKGROUND = 3.5  # standard deviations


def mask_by_colour(picture_bgr: NDArray[np.uint8], *, smooth_px: float = 1.5) -> NDArray[np.bool_]:
    """Pixels whose colour differs from the background's, whatever their brightness.

    The background is the commonest colour; distances in CIELAB's a and b count in units of the background's scatter,
    which is wide where a coloured cloth is lit unevenly.
    """
    lab = cv2.cvtColor(cv2.GaussianBlur(picture_bgr, (0, 0), smooth_px), cv2.COLOR_BGR2LAB).astype(np.int32)
    counts = np.bincount(lab[..., 1].ravel() * 256 + lab[..., 2].ravel(), minlength=65536).reshape(256, 256)
    smooth = cv2.GaussianBlur(counts.astype(np.float32), (0, 0), 3)
    a, b = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    offset = np.stack([lab[..., 1] - int(a), lab[..., 2] - int(b)], axis=-1).astype(float)
    near = offset[np.hypot(offset[..., 0], offset[..., 1]) < NEAR_BACKGROUND]
    middle = np.median(near, axis=0)
    inverse = np.linalg.inv(np.cov((near - middle).T) + np.eye(2))
    offset -= middle
    distance = np.sqrt(np.einsum("...i,ij,...j->...", offset, inverse, offset))
    return distance > FAR_FROM_BACKGROUND


def mask_by_light(
    picture: NDArray[np.uint8], *, lighter: bool = True, smooth_px: float = 1.0, share: float = 1.0
) -> NDArray[np.bool_]:
    """Pixels lighter (or darker) than Otsu's threshold, which `share` scales from the dark side."""
    soft = cv2.GaussianBlur(picture, (0, 0), smooth_px)
    level, _ = cv2.threshold(soft, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return soft > share * level if lighter else soft <= share * level


def clamped_midline(
    mask: NDArray[np.bool_], clamp_px: Sequence[Sequence[float]], tip_px: Sequence[float], *, nodes: int = 50
) -> Midline | Refusal:
    """Centre line from clamp to tip of the body that leaves the clamp towards the tip.

    Parameters
    ----------
    mask : (h, w)
    clamp_px : two points across the first visible cross-section
    tip_px : a point on the body near its tip; it tells which side of the clamp the body is on
    nodes : number of points
    """
    clamp = np.asarray(clamp_px, dtype=float).reshape(2, 2)
    tip = np.asarray(tip_px, dtype=float)
    cut = np.array(mask, dtype=np.uint8)
    across = clamp[1] - clamp[0]
    width = float(np.linalg.norm(across))
    # A cut a little wider than the tube separates it from its clamp.
    ends = (clamp[0] - 0.6 * across, clamp[1] + 0.6 * across)
    cv2.line(cut, *(tuple(int(v) for v in np.round(end)) for end in ends), 0, max(round(0.08 * width), 3), cv2.LINE_4)  # pyright: ignore[reportCallIssue, reportArgumentType]
    _, labels = cv2.connectedComponents(cut, connectivity=4)
    x, y = round(tip[0]), round(tip[1])
    near = labels[max(y - 3, 0) : y + 4, max(x - 3, 0) : x + 4]
    named = near[near > 0]
    if named.size == 0:
        return Refusal("no_body: the tip that was given is not on the body")
    found = midline_from_mask(labels == np.bincount(named).argmax(), nodes=nodes)
    if isinstance(found, Refusal):
        return found
    middle = clamp.mean(axis=0)
    if np.linalg.norm(found.points[-1] - middle) < np.linalg.norm(found.points[0] - middle):
        found = Midline(found.points[::-1].copy(), found.width[::-1].copy())
    if np.linalg.norm(found.points[0] - middle) > 2 * width:
        return Refusal("no_clamp: the body at the tip does not reach the clamp")
    return found


def tip_angle_deg(midline: Midline, *, reference: Sequence[float] | None = None, share: float = 0.12) -> float:
    """Angle in deg between the last `share` of the centre line and `reference` (px; by default its first `share`)."""
    n = max(round(share * len(midline.points)), 3)

    def heading(points: FloatArray) -> FloatArray:
        _, _, vectors = np.linalg.svd(points - points.mean(axis=0))
        axis = vectors[0]
        return axis if axis @ (points[-1] - points[0]) > 0 else -axis

    first = heading(midline.points[:n]) if reference is None else np.asarray(reference, dtype=float)
    cosine = first @ heading(midline.points[-n:]) / np.linalg.norm(first)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
