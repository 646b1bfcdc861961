"""A second plant, to try the critique on a tube that neither the model nor the twin has made.

A chain of links with lumped masses in absolute angles, joints at the links' ends (the clamp's with half an arc), stepped by
an L-stable two-stage method in the rates (Alexander 1977, doi:10.1137/0714068). It shares no code with model or twin, and
the laws of its effects are those of other authors: a capped linear softening, a local soft spot, Prandtl-Ishlinskii elements, a
spectrum of relaxation times, a line of second order, and so on. Written before the critique was calibrated; nothing is tuned on it.

Legend: phi, absolute angle of a link (0 hangs down, positive towards -x); Theta, curvature times length; sigma, place from
clamp to tip. Everything SI.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from rfea_vision.arrays import FloatArray

OUTER, INNER, LENGTH = 0.004, 0.003, 0.155
RUBBER, WATER, GRAVITY = 965.0, 1000.0, 9.80665
LINKS, STEP_S = 20, 1e-3
#: Moment of the whole tube per Theta: the paper's table for eight joints over eight, and its slope over the inner radius.
STIFFNESS, STIFFNESS_SLOPE = 0.0212, -80.0
DAMPING_UP, DAMPING_DOWN, DAMPING_SLOPE = 2.2e-4, 1.6e-4, -0.6
LEVER = 0.0036
#: Relaxation times of the creep spectrum, a decade and a half in steps of four.
TIMES = np.array([0.1, 0.4, 1.6, 6.4])
#: Yield angles (of the whole tube) of the Prandtl-Ishlinskii elements, and their shares.
YIELDS, SHARES = np.array([0.05, 0.2, 0.6]), np.array([0.5, 0.3, 0.2])

#: Hidden parameters: what each is, by name; the amplitude that makes a law is the first of its group.
NAMES = (
    "soften_capped", "soften_capped_at", "soften_root", "spot", "spot_at", "spot_width", "stepped", "play", "stribeck", "spectrum",
    "stiffer_abs", "damping_root", "payload", "tilt", "curl_root", "line", "latency", "stiffer_pressure", "drag", "clamp",
    "damping_stepped", "fan", "shake", "shake_Hz", "drift", "drift_s", "twitch",
)  # fmt: skip
INDEX = {name: k for k, name in enumerate(NAMES)}
(
    SOFTEN, SOFTEN_AT, SOFTEN_ROOT, SPOT, SPOT_AT, SPOT_WIDTH, STEPPED, PLAY, STRIBECK, SPECTRUM,
    STIFFER_ABS, DAMPING_ROOT, PAYLOAD, TILT, CURL, LINE, LATENCY, STIFFER_PRESSURE, DRAG, CLAMP,
    DAMPING_STEPPED, FAN, SHAKE, SHAKE_HZ, DRIFT, DRIFT_S, TWITCH,
) = range(len(NAMES))  # fmt: skip


@dataclass(frozen=True)
class OtherTube:
    """One tube: factors on stiffness, both dampings and the lever, and what hides in it."""

    stiffness: float = 1.0
    damping: float = 1.0
    lever: float = 1.0
    hidden: dict[str, float] = field(default_factory=dict)

    def vector(self) -> FloatArray:
        """Hidden parameters in the order of `NAMES`."""
        out = np.zeros(len(NAMES))
        out[[INDEX["soften_capped_at"], INDEX["spot_at"], INDEX["spot_width"]]] = 1.0, 0.4, 0.08
        out[[INDEX["shake_Hz"], INDEX["drift_s"]]] = 3.0, 4.0
        for name, value in self.hidden.items():
            out[INDEX[name]] = value
        return out


@njit(cache=True)
def _inner(curvature):
    """Inner radius of incompressible rubber whose outer radius stays (the centre line is stretched by r_o kappa)."""
    return np.sqrt(OUTER**2 - (OUTER**2 - INNER**2) / (1 + OUTER * max(curvature, -50.0)))


@njit(cache=True)
def _moments(angle, rate, memory, pressure, time, sigma, arc, size, hid, out, stiff, damp):
    """Moment at every joint, and its slopes over the joint's angle and rate."""
    for j in range(angle.size):
        curvature = angle[j] / arc[j]
        theta, speed = curvature * LENGTH, rate[j] / arc[j] * LENGTH
        radius = _inner(curvature)
        k = size[0] * (STIFFNESS + STIFFNESS_SLOPE * (radius - INNER))
        up, down = DAMPING_UP, DAMPING_DOWN
        b = size[1] * max((up if speed >= 0 else down) + DAMPING_SLOPE * (radius - INNER), 0.2 * down)
        worst = memory[j, 0]
        k *= 1 - hid[SOFTEN] * min(worst / hid[SOFTEN_AT], 1.0) - hid[SOFTEN_ROOT] * np.sqrt(max(worst, 0.0))
        k *= 1 - hid[SPOT] * np.exp(-(((sigma[j] - hid[SPOT_AT]) / hid[SPOT_WIDTH]) ** 2))
        k *= 1 + (hid[STEPPED] if sigma[j] > 0.5 else -hid[STEPPED])
        k *= 1 + hid[STIFFER_ABS] * abs(theta) + hid[STIFFER_PRESSURE] * pressure / (1 + pressure / 2e5)
        k *= 1 - hid[DRIFT] * (1 - np.exp(-max(time, 0.0) / hid[DRIFT_S]))
        k *= 1 + hid[TWITCH]
        b *= 1 + (hid[DAMPING_STEPPED] if sigma[j] > 0.5 else -hid[DAMPING_STEPPED])
        b *= 1 + hid[DAMPING_ROOT] * np.sqrt(abs(speed))
        rest = hid[CURL] * 2 * (1 - sigma[j])
        moment = pressure * np.pi * radius**2 * LEVER * size[2] - k * (theta - rest) - b * speed
        moment -= hid[STRIBECK] * np.tanh(speed / 0.02) * (0.6 + 0.4 * np.exp(-abs(speed) / 0.5))
        slope = k
        for m in range(TIMES.size):
            moment -= hid[SPECTRUM] * STIFFNESS * size[0] * (theta - memory[j, 1 + m])
            slope += hid[SPECTRUM] * STIFFNESS * size[0]
        for m in range(YIELDS.size):
            moment -= hid[PLAY] * SHARES[m] * memory[j, 5 + m] / YIELDS[m]
        out[j] = moment
        stiff[j] = slope * LENGTH / arc[j]
        damp[j] = (b + hid[STRIBECK] / 0.02 * (1 - np.tanh(speed / 0.02) ** 2)) * LENGTH / arc[j]


