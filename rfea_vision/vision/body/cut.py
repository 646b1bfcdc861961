"""A way through the middle of what GrabCut takes for the body, from its clamp to its tip."""

from __future__ import annotations

import cv2
import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import scaled
from rfea_vision.vision.body.begin import ALIKE, Pointed, smooth_way
from rfea_vision.vision.body.model import Picture
from rfea_vision.vision.body.ways import Ways

CUT_PX = 5.0  # half a body's width in the picture that is cut
SEEDS = 0.7, 1.2  # half widths beyond the clamp, chosen: the body is there, and at its tip,
SEED = 0.4  # within so many half widths,
BEHIND = 2.0  # and is not within so many behind the clamp,
FARTHEST = 1.3  # nor farther from that than so many of its lengths
WITHIN = 1.5  # scatters of one rubber's colour, chosen: what is so near to that of these places is taken for it at first
TURNS = 4  # of learning colours and cutting: after few nothing changes
LEAST_PIXELS = 10  # of the body, and of what it is not: GrabCut learns five colours of each
OUTSIDE = 4.0  # times as dear as the shallowest place of it: gaps are crossed where they are narrow


def through_cut_out(picture: Picture, pointed: Pointed) -> FloatArray | None:
    """Stations (S, 2) px in a picture (CIELAB) from clamp to tip, through the middle of what looks like these and unlike the rest.

    Rother, Kolmogorov and Blake, GrabCut, ACM Transactions on Graphics 23, 2004. None where the hints leave nothing to learn from.
    """
    less, hinted, allowed = max(int(pointed.half / CUT_PX), 1), pointed.line[[0, -1]], pointed.allowed
    size = np.array(picture.shape[1::-1]) // less
    small = cv2.resize(picture, size.tolist(), interpolation=cv2.INTER_AREA)
    (clamp, tip), half = scaled(hinted, 1.0 / less), pointed.half / less
    off = np.dstack(np.meshgrid(np.arange(size[0]), np.arange(size[1]))) - clamp
    away = np.linalg.norm(off, axis=2)
    nowhere = (away > FARTHEST * pointed.length / less) | ((away < BEHIND * half) & (off @ pointed.ahead < 0.0))
    if allowed is not None:
        nowhere |= cv2.resize(allowed.astype(np.uint8), size.tolist(), interpolation=cv2.INTER_NEAREST) == 0
    mask = np.where(nowhere, cv2.GC_BGD, cv2.GC_PR_BGD).astype(np.uint8)
    for place in [*(clamp + seed * half * pointed.ahead for seed in SEEDS), tip]:
        cv2.circle(mask, np.round(place).astype(int).tolist(), max(round(SEED * half), 1), (cv2.GC_FGD,), -1)
    own = mask == cv2.GC_FGD
    if min(own.sum(), (~own).sum()) < LEAST_PIXELS:
        return None
    apart = (small - np.median(small[own], axis=0)) / ALIKE
    mask[(mask == cv2.GC_PR_BGD) & (np.linalg.norm(apart, axis=2) < WITHIN)] = cv2.GC_PR_FGD
    cv2.setRNGSeed(0)
    cv2.grabCut(small, mask, (0, 0, 0, 0), np.zeros((1, 65)), np.zeros((1, 65)), TURNS, cv2.GC_INIT_WITH_MASK)
    depth = cv2.distanceTransform((mask & 1).astype(np.uint8), cv2.DIST_L2, 3)
    cost = np.where(depth > 0.0, half / np.clip(depth, 0.5, half), OUTSIDE * half / 0.5) ** 2
    first, last = (np.clip(np.round(place), 0, size - 1).astype(int)[::-1] for place in (clamp, tip))
    way = Ways(cost, [first]).to(last)
    return smooth_way(np.vstack([hinted[:1], scaled(way[:, ::-1].astype(np.float64), less), hinted[1:]]))
