"""From joint angles to the centre line that the camera sees.

Joints in the middle of their arc: each joint's angle is spread evenly over the arc, so the tube is a chain of circular
arcs. Joints at the start of the body (the paper's): the hinge line is eq. KinematicsClosedForm's polygon, and the centre
line turns about each hinge at the distance r_o and then runs straight. Either way its length is L + r_o times the bending.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def _sinc(half: float) -> tuple[float, float]:
    """Return sin(x) / x and its derivative."""
    if abs(half) < 1e-4:
        return 1.0 - half * half / 6.0, -half / 3.0
    s = np.sin(half) / half
    return s, (np.cos(half) - s) / half


@njit(cache=True, nogil=True, error_model="numpy")
def centre_line(phi, S, segment_length, outer_radius, polygon, pivot, dpivot, fractions, nodes, dnodes):
    """Points on the centre line at fractions of its length, with their sensitivities.

    phi (frames, n + 1) absolute angles, index 0 the clamp; S (frames, n + 1, p); fractions (m,) sorted, 0 clamp to 1 tip;
    pivot : how far outside the hinge line a clamp turns (m), dpivot (p,) its sensitivities;
    writes nodes (frames, m, 2) in m and dnodes (frames, m, 2, p).
    """
    frames, n = phi.shape[0], phi.shape[1] - 1
    p = S.shape[2]
    dH = np.zeros((2, p))
    dxi = np.zeros(p)
    for frame in range(frames):
        first = phi[frame, 0]
        total = n * segment_length + outer_radius * (phi[frame, n] - first)
        # The hinge line starts beside the point about which the clamp turns, which lies on the x axis.
        s, c = np.sin(first), np.cos(first)
        hx, hy = pivot * (1 - c) - outer_radius, pivot * s
        for q in range(p):
            dH[0, q] = dpivot[q] * (1 - c) + pivot * s * S[frame, 0, q]
            dH[1, q] = dpivot[q] * s + pivot * c * S[frame, 0, q]
        passed = 0.0
        node = 0
        for k in range(1, n + 1):
            a, b = phi[frame, k - 1], phi[frame, k]
            theta = b - a
            reach = segment_length + outer_radius * theta
            while node < fractions.size and (fractions[node] * total <= passed + reach or k == n):
                local = fractions[node] * total - passed
                for q in range(p):
                    d_local = fractions[node] * outer_radius * (S[frame, n, q] - S[frame, 0, q]) - outer_radius * (
                        S[frame, k - 1, q] - S[frame, 0, q]
                    )
                    dxi[q] = d_local
                if polygon:
                    turn = outer_radius * theta
                    if turn > 0 and local < turn:
                        angle, along = a + local / outer_radius, 0.0
                        for q in range(p):
                            nodes_d = dxi[q] / outer_radius + S[frame, k - 1, q]
                            dnodes[frame, node, 0, q] = dH[0, q] - outer_radius * np.sin(angle) * nodes_d
                            dnodes[frame, node, 1, q] = dH[1, q] - outer_radius * np.cos(angle) * nodes_d
                        nodes[frame, node, 0] = hx + outer_radius * np.cos(angle)
                        nodes[frame, node, 1] = hy - outer_radius * np.sin(angle)
                    else:
                        along = local - turn
                        s, c = np.sin(b), np.cos(b)
                        nodes[frame, node, 0] = hx - along * s + outer_radius * c
                        nodes[frame, node, 1] = hy - along * c - outer_radius * s
                        for q in range(p):
                            d_along = dxi[q] - outer_radius * (S[frame, k, q] - S[frame, k - 1, q])
                            db = S[frame, k, q]
                            dnodes[frame, node, 0, q] = dH[0, q] - d_along * s + db * (-along * c - outer_radius * s)
                            dnodes[frame, node, 1, q] = dH[1, q] - d_along * c + db * (along * s - outer_radius * c)
                else:
                    xi = local / reach
                    half = 0.5 * xi * theta
                    value, slope = _sinc(half)
                    middle, end = a + half, a + xi * theta
                    chord = segment_length * xi * value
                    ux, uy = -np.sin(middle), -np.cos(middle)
                    ex, ey = np.cos(end), -np.sin(end)
                    nodes[frame, node, 0] = hx + chord * ux + outer_radius * ex
                    nodes[frame, node, 1] = hy + chord * uy + outer_radius * ey
                    for q in range(p):
                        d_theta = S[frame, k, q] - S[frame, k - 1, q]
                        d_xi = (dxi[q] - xi * outer_radius * d_theta) / reach
                        d_half = 0.5 * (d_xi * theta + xi * d_theta)
                        d_middle = S[frame, k - 1, q] + d_half
                        d_end = S[frame, k - 1, q] + 2 * d_half
                        d_chord = segment_length * (d_xi * value + xi * slope * d_half)
                        dnodes[frame, node, 0, q] = (
                            dH[0, q] + d_chord * ux + chord * uy * d_middle + outer_radius * ey * d_end
                        )
                        dnodes[frame, node, 1, q] = (
                            dH[1, q] + d_chord * uy - chord * ux * d_middle - outer_radius * ex * d_end
                        )
                node += 1
            # Carry the hinge line to the end of this segment.
            if polygon:
                ux, uy = -np.sin(b), -np.cos(b)
                hx += segment_length * ux
                hy += segment_length * uy
                for q in range(p):
                    dH[0, q] += segment_length * uy * S[frame, k, q]
                    dH[1, q] -= segment_length * ux * S[frame, k, q]
            else:
                value, slope = _sinc(0.5 * theta)
                middle = 0.5 * (a + b)
                ux, uy = -np.sin(middle), -np.cos(middle)
                chord = segment_length * value
                hx += chord * ux
                hy += chord * uy
                for q in range(p):
                    d_middle = 0.5 * (S[frame, k - 1, q] + S[frame, k, q])
                    d_chord = segment_length * slope * 0.5 * (S[frame, k, q] - S[frame, k - 1, q])
                    dH[0, q] += d_chord * ux + chord * uy * d_middle
                    dH[1, q] += d_chord * uy - chord * ux * d_middle
            passed += reach
