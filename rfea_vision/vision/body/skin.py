"""The skin: what lies on a body, by which it is known where its material has gone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.vision.body.model import ACROSS_TEXTURE, Picture, SeenBody, skin_of
from rfea_vision.vision.body.sampling import ALIKE, read_colour
from rfea_vision.vision.compiled import compiled, inlined

SCATTER = 5.0  # grey levels: how skin differs from the first frame's
GAIN = 0.05  # of the skin's variance, from frame to frame
NOISE_SLOPE = 1.5  # grey levels per pixel
WITHIN = 0.8  # half widths: what lies farther out changes with the outline, which looks the same all along the body
INDEPENDENT = 0.2  # share of the skin's pixels that are independent in a compressed picture


@dataclass
class Skin:
    """Colours (S, V, 3) of the first frame, by how much a pixel across the body and along changes them (S, V, 2, 3), and variance."""

    colours: FloatArray
    slopes: FloatArray
    variance: FloatArray

    @classmethod
    def of(cls, picture: Picture, body: SeenBody) -> Skin:
        """That of a body in a picture."""
        colours = skin_of(picture, body)
        slopes = _read_slopes(picture, body.points, body.normals, body.half, ACROSS_TEXTURE)
        return cls(colours, slopes, np.full_like(colours, SCATTER**2))

    def follow(self, seen: FloatArray) -> None:
        """Let what is seen to change (S, V, 3), but for the light on all of a station, count less."""
        off = seen - self.colours
        off -= off.mean(axis=1, keepdims=True)
        self.variance += GAIN * (np.maximum(off**2, SCATTER**2) - self.variance)

    def matched(self, picture: Picture, body: SeenBody, slips: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """How it lies beside its place: information (S, 6) px^-2, pull (S, 3) px^-1, and the share of pixels that agree (S,).

        One Gauss-Newton step on the robust difference: across (n) and along (t) the body, and in its half width (w); the information
        is nn, nt, tt, nw, tw, ww. Light that changes on a station, all over or from one side to the other, tells nothing: a round
        body that turns in it is shaded anew.
        What differs by more than noise and a slip of `slips` (S,) px along the body can make is another skin.
        """
        place = body.points, body.normals, body.half, ACROSS_TEXTURE
        return _match(picture, *place, self.colours, self.slopes, self.variance, slips)


@compiled
def _read_slopes(picture, points, normals, half, across):
    """By how much colours change per pixel at `across` (V,) half widths: (S, V, 2, 3), across the body and along it."""
    ahead, behind, out = np.zeros(3), np.zeros(3), np.empty((points.shape[0], across.shape[0], 2, 3))
    for s in range(points.shape[0]):
        nx, ny = normals[s, 0], normals[s, 1]
        for v in range(across.shape[0]):
            x, y = points[s, 0] + across[v] * half[s] * nx, points[s, 1] + across[v] * half[s] * ny
            for k in range(2):
                dx, dy = (nx, ny) if k == 0 else (ny, -nx)
                seen = read_colour(picture, x + dx, y + dy, ahead) and read_colour(picture, x - dx, y - dy, behind)
                for c in range(3):
                    out[s, v, k, c] = 0.5 * (ahead[c] - behind[c]) if seen else 0.0
    return out


@inlined
def _in_any_light(values, tilted):
    """Take from values (V,), in place, what light may have added: to all alike, and in proportion to `tilted` (V,), of length one."""
    mean = tilt = 0.0
    for v in range(values.shape[0]):
        mean += values[v] / values.shape[0]
        tilt += values[v] * tilted[v]
    for v in range(values.shape[0]):
        values[v] -= mean + tilt * tilted[v]


@compiled
def _match(picture, points, normals, half, across, skin, slopes, variance, slips):
    """See `Skin.matched`; `across` (V,) half widths have their mean at 0."""
    count, width = skin.shape[:2]
    information, pull, alike = np.zeros((count, 6)), np.zeros((count, 3)), np.zeros(count)
    here, ahead, behind = np.empty((width, 3)), np.empty(3), np.empty(3)
    slope, off, rows = np.empty((width, 3, 2)), np.empty(width), np.empty((3, width))
    tilted = across / math.sqrt((across**2).sum())
    for s in range(count):
        nx, ny = normals[s, 0], normals[s, 1]
        whole = True
        for v in range(width):
            x, y = points[s, 0] + across[v] * half[s] * nx, points[s, 1] + across[v] * half[s] * ny
            whole = whole and read_colour(picture, x, y, here[v])
            for k in range(2):  # along the normal, then along the tangent (ny, -nx)
                dx, dy = (nx, ny) if k == 0 else (ny, -nx)
                whole = whole and read_colour(picture, x + dx, y + dy, ahead) and read_colour(picture, x - dx, y - dy, behind)
                for c in range(3):
                    steep, before = 0.5 * (ahead[c] - behind[c]), slopes[s, v, k, c]
                    # Noise has slopes, too, and glare, and they would hold the body where it is: what both pictures show counts.
                    shown = min(abs(steep), abs(before)) - NOISE_SLOPE if steep * before > 0.0 else 0.0
                    slope[v, c, k] = math.copysign(max(shown, 0.0), steep)
        if not whole:
            continue
        for c in range(3):
            for v in range(width):
                off[v] = here[v, c] - skin[s, v, c]
                rows[0, v], rows[2, v] = slope[v, c, 0], across[v] * slope[v, c, 0]
                rows[1, v] = slope[v, c, 1] * (abs(across[v]) < WITHIN)
            _in_any_light(off, tilted)
            for i in range(3):
                _in_any_light(rows[i], tilted)
            for v in range(width):
                alike[s] += (abs(off[v]) < ALIKE) / (3.0 * width)
                share = off[v] * off[v] / (9.0 * (variance[s, v, c] + (slips[s] * slope[v, c, 1]) ** 2))
                if share >= 1.0:
                    continue
                weight = INDEPENDENT * (1.0 - share) ** 2 / variance[s, v, c]
                for i in range(3):
                    pull[s, i] -= weight * rows[i, v] * off[v]
                    for j in range(i + 1):
                        information[s, i * (i + 1) // 2 + j] += weight * rows[i, v] * rows[j, v]
    return information, pull, alike
