"""From joint angles to the centre line that the camera sees.

Joints in the middle of their arc: each joint's angle is spread evenly over the arc, so the tube is a chain of circular
arcs. Joints at the start of the body (the paper's): the hinge line is eq. KinematicsClosedForm's polygon, and the centre
line turns about each hinge at the distance r_o and then runs straight. Either way its length is L + r_o times the bending.

A point is a complex number x + i y: the direction down the tube at the angle phi is -i exp(-i phi), the one outward exp(-i phi).
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def _place(local, theta, length, radius, polygon):
    """Where a centre line is after `local` of its way over a body that turns by theta.

    Returns three rows: how far along the hinge line (m), the direction of that, and the direction outward, both against the
    body before (rad); each with its derivatives by `local` and by theta.
    """
    if polygon:
        turn = radius * theta
        if turn > 0 and local < turn:
            turned = (local / radius, 1.0 / radius, 0.0)
            return (0.0, 0.0, 0.0), turned, turned
        return (local - turn, 1.0, -radius), (theta, 0.0, 1.0), (theta, 0.0, 1.0)
    reach = length + radius * theta
    share = local / reach
    by_local, by_theta = 1.0 / reach, -share * radius / reach
    half, half_local, half_theta = 0.5 * share * theta, 0.5 * by_local * theta, 0.5 * (share + by_theta * theta)
    sinc, slope = 1.0 - half * half / 6.0, -half / 3.0
    if abs(half) > 1e-4:
        sinc = np.sin(half) / half
        slope = (np.cos(half) - sinc) / half
    chord = (
        length * share * sinc,
        length * (by_local * sinc + share * slope * half_local),
        length * (by_theta * sinc + share * slope * half_theta),
    )
    return chord, (half, half_local, half_theta), (2 * half, 2 * half_local, 2 * half_theta)


@njit(cache=True, nogil=True, error_model="numpy")
def centre_line(phi, S, segment_length, outer_radius, polygon, pivot, dpivot, fractions, nodes, dnodes):
    """Points on the centre line at fractions of its length, with their sensitivities.

    phi (frames, n + 1) absolute angles, index 0 the clamp; S (frames, n + 1, p); fractions (m,) sorted, 0 clamp to 1 tip;
    pivot : how far outside the hinge line a clamp turns (m), dpivot (p,) its sensitivities;
    writes nodes (frames, m, 2) in m and dnodes (frames, m, 2, p).
    """
    n, p = phi.shape[1] - 1, S.shape[2]
    by_par = np.zeros(p, dtype=np.complex128)
    for frame in range(phi.shape[0]):
        first, at = phi[frame, 0], S[frame]
        total = n * segment_length + outer_radius * (phi[frame, n] - first)
        # The hinge line starts beside the point about which the clamp turns, which lies on the x axis.
        out = np.exp(-1j * first)
        hinge = pivot * (1 - out) - outer_radius
        for q in range(p):
            by_par[q] = dpivot[q] * (1 - out) + 1j * pivot * out * at[0, q]
        passed, node = 0.0, 0
        for k in range(1, n + 1):
            before, theta = phi[frame, k - 1], phi[frame, k] - phi[frame, k - 1]
            reach = segment_length + outer_radius * theta
            while node < fractions.size and (fractions[node] * total <= passed + reach or k == n):
                local = fractions[node] * total - passed
                chord, middle, end = _place(local, theta, segment_length, outer_radius, polygon)
                down, out = -1j * np.exp(-1j * (before + middle[0])), outer_radius * np.exp(-1j * (before + end[0]))
                point = hinge + chord[0] * down + out
                nodes[frame, node, 0], nodes[frame, node, 1] = point.real, point.imag
                for q in range(p):
                    d_theta, d_total = at[k, q] - at[k - 1, q], at[n, q] - at[0, q]
                    d_local = outer_radius * (fractions[node] * d_total - (at[k - 1, q] - at[0, q]))
                    d_chord = chord[1] * d_local + chord[2] * d_theta
                    d_middle = at[k - 1, q] + middle[1] * d_local + middle[2] * d_theta
                    d_end = at[k - 1, q] + end[1] * d_local + end[2] * d_theta
                    change = by_par[q] + (d_chord - 1j * chord[0] * d_middle) * down - 1j * d_end * out
                    dnodes[frame, node, 0, q], dnodes[frame, node, 1, q] = change.real, change.imag
                node += 1
            # Carry the hinge line to the end of this body: its own part of the centre line grows with its angle alone.
            chord, middle, _ = _place(reach, theta, segment_length, outer_radius, polygon)
            down = -1j * np.exp(-1j * (before + middle[0]))
            hinge += chord[0] * down
            for q in range(p):
                d_theta = at[k, q] - at[k - 1, q]
                d_chord = (chord[1] * outer_radius + chord[2]) * d_theta
                d_middle = at[k - 1, q] + (middle[1] * outer_radius + middle[2]) * d_theta
                by_par[q] += (d_chord - 1j * chord[0] * d_middle) * down
            passed += reach