@njit(cache=True)
def _remember(memory, before, after, arc, step):
    """Memory after a step: largest bend; relaxed angles (exact for a ramp); elements that yield."""
    for j in range(arc.size):
        old, new = before[j] / arc[j] * LENGTH, after[j] / arc[j] * LENGTH
        memory[j, 0] = max(memory[j, 0], new)
        for m in range(TIMES.size):
            decay = np.exp(-step / TIMES[m])
            memory[j, 1 + m] = decay * memory[j, 1 + m] + (1 - decay) * 0.5 * (old + new)
        for m in range(YIELDS.size):
            memory[j, 5 + m] = min(max(memory[j, 5 + m] + new - old, -YIELDS[m]), YIELDS[m])


@njit(cache=True)
def _forces(phi, om, memory, pressure, time, sigma, arc, size, hid, mass, stiff, damp):
    """Mass matrix and generalised forces in absolute angles; slopes of the joints beside them."""
    n = phi.size
    link = LENGTH / n
    angle, rate, moment = np.empty(n), np.empty(n), np.empty(n)
    base = 0.0
    for j in range(n):
        angle[j] = phi[j] - (phi[j - 1] if j else base)
        rate[j] = om[j] - (om[j - 1] if j else 0.0)
    _moments(angle, rate, memory, pressure, time, sigma, arc, size, hid, moment, stiff, damp)
    if hid[CLAMP] > 0:  # the clamp gives: two springs in a row at the first joint
        share = 1 / (1 + hid[CLAMP] * stiff[0])
        moment[0] *= share
        stiff[0] *= share
        damp[0] *= share
    M, F = np.empty((n, n)), np.empty(n)
    heavy = np.empty(n)
    total = 0.0
    for i in range(n - 1, -1, -1):
        total += mass[i]
        heavy[i] = total
    vx = vy = 0.0
    px, py = np.empty(n), np.empty(n)
    for i in range(n):
        vx += -link * np.cos(phi[i]) * om[i]
        vy += link * np.sin(phi[i]) * om[i]
        speed = np.sqrt(vx * vx + vy * vy)
        pull = -hid[DRAG] * OUTER * link * speed**0.8
        px[i] = pull * vx + hid[FAN] * link / LENGTH
        py[i] = pull * vy
    push_x = push_y = 0.0
    shaken = -hid[SHAKE] * (2 * np.pi * hid[SHAKE_HZ]) ** 2 * np.sin(2 * np.pi * hid[SHAKE_HZ] * time)
    for i in range(n - 1, -1, -1):
        push_x += px[i]
        push_y += py[i]
        F[i] = moment[i] - (moment[i + 1] if i + 1 < n else 0.0)
        F[i] += link * (-np.cos(phi[i]) * push_x + np.sin(phi[i]) * push_y)
        F[i] += heavy[i] * link * (-GRAVITY * np.sin(phi[i] - hid[TILT]) + np.cos(phi[i]) * shaken)
        for j in range(n):
            A = heavy[max(i, j)] * link * link
            M[i, j] = A * np.cos(phi[i] - phi[j])
            F[i] -= A * np.sin(phi[i] - phi[j]) * om[j] ** 2
    for i in range(n):
        M[i, i] += mass[i] * OUTER**2 / 2
    return M, F


