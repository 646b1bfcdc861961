"""A way through the middle of what GrabCut takes for the body, from its clamp to its tip."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.lines import scaled
from rfea_vision.vision.body.begin import ALIKE, Pointed, like_colour, smooth_way
from rfea_vision.vision.body.model import Picture
from rfea_vision.vision.body.ways import Ways

CUT_PX = 5.0  # half a body's width in the picture that is cut
SEEDS = 0.7, 1.2  # half widths beyond the clamp, chosen: the body is there, and at its tip,
SEED = 0.4  # within so many half widths,
BEHIND = 2.0  # and is not within so many behind the clamp,
FARTHEST = 1.3  # nor where a line from clamp to tip would be longer than so many of its lengths,
BESIDE = 4.0  # and so many half widths: from a line to the body's edge, a half width beyond that, and back
LIKE = 0.5  # the colour that a person named, of 1, chosen: so much is what is body at least
WITHIN = 1.5  # scatters of one rubber's colour, chosen: what is so near to that of these places is taken for it at first
TURNS = 4  # of learning colours and cutting: after few nothing changes
LEAST_PIXELS = 10  # of the body, and of what it is not: GrabCut learns five colours of each
COLOURS, CHANNELS = 5, 3  # as a model of GrabCut has them: their shares, means, and covariances
ANY, ANY_SHARE = 100.0, 0.01  # grey levels that a colour scatters by which may be any, and the share of pixels that have such a one
OUTSIDE = 4.0  # times as dear as the shallowest place of it: gaps are crossed where they are narrow


def through_cut_out(picture: Picture, pointed: Pointed) -> FloatArray | None:
    """Stations (S, 2) px in a picture (CIELAB) from clamp to tip, through the middle of what looks like these and unlike the rest.

    Rother, Kolmogorov and Blake, GrabCut, ACM Transactions on Graphics 23, 2004. None where the hints leave nothing to learn from.
    """
    less, hinted, allowed = max(int(pointed.half / CUT_PX), 1), pointed.line[[0, -1]], pointed.allowed
    size = np.array(picture.shape[1::-1]) // less
    small = np.asarray(cv2.resize(picture, size.tolist(), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    (clamp, tip), half = scaled(hinted, 1.0 / less), pointed.half / less
    off = np.dstack(np.meshgrid(np.arange(size[0]), np.arange(size[1]))) - clamp
    away, (ahead, chord) = np.linalg.norm(off, axis=2), (pointed.ahead, tip - clamp)
    longest = FARTHEST * max(pointed.length / less, float(np.linalg.norm(chord))) + BESIDE * half
    nowhere = (away + np.linalg.norm(off - chord, axis=2) > longest) | ((away < BEHIND * half) & (off @ ahead < 0.0))
    if allowed is not None:
        nowhere |= cv2.resize(allowed.astype(np.uint8), size.tolist(), interpolation=cv2.INTER_NEAREST) == 0
    if pointed.colour is not None:
        nowhere |= like_colour(small, pointed.colour) < LIKE
    mask = np.where(nowhere, cv2.GC_BGD, cv2.GC_PR_BGD).astype(np.uint8)
    for place in [*(clamp + seed * half * pointed.ahead for seed in SEEDS), tip]:
        cv2.circle(mask, np.round(place).astype(int).tolist(), max(round(SEED * half), 1), (cv2.GC_FGD,), -1)
    own = mask == cv2.GC_FGD
    if min(own.sum(), (~own).sum()) < LEAST_PIXELS:
        return None
    apart = (small - np.median(small[own], axis=0)) / ALIKE
    mask[(mask == cv2.GC_PR_BGD) & (np.linalg.norm(apart, axis=2) < WITHIN)] = cv2.GC_PR_FGD
    for _ in range(TURNS):
        if np.bincount(mask.ravel() & 1, minlength=2).min() < LEAST_PIXELS or not _cut_out(small, mask):
            break
    depth = cv2.distanceTransform((mask & 1).astype(np.uint8), cv2.DIST_L2, 3)
    cost = np.where(depth > 0.0, half / np.clip(depth, 0.5, half), OUTSIDE * half / 0.5) ** 2
    first, last = (np.clip(np.round(place), 0, size - 1).astype(int)[::-1] for place in (clamp, tip))
    way = Ways(cost, [first]).to(last)
    return smooth_way(np.vstack([hinted[:1], scaled(way[:, ::-1].astype(np.float64), less), hinted[1:]]))


def _cut_out(picture: Picture, mask: NDArray[np.uint8]) -> bool:
    """Learn both colours from a mask (h, w) of GrabCut's, and cut the picture (h, w, 3) by them; whether that changes the mask.

    It is cut where the body may be: the wall's colours are learnt from everywhere.
    """
    models = np.zeros((2, 1, COLOURS * (1 + CHANNELS + CHANNELS**2)))
    cv2.setRNGSeed(0)
    cv2.grabCut(picture, mask, (0, 0, 0, 0), models[0], models[1], 0, cv2.GC_INIT_WITH_MASK)
    for model in models:
        _let_any_be(model[0])
    x, y, width, height = cv2.boundingRect(mask)  # GC_BGD is 0
    part = slice(max(y - 1, 0), y + height + 1), slice(max(x - 1, 0), x + width + 1)
    cut = mask[part].copy()
    cv2.grabCut(picture[part].copy(), cut, (0, 0, 0, 0), models[0], models[1], 1, cv2.GC_EVAL_FREEZE_MODEL)
    changed = not np.array_equal(cut, mask[part])
    mask[part] = cut
    return changed


def _let_any_be(model: FloatArray) -> None:
    """Make the rarest of a model's colours any colour, in place.

    A pixel of one that neither model has seen would be infinitely unlike both: grey pictures, of which the others leave no room
    beside their own greys, were cut anywhere, and for seconds.
    """
    shares, means, covariances = np.split(model, [COLOURS, COLOURS * (1 + CHANNELS)])
    rarest = int(np.argmin(shares))
    shares[rarest] = max(shares[rarest], ANY_SHARE)
    shares /= shares.sum()
    means.reshape(COLOURS, CHANNELS)[rarest] = shares @ means.reshape(COLOURS, CHANNELS)
    covariances.reshape(COLOURS, CHANNELS, CHANNELS)[rarest] = ANY**2 * np.eye(CHANNELS)
