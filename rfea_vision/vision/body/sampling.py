"""What the picture says along the body: evidence of rubber against wall, edges, ends, and what looks alike. Compiled.

Pictures are CIELAB, (h, w, 3) uint8; places are pixels of that picture. The evidence of a pixel is the logarithm of how
much likelier its colour is on the body than on the wall, clipped, so that no pixel decides alone. Where the wall at that
very pixel has been seen, it is the wall's own colour that counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfea_vision.vision.compiled import compiled, inlined

CLIP = 4.0  # of the evidence of one pixel
STOPS = 25.0  # evidence against a colour, at which it stops to count: what is of neither colour says little
SEEN = 3  # times that the wall must have been seen at a pixel
WALL_SCATTER = 5.0  # grey levels: noise and compression of a still wall
SHADOW = 12.0  # likewise, where it is darker than it was: the body throws shadows,
# of any depth: from 38 levels on none is less likely than another. That of a black muscle that swelled was 110 levels deep, in the
# wall's hue, and was taken for more of the muscle; a body of another hue or light is still told from it.
UMBRA = 5.0
LEAST_EVIDENCE = 0.35  # mean of the three pixels to either side of an edge
BLUR, DEEP = 2, 4  # samples, of a pixel: so far to either side a step is blurred, and so far what lies there is read
PLAIN = (1.0 / 36.0, 1.0 / 9.0, 1.0 / 9.0)  # 1 over the variances of L, a and b on a plain body: `LEAST_VARIANCE`
LEAST_CONTRAST = 4.0  # two standard deviations, squared
EDGE_PX = 0.4  # standard error of an edge of full contrast
RAYS = 7  # along the body through its end
RAY_REACH = 0.6  # of the half width: the outermost rays
GRAIN = 1.5  # grey levels, chosen: noise, which compression may leave where it was for many pictures, tells nothing
QUIET = 5.0  # grey levels: by less a look differs by noise, which may stay where it was, and shading
ALIKE = 15.0  # grey levels: what differs by more is another skin
IN_LIGHT, IN_SHADOW = 1.0 / WALL_SCATTER**2, 1.0 / SHADOW**2
LOG_IN_LIGHT, LOG_IN_SHADOW = 3.0 * math.log(WALL_SCATTER), 2.0 * math.log(WALL_SCATTER) + math.log(SHADOW)


class Behind(NamedTuple):
    """A picture (h, w, 3), the colour of the wall behind the body, how often that was seen (h, w), and how much of it shows through."""

    picture: NDArray[np.uint8]
    colour: NDArray[np.float32]
    times: NDArray[np.int32]
    relief: NDArray[np.float32]


@inlined
def read_colour(picture, x, y, out):
    """Bilinear colour at a place; False outside of the picture."""
    i, j = math.floor(y), math.floor(x)
    if i < 0 or j < 0 or i >= picture.shape[0] - 1 or j >= picture.shape[1] - 1:
        return False
    a, b = y - i, x - j
    for c in range(3):
        top = (1.0 - b) * picture[i, j, c] + b * picture[i, j + 1, c]
        low = (1.0 - b) * picture[i + 1, j, c] + b * picture[i + 1, j + 1, c]
        out[c] = (1.0 - a) * top + a * low
    return True


@inlined
def _spread_of(colours):
    """What the variances of a colour, (2, 3) with its mean, add to the evidence against it."""
    return 0.5 * (math.log(colours[1, 0]) + math.log(colours[1, 1]) + math.log(colours[1, 2]))


@inlined
def _unlike(colour, known, spread):
    """Evidence against a colour of known mean and variance (2, 3), `spread` being what the variances add."""
    for c in range(3):
        off = colour[c] - known[0, c]
        spread += 0.5 * off * off / known[1, c]
    return spread


@inlined
def _evidence(seen, x, y, inside, flank, outside, body, aside, behind, colour):
    """Evidence at a place that it is the body; `inside`, its `flank` and `outside` are means and variances (2, 3).

    `body`, `aside` and `behind` are what their variances add.
    """
    picture, wall, times, relief = seen
    if not read_colour(picture, x, y, colour):
        for c in range(3):
            colour[c] = outside[0, c]
        return -CLIP
    i, j = int(y + 0.5), int(x + 0.5)
    for c in range(3):
        off = colour[c] - relief[i, j, c] - inside[0, c]
        body += 0.5 * off * off / inside[1, c]
        off = colour[c] - relief[i, j, c] - flank[0, c]
        aside += 0.5 * off * off / flank[1, c]
    body = min(body, aside)
    if times[i, j] >= SEEN:
        off = colour[0] - wall[i, j, 0]
        if off < 0.0:
            behind = min(0.5 * off * off * IN_SHADOW, UMBRA) + LOG_IN_SHADOW
        else:
            behind = 0.5 * off * off * IN_LIGHT + LOG_IN_LIGHT
        for c in range(1, 3):
            off = colour[c] - wall[i, j, c]
            behind += 0.5 * off * off * IN_LIGHT
        if inside[0, 0] < wall[i, j, 0] < colour[0]:
            # Beside a dark body it was seen in its shadow; where that has gone, it is as light as what is around.
            off = colour[0] - outside[0, 0]
            lit = 0.5 * off * off * IN_SHADOW + LOG_IN_SHADOW
            for c in range(1, 3):
                off = colour[c] - outside[0, c]
                lit += 0.5 * off * off * IN_LIGHT
            behind = min(behind, lit)
    else:
        behind = _unlike(colour, outside, behind)
    # Something of neither colour (glare, tape, a hand) says little.
    return min(max(min(behind, STOPS) - min(body, STOPS), -CLIP), CLIP)


@inlined
def _halfway(colours, place, count):
    """Where (in samples) the step after the sample `place` is half way between the colours (count, 3) on either side of it.

    What is counted there as body or wall depends on how far both vary: bodies that are shaded more than the wall ended a pixel beyond
    themselves. Tabatabai and Mitchell, Edge location to subpixel values in digital imagery, 1984: an edge that is blurred alike to both
    sides lies where the sum of what is left of it does.
    """
    if place < DEEP or place + 1 + DEEP >= count:
        return place + 0.5
    contrast = steps = 0.0
    for c in range(3):
        inner = outer = between = 0.0
        for d in range(BLUR, DEEP + 1):
            inner += colours[place - d, c] / (DEEP + 1 - BLUR)
            outer += colours[place + 1 + d, c] / (DEEP + 1 - BLUR)
        for d in range(1 - BLUR, BLUR + 1):
            between += colours[place + d, c] - outer
        weight = PLAIN[c] * (inner - outer)
        contrast += weight * (inner - outer)
        steps += weight * between
    if contrast < LEAST_CONTRAST:
        return place + 0.5
    return place + 0.5 + min(max(steps / contrast - BLUR, -1.0), 1.0)


@inlined
def _best_step(evidence, count, expected, spread, colours):
    """Place (in samples) of the step from body to wall; its quality, negative where there is none."""
    best, place, total = -1e300, 0, 0.0
    for k in range(count - 1):
        total += evidence[k]
        off = (k + 0.5 - expected) / spread
        score = 2.0 * total - 0.5 * off * off
        if score > best:
            best, place = score, k
    inner = outer = 0.0
    ni = no = 0
    for d in range(3):
        if place - d >= 0:
            inner += evidence[place - d]
            ni += 1
        if place + 1 + d < count:
            outer -= evidence[place + 1 + d]
            no += 1
    quality = min(inner / max(ni, 1), outer / max(no, 1))
    at = _halfway(colours, place, count)
    if place == 0 or place >= count - 2:
        quality = -1.0
    return at, quality


@compiled
def measure_edges(seen, points, normals, half, inside, flanks, outside, reach):
    """Edges to both sides of every station: (S, 2, 2) how far beyond `half`, and its variance (infinite: none)."""
    colours, evidence, out = np.empty((256, 3)), np.empty(256), np.empty((points.shape[0], 2, 2))
    for s in range(points.shape[0]):
        body = _spread_of(inside[s])
        for side in range(2):
            sign, aside, behind = 1.0 if side == 0 else -1.0, _spread_of(flanks[s, side]), _spread_of(outside[s, side])
            first = max(half[s] - reach, 0.25 * half[s])
            count = min(int(half[s] + reach - first) + 1, 256)
            known = inside[s], flanks[s, side], outside[s, side]
            for k in range(count):
                d = sign * (first + k)
                x, y = points[s, 0] + d * normals[s, 0], points[s, 1] + d * normals[s, 1]
                evidence[k] = _evidence(seen, x, y, *known, body, aside, behind, colours[k])
            at, quality = _best_step(evidence, count, half[s] - first, 0.5 * reach, colours)
            out[s, side, 0] = first + at - half[s]
            out[s, side, 1] = np.inf
            if quality > LEAST_EVIDENCE:
                out[s, side, 1] = (EDGE_PX * (1.0 + 2.0 * math.exp(-quality))) ** 2
    return out


@compiled
def measure_end(seen, tip, tangent, half, inside, outside, beyond, reach):
    """Along rays through the end: (RAYS,) how far beyond `tip` the body ends, NaN where that is not seen.

    What is there is the wall, or of the colour `beyond` (2, 3) of what is fixed to it.
    """
    colours, evidence, out = np.empty((256, 3)), np.empty(256), np.empty(RAYS)
    first = -min(reach, 3.0 * half) - half
    count = min(int(2.0 * min(reach, 3.0 * half) + half) + 1, 256)
    body, behind, fixed = _spread_of(inside), _spread_of(outside), _spread_of(beyond)
    for r in range(RAYS):
        v = RAY_REACH * half * (2.0 * r / (RAYS - 1) - 1.0)
        for k in range(count):
            d = first + k
            x = tip[0] + d * tangent[0] - v * tangent[1]
            y = tip[1] + d * tangent[1] + v * tangent[0]
            evidence[k] = _evidence(seen, x, y, inside, inside, outside, body, body, behind, colours[k])
            thing = min(_unlike(colours[k], beyond, fixed), STOPS) - min(_unlike(colours[k], inside, body), STOPS)
            evidence[k] = min(evidence[k], max(thing, -CLIP))
        at, quality = _best_step(evidence, count, -first, 0.5 * min(reach, 3.0 * half), colours)
        out[r] = first + at if quality > LEAST_EVIDENCE else np.nan
    return out


@compiled
def support(seen, points, normals, half, inside, outside, least):
    """Share (S,) of the body's inside that looks like it rather than like the wall: by `least` of evidence."""
    colour, out = np.empty(3), np.empty(points.shape[0])
    for s in range(points.shape[0]):
        good, body = 0.0, _spread_of(inside[s])
        behind = _spread_of(outside[s, 0]), _spread_of(outside[s, 1])
        for k in range(7):
            d = half[s] * (k - 3) * 0.22
            x, y = points[s, 0] + d * normals[s, 0], points[s, 1] + d * normals[s, 1]
            side = 0 if k >= 3 else 1
            good += _evidence(seen, x, y, inside[s], inside[s], outside[s, side], body, body, behind[side], colour) > least
        out[s] = good / 7.0
    return out