@njit(cache=True)
def _tri(values):
    """Slopes of the joints as a matrix over absolute angles."""
    n = values.size
    out = np.zeros((n, n))
    for j in range(n):
        out[j, j] += values[j]
        if j:
            out[j - 1, j - 1] += values[j]
            out[j, j - 1] -= values[j]
            out[j - 1, j] -= values[j]
    return out


@njit(cache=True)
def _joints(phi):
    out = phi.copy()
    out[1:] -= phi[:-1]
    return out


@njit(cache=True)
def _stage(phi0, om0, guess, step, memory, pressure, time, sigma, arc, size, hid, mass, extra):
    """Solve om = om0 + step f(phi0 + step om, om) by Newton; `extra` is damping on top, to come to rest."""
    om = guess.copy()
    stiff, damp = np.empty(om.size), np.empty(om.size)
    for _ in range(12):
        phi = phi0 + step * om
        M, F = _forces(phi, om, memory, pressure, time, sigma, arc, size, hid, mass, stiff, damp)
        K, B = _tri(stiff), _tri(damp)
        if extra > 0:
            F -= extra * B @ om
            B = (1 + extra) * B
        change = np.linalg.solve(M + step * B + step**2 * K, step * F - M @ (om - om0))
        om += change
        if np.max(np.abs(change)) < 1e-9 + 1e-7 * np.max(np.abs(om)):
            break
    return om


