"""A film made of one real photograph: its body is cut out along its centre line and bent on, before its own wall."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from scipy.spatial import cKDTree

BEYOND = 1.12  # half widths: what of the picture beside the body moves with it, faded out


def rebent_film(
    path: Path, picture: np.ndarray, line: np.ndarray, half: np.ndarray, shares: np.ndarray, *, noise: float = 2.0
) -> np.ndarray:
    """Write H.264 at crf 28; returns the centre lines (t, n, 2) px.

    Parameters
    ----------
    picture : (h, w, 3) BGR
    line : (n, 2) px from clamp to tip, evenly spaced; `half` (n,) px, half the body's width there
    shares : (t,) of the photograph's bend, frame by frame
    """
    rng = np.random.default_rng(0)
    step = np.linalg.norm(np.diff(line, axis=0), axis=1).mean()
    heading = np.unwrap(np.arctan2(*np.diff(line, axis=0).T[::-1]))
    body = np.zeros(picture.shape[:2], dtype=np.uint8)
    for place, radius in zip(line, half, strict=True):
        cv2.circle(body, tuple(np.round(place).astype(int)), round(1.25 * radius), 255, -1)
    wall = cv2.inpaint(picture, body, 5, cv2.INPAINT_TELEA)
    height, width = picture.shape[:2]
    pixels = np.column_stack([axis.ravel() for axis in np.meshgrid(np.arange(width), np.arange(height))]).astype(float)
    lines = []
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"crf": "28", "preset": "fast", "threads": "1"}
        for number, share in enumerate(shares):
            bent = heading[0] + share * (heading - heading[0])
            steps = step * np.column_stack([np.cos(bent), np.sin(bent)])
            now = line[0] + np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
            lines.append(now)
            frame = _moved(picture, wall, pixels, (line, _tangents(line)), (now, _tangents(now)), half)
            frame = np.clip(frame + rng.normal(0, noise, frame.shape), 0, 255).astype(np.uint8)
            image = av.VideoFrame.from_ndarray(frame[:, :, ::-1].copy(), format="rgb24")
            image.pts, image.time_base = number, Fraction(1, 30)
            for packet in stream.encode(image):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return np.array(lines)


def _tangents(line: np.ndarray) -> np.ndarray:
    tangent = np.gradient(line, axis=0)
    return tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


def _moved(picture, wall, pixels, then, now, half) -> np.ndarray:
    """The wall, and before it the body as it would look along another line."""
    reach = BEYOND * half.max()
    away, nearest = cKDTree(now[0]).query(pixels, distance_upper_bound=reach)
    near = np.isfinite(away)
    places, nearest = pixels[near], nearest[near]
    offset = places - now[0][nearest]
    tangent = now[1][nearest]
    along = np.sum(offset * tangent, axis=1)
    across = offset[:, 1] * tangent[:, 0] - offset[:, 0] * tangent[:, 1]
    old = then[1][nearest]
    source = then[0][nearest] + along[:, None] * old + across[:, None] * np.column_stack([-old[:, 1], old[:, 0]])
    colour = cv2.remap(picture, *source.astype(np.float32).T[:, :, None], cv2.INTER_LINEAR)[:, 0].astype(float)
    inside = np.clip((BEYOND * half[nearest] - np.abs(across)) / (0.1 * half[nearest]), 0.0, 1.0)
    first, last = (nearest == 0) & (along < 0), (nearest == len(half) - 1) & (along > 0.1 * half[-1])
    inside[first | last] = 0.0
    out = wall.astype(float)
    rows, columns = places[:, 1].astype(int), places[:, 0].astype(int)
    out[rows, columns] += inside[:, None] * (colour - out[rows, columns])
    return out