@compiled
def read_strip(picture, points, normals, half, across):
    """Colours (S, V, 3) at `across` (V,) half widths."""
    colour, out = np.zeros(3), np.empty((points.shape[0], across.shape[0], 3))
    for s in range(points.shape[0]):
        for v in range(across.shape[0]):
            d = across[v] * half[s]
            read_colour(picture, points[s, 0] + d * normals[s, 0], points[s, 1] + d * normals[s, 1], colour)
            for c in range(3):
                out[s, v, c] = colour[c]
    return out


@compiled
def unlikeness(strip, look):
    """How little like a `look` (n, v, 3) each place (N - n + 1, V - v + 1) of a strip (N, V, 3) is: grey levels.

    Without a change of light.
    """
    out = np.empty((strip.shape[0] - look.shape[0] + 1, strip.shape[1] - look.shape[1] + 1))
    count = look.shape[0] * look.shape[1]
    for d in range(out.shape[0]):
        for a in range(out.shape[1]):
            total = 0.0
            for c in range(3):
                light = 0.0
                for _ in range(3):  # what differs by more than `ALIKE` is something else, and tells little of the light
                    more = 0.0
                    for i in range(look.shape[0]):
                        for j in range(look.shape[1]):
                            off = strip[d + i, a + j, c] - look[i, j, c] - light
                            more += min(max(off, -ALIKE), ALIKE)
                    light += more / count
                for i in range(look.shape[0]):
                    for j in range(look.shape[1]):
                        total += min(max(abs(strip[d + i, a + j, c] - look[i, j, c] - light) - QUIET, 0.0), ALIKE)
            out[d, a] = total / (3.0 * count)
    return out