@njit(cache=True)
def _run(pressure, step, every, settle, sigma, arc, size, hid, mass):
    """Absolute angles (frames, links) at every so-many steps; first the tube comes to rest at the first pressure."""
    n = sigma.size
    phi, om, memory = np.zeros(n), np.zeros(n), np.zeros((n, 8))
    gamma = 1 - np.sqrt(0.5)
    out = np.empty(((pressure.size - 1) // every + 1, n))
    quiet = hid.copy()
    quiet[SHAKE] = 0.0
    for k in range(-settle, pressure.size):
        if k >= 0 and k % every == 0:
            out[k // every] = phi
        if k == pressure.size - 1:
            break
        resting = k < 0
        extra, now = (20.0, quiet) if resting else (0.0, hid)
        p0, p1, time = pressure[max(k, 0)], pressure[max(k + 1, 0)], k * step
        part = gamma * step
        middle = p0 + gamma * (p1 - p0)
        first = _stage(phi, om, om, part, memory, middle, time + part, sigma, arc, size, now, mass, extra)
        slope_phi, slope_om = first, (first - om) / part
        rest = (1 - gamma) * step
        start_phi, start_om = phi + rest * slope_phi, om + rest * slope_om
        second = _stage(start_phi, start_om, first, part, memory, p1, time + step, sigma, arc, size, now, mass, extra)
        before = _joints(phi)
        phi, om = start_phi + part * second, second
        _remember(memory, before, _joints(phi), arc, step)
        if k == -1:  # at rest: what relaxes has relaxed, what yields is in the middle
            om = np.zeros(n)
            theta = _joints(phi) / arc * LENGTH
            memory[:, 0] = np.maximum(theta, 0.0)
            for m in range(TIMES.size):
                memory[:, 1 + m] = theta
            memory[:, 5:] = 0.0
    return out


def second_order(pressure: FloatArray, step_s: float, period_s: float) -> FloatArray:
    """A line with inertia: second order, damping ratio 0.8."""
    if period_s <= 0:
        return pressure
    omega, value, rate = 2 * np.pi / period_s, pressure[0], 0.0
    out = np.empty_like(pressure)
    for k, wanted in enumerate(pressure):
        rate += step_s * omega * (omega * (wanted - value) - 1.6 * rate)
        value += step_s * rate
        out[k] = value
    return out


def simulate(tube: OtherTube, pressure: FloatArray, step_s: float, every: int) -> FloatArray:
    """Absolute angles of the links (frames, links) under a pressure (Pa) on a grid of `step_s`, at every so-many samples."""
    n, hid = LINKS, tube.vector()
    fine = max(1, round(step_s / STEP_S))
    grid = np.arange((pressure.size - 1) * fine + 1) / fine
    felt = np.interp(grid, np.arange(pressure.size), pressure)
    felt = second_order(felt, step_s / fine, hid[LINE])
    if hid[LATENCY]:
        late = round(hid[LATENCY] / (step_s / fine))
        felt = np.concatenate([np.full(late, felt[0]), felt[: felt.size - late]])
    link = LENGTH / n
    sigma, arc = np.arange(n) / n, np.full(n, link)
    arc[0] = link / 2
    sigma[0] = 0.25 / n
    area = np.pi * (RUBBER * (OUTER**2 - INNER**2) + WATER * INNER**2)
    mass = np.full(n, area * link)
    mass[-1] = area * link / 2 + hid[PAYLOAD]
    size = np.array([tube.stiffness, tube.damping, tube.lever])
    return _run(felt, step_s / fine, every * fine, 2000, sigma, arc, size, hid, mass)


def centre_line(phi: FloatArray, fractions: FloatArray) -> FloatArray:
    """Points (frames, m, 2) in m on the centre line, at fractions of its length, read off a fine curve through the links."""
    frames, n = phi.shape
    middles, fine = (np.arange(n) + 0.5) / n, np.linspace(0, 1, 201)
    smooth = np.stack([np.interp(fine, np.concatenate([[0.0], middles]), np.concatenate([[0.0], row])) for row in phi])
    slope = (phi[:, -1] - phi[:, -2]) * n
    beyond = fine > middles[-1]
    smooth[:, beyond] = phi[:, -1:] + 0.5 * slope[:, None] * (fine[beyond] - middles[-1])
    step = np.diff(fine) * LENGTH
    half = 0.5 * (smooth[:, 1:] + smooth[:, :-1])
    hinge = np.zeros((frames, fine.size, 2))
    hinge[:, 1:, 0] = np.cumsum(-np.sin(half) * step, axis=1)
    hinge[:, 1:, 1] = np.cumsum(-np.cos(half) * step, axis=1)
    line = hinge + OUTER * np.stack([np.cos(smooth), -np.sin(smooth)], axis=2) - np.array([OUTER, 0.0])
    out = np.empty((frames, fractions.size, 2))
    for f in range(frames):
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line[f], axis=0), axis=1))])
        for axis in range(2):
            out[f, :, axis] = np.interp(fractions * length[-1], length, line[f, :, axis])
    return out