@compiled
def learn_wall(picture, mask, wall, times, top, bottom, left, right):
    """Average the wall in a window wherever the body is not (`mask` is 0); slowly once it is known, so that light may change."""
    for i in range(top, bottom):
        for j in range(left, right):
            if mask[i, j] == 0:
                n = times[i, j] + 1
                gain = max(1.0 / n, 0.05)
                for c in range(3):
                    wall[i, j, c] += gain * (picture[i, j, c] - wall[i, j, c])
                times[i, j] = min(n, 1000)


@inlined
def _least_unlike(colour, known, spreads, weights):
    """The least evidence against a colour by known ones (n, 2, 3), from what their variances add (n,) and weigh (n, 3)."""
    least = np.inf
    for k in range(known.shape[0]):
        unlike = spreads[k]
        for c in range(3):
            off = colour[c] - known[k, 0, c]
            unlike += off * off * weights[k, c]
        least = min(least, unlike)
    return least


@compiled
def look_alike(picture, wall, times, inside, outside, asked, out):
    """Write to `out` (h, w) whether pixels that are `asked` for look like one of the colours `inside` (n, 2, 3), mean and variance.

    Rather than like one of the colours `outside` (m, 2, 3), or the wall where that was seen; 0 for the others.
    """
    colour = np.empty(3)
    own, others = np.empty(inside.shape[0]), np.empty(outside.shape[0])
    for k in range(own.shape[0]):
        own[k] = _spread_of(inside[k])
    for k in range(others.shape[0]):
        others[k] = _spread_of(outside[k])
    own_weights, other_weights = 0.5 / inside[:, 1], 0.5 / outside[:, 1]
    for i in range(picture.shape[0]):
        for j in range(picture.shape[1]):
            out[i, j] = 0
            if not asked[i, j]:
                continue
            for c in range(3):
                colour[c] = picture[i, j, c]
            if times[i, j] >= SEEN:
                behind = LOG_IN_LIGHT
                for c in range(3):
                    off = colour[c] - wall[i, j, c]
                    behind += 0.5 * off * off * IN_LIGHT
            else:
                behind = _least_unlike(colour, outside, others, other_weights)
            out[i, j] = _least_unlike(colour, inside, own, own_weights) < behind
