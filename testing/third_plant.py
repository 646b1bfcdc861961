"""A third plant, for campaigns that nobody has looked at: a planar Kirchhoff rod in a modal basis.

Curvature is a short sum of Legendre polynomials of the arc length (a continuous rod, neither links nor joints); everything else
follows by Gauss quadrature, and LSODA steps it with its error held (Petzold 1983, doi:10.1137/0904010). It shares no code with
model, twin or second plant, and its laws are of other forms than the catalogue's: creep by a power law, friction of Dahl's kind, a
line that is an orifice, a wall that pushes back exponentially, a tube whose own wall tapers and takes its mass along.

Legend: t, place from clamp (0) to tip (1); theta, curvature times length; phi, absolute angle (0 hangs, positive towards -x).
Everything SI.
"""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.optimize import root

from rfea_vision.arrays import FloatArray

OUTER, INNER, LENGTH = 0.004, 0.003, 0.155
RUBBER, WATER, GRAVITY = 965.0, 1000.0, 9.80665
#: Moment per theta, loss per rate of theta, and the lever of the pressure; of a tube of the paper's size.
STIFFNESS, DAMPING, LEVER = 0.021, 1.9e-4, 0.0036
MODES, NODES = 5, 12
COUNT = MODES + 1  # the last mode is a turn of the clamp: no curvature, the same angle everywhere
#: Relaxation times of the power law's branches, and their shares.
TIMES = 0.03 * 5.0 ** np.arange(5)
SHARES = TIMES**-0.2
#: What hides, by name: 0 is absent; partners, which vanish with it, have the values of a usual tube.
USUAL = {
    "cap": 0.0, "cap_far": 0.002, "cap_beside": 1.0, "lean": 0.0, "set": 0.0, "taper": 0.0, "fung": 0.0, "creep": 0.0,
    "dahl": 0.0, "dahl_w": 0.3, "rub": 0.0, "shear": 0.0, "air": 0.0, "orifice": 0.0, "late": 0.0, "gain": 0.0, "zero": 0.0,
    "fatigue": 0.0, "fatigue_at": 1.0, "wall": 0.0, "wall_at": 0.05, "clamp": 0.0, "bore": 0.0, "inertance": 0.0,
    "wind": 0.0, "string": 0.0, "ring": 0.0, "ring_at": 0.45, "fold": 0.0, "fold_at": 0.4, "warm": 0.0, "leak": 0.0,
    "jet": 0.0, "shake": 0.0, "shake_Hz": 3.0,
}  # fmt: skip
Hidden = namedtuple("Hidden", tuple(USUAL))
#: Places, their weights, integration to every place and to the tip; theta, phi of the modes there, phi of the modes at the tip.
Basis = namedtuple("Basis", "t w along to_tip bend turn end")
Tube = namedtuple("Tube", "stiff loss push mass gx gy offset thins")


def _integral(order: int, t: FloatArray) -> FloatArray:
    """Integrals from 0 to t of the Legendre polynomials of 2t - 1, by columns."""
    return np.stack([legendre.legval(2 * t - 1, legendre.legint(row, lbnd=-1)) / 2 for row in np.eye(order)], axis=1)


def _basis() -> Basis:
    x, w = legendre.leggauss(NODES)
    t, tip, one = (x + 1) / 2, np.ones(1), np.ones((NODES, 1))
    spread = np.linalg.inv(legendre.legvander(x, NODES - 1))
    bend = np.hstack([legendre.legvander(x, MODES - 1), 0 * one])
    turn, end = np.hstack([_integral(MODES, t), one]), np.append(_integral(MODES, tip)[0], 1.0)
    return Basis(t, w / 2, _integral(NODES, t) @ spread, (_integral(NODES, tip) @ spread)[0], bend, turn, end)


BASIS = _basis()


@dataclass(frozen=True)
class ThirdTube:
    """One tube, or rod about its middle: where gravity points, factors on stiffness, damping and lever, and what hides in it."""

    rod: bool = False
    gravity_deg: float = 0.0
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    hidden: dict[str, float] = field(default_factory=dict)

    def laid_out(self) -> tuple[Hidden, Tube]:
        """What hides, and what every place has, as the right-hand side takes them."""
        own = Hidden(**{**USUAL, **self.hidden})
        t, w, *_ = BASIS
        wall = (1 - own.taper * t) ** 3
        area = np.pi * OUTER**2
        line = area * RUBBER + (0.0 if self.rod else np.pi * INNER**2 * (WATER - RUBBER))
        mass = line * LENGTH * w * (1 + own.taper * (0.5 - t))
        ring = np.exp(-(((t - own.ring_at) / 0.05) ** 2)) * w
        down, lever = np.deg2rad(self.gravity_deg) + own.lean, np.pi * LEVER * self.factors[2]
        return own, Tube(
            STIFFNESS * self.factors[0] * wall / (w @ wall), DAMPING * self.factors[1], lever, mass + own.ring * ring / ring.sum(),
            -GRAVITY * np.sin(down), -GRAVITY * np.cos(down), 0.0 if self.rod else OUTER, 0.0 if self.rod else 1.0,
        )  # fmt: skip


@njit(cache=True)
def _at(time, knots, cubics):
    """Logged pressure: piecewise cubic, smooth."""
    time = min(max(time, knots[0]), knots[-1])
    k = min(np.searchsorted(knots, time, "right") - 1, knots.size - 2)
    d = time - knots[k]
    return ((cubics[0, k] * d + cubics[1, k]) * d + cubics[2, k]) * d + cubics[3, k]


@njit(cache=True)
def _rates(time, state, knots, cubics, hid, tube, basis, times, shares, settle):
    """Rates of the state: modes, their rates, then what the hidden laws remember: line, creep, rubbing, largest bend."""
    n, places = basis.end.size, basis.t.size
    q, v, at = state[:n], state[n : 2 * n], 2 * n
    out = np.zeros(state.size)
    theta, rate, phi, spin = basis.bend @ q, basis.bend @ v, basis.turn @ q, basis.turn @ v
    since = max(time, 0.0)
    p = _at(time - hid.late, knots, cubics)
    if hid.orifice > 0:  # flow goes with the root of the pressure lost, but for the slowest
        gap = p - state[at]
        out[at] = gap / (hid.orifice * np.sqrt(0.05 + abs(gap) / 5e4))
        p = state[at]
        at += 1
    p = p * (1 + hid.gain) * (1 - hid.leak * (1 - np.exp(-since / 4))) + hid.zero
    # moments at the places
    shape = np.exp(-basis.t / 0.3) / 0.3
    k, bore = tube.stiff.copy(), np.empty(places)
    thin = np.ones(places)
    for i in range(places):
        square = OUTER**2 - (OUTER**2 - INNER**2) / (1 + OUTER * min(max(theta[i], -9.0), 9.0) / LENGTH)
        square = INNER**2 + tube.thins * (max(square, INNER**2 / 4) - INNER**2)
        thin[i] = (OUTER**4 - square**2) / (OUTER**4 - INNER**4)
        bore[i] = square + hid.bore * (INNER**2 - square)
    k *= thin * np.exp(hid.fung * np.minimum(theta**2, 25.0)) * (1 - hid.warm * (1 - np.exp(-since / 3)))
    k *= 1 - hid.fold * np.exp(-(((basis.t - hid.fold_at) / 0.08) ** 2)) * (0.5 + 0.5 * np.tanh((theta - 0.8) / 0.3))
    b = tube.loss * thin * (1 + 0.15 * tube.thins * np.tanh(rate / 0.1)) * (1 + hid.shear * rate**2 / (1 + np.abs(rate)))
    if hid.creep > 0:
        for m in range(times.size):
            own = state[at : at + n]
            strained = q - own
            out[at : at + n] = strained / times[m]
            at += n
    moment = p * tube.push * bore - b * rate * (20.0 if settle else 1.0)
    if hid.creep > 0:
        back = 2 * n + (1 if hid.orifice > 0 else 0)
        for m in range(times.size):
            moment -= hid.creep * shares[m] * STIFFNESS * (basis.bend @ (q - state[back + m * n : back + (m + 1) * n]))
    if hid.dahl > 0:
        rubbed = state[at : at + places]
        out[at : at + places] = rate * (1 - np.tanh(rate / 0.02) * rubbed) / hid.dahl_w
        moment -= hid.dahl * rubbed
        at += places
    if hid.fatigue > 0:
        worst = state[at : at + places]
        out[at : at + places] = np.maximum(np.abs(theta) - worst, 0.0) / 5e-3
        k *= 1 - hid.fatigue * worst**2 / (hid.fatigue_at**2 + worst**2)
    moment -= k * (theta - hid.set * shape) + hid.rub * np.arctan(rate / 0.05) * (2 / np.pi)
    force = basis.bend.T @ (basis.w * moment)
    force[n - 1] -= (q[n - 1] + 0.003 * v[n - 1]) * STIFFNESS / max(hid.clamp, 1e-3)
    # how the points of the rod move with the modes, and what pulls them
    sin, cos = np.sin(phi), np.cos(phi)
    jx = LENGTH * basis.along @ (-cos.reshape(-1, 1) * basis.turn)
    jy = LENGTH * basis.along @ (sin.reshape(-1, 1) * basis.turn)
    vx, vy = jx @ v, jy @ v
    shaken = 0.0 if settle else hid.shake * (2 * np.pi * hid.shake_Hz) ** 2 * np.sin(2 * np.pi * hid.shake_Hz * time)
    fx = tube.mass * (tube.gx + shaken - LENGTH * basis.along @ (sin * spin**2))
    fy = tube.mass * (tube.gy - LENGTH * basis.along @ (cos * spin**2))
    stir = hid.air if hid.air > 0 else (100.0 if hid.wind != 0 else 0.0)
    stir *= 2 * OUTER * LENGTH
    gust = hid.wind - vx  # the air pushes by its speed relative to the rod
    fx += stir * basis.w * np.sqrt(gust**2 + 0.01) * gust
    fy -= stir * basis.w * np.sqrt(vy**2 + 0.01) * vy
    if hid.wall > 0:
        x = -LENGTH * basis.along @ sin + tube.offset * (cos - 1)
        fx += hid.wall * basis.w * np.exp(np.minimum((-hid.wall_at - x) / 0.002, 6.0))
    force += jx.T @ fx + jy.T @ fy
    inertia = jx.T @ (tube.mass.reshape(-1, 1) * jx) + jy.T @ (tube.mass.reshape(-1, 1) * jy)
    inertia += basis.turn.T @ ((tube.mass * OUTER**2 / 2).reshape(-1, 1) * basis.turn)
    if hid.inertance > 0:
        inertia += hid.inertance * np.pi * OUTER**3 * np.outer(basis.bend.T @ (basis.w * tube.push * bore), basis.bend.T @ basis.w)
    # the tip: a cap with a mass, a string that becomes taut, a jet
    angle, turning = basis.end @ q, basis.end @ v
    c, s = np.cos(angle), np.sin(angle)
    tx = LENGTH * basis.to_tip @ (-cos.reshape(-1, 1) * basis.turn)
    ty = LENGTH * basis.to_tip @ (sin.reshape(-1, 1) * basis.turn)
    if hid.cap > 0:
        far, beside = hid.cap_far, tube.offset * hid.cap_beside
        cx, cy = tx - (far * c + beside * s) * basis.end, ty + (far * s - beside * c) * basis.end
        ax = LENGTH * basis.to_tip @ (sin * spin**2) + (far * s - beside * c) * turning**2
        ay = LENGTH * basis.to_tip @ (cos * spin**2) + (far * c + beside * s) * turning**2
        inertia += hid.cap * (np.outer(cx, cx) + np.outer(cy, cy))
        force += hid.cap * (cx * (tube.gx - ax) + cy * (tube.gy - ay))
    force += tx * hid.string * max(LENGTH * basis.to_tip @ sin - 0.05, 0.0)
    force += hid.jet * p * (tx * c - ty * s)
    out[:n] = v
    out[n : 2 * n] = np.linalg.solve(inertia, force)
    return out


def simulate(tube: ThirdTube, pressure: PchipInterpolator, times: FloatArray) -> FloatArray:
    """Angles phi at the places (frames, NODES), then that of the tip, as `pressure` (Pa over s) runs; it begins at rest.

    Raises
    ------
    ArithmeticError
        The tube runs away, or finds no rest to begin from.
    """
    hid, own = tube.laid_out()
    memory = {"orifice": 1, "creep": TIMES.size * COUNT, "dahl": NODES, "fatigue": NODES}
    state = np.zeros(2 * COUNT + sum(size for name, size in memory.items() if getattr(hid, name) > 0))

    def rates(time: float, now: FloatArray, settle: bool = False) -> Any:
        return _rates(time, now, pressure.x, pressure.c, hid, own, BASIS, TIMES, SHARES, settle)

    def held(q: FloatArray) -> Any:
        relaxed = [[float(pressure(0.0))], np.tile(q, TIMES.size), np.zeros(NODES), np.abs(BASIS.bend @ q)]
        kept = [part for part, name in zip(relaxed, memory, strict=True) if getattr(hid, name) > 0]
        state[:] = np.concatenate([q, np.zeros(COUNT), *kept])
        return rates(0.0, state, True)[COUNT : 2 * COUNT] / 1e3

    rest = root(held, np.zeros(COUNT))
    held(rest.x)
    found = solve_ivp(rates, (0.0, times[-1]), state, "LSODA", times, rtol=1e-4, atol=1e-5, max_step=0.05)
    if not (np.abs(rest.fun).max() < 1e-3 and found.success and np.abs(found.y[:COUNT]).max() < 50):
        raise ArithmeticError(f"the third plant ran away with {tube.hidden}")
    q = found.y[:COUNT].T
    return np.hstack([q @ BASIS.turn.T, (q @ BASIS.end)[:, None]])


def centre_line(tube: ThirdTube, phi: FloatArray, fractions: FloatArray) -> FloatArray:
    """Points (frames, m, 2) in m on the centre line, at fractions of its length."""
    offset, t = tube.laid_out()[1].offset, np.linspace(0, 1, 201)
    through = np.linalg.inv(legendre.legvander(2 * BASIS.t - 1, NODES - 1))
    fine = phi[:, :-1] @ through.T @ legendre.legvander(2 * t - 1, NODES - 1).T
    half, step = 0.5 * (fine[:, 1:] + fine[:, :-1]), LENGTH / 200
    line = offset * np.stack([np.cos(fine) - 1, -np.sin(fine)], axis=2)
    line[:, 1:] -= step * np.cumsum(np.stack([np.sin(half), np.cos(half)], axis=2), axis=1)
    lengths = np.cumsum(np.linalg.norm(np.diff(line, axis=1), axis=2), axis=1)
    out = np.zeros((phi.shape[0], fractions.size, 2))
    for row, points, length in zip(out, line, lengths, strict=True):
        for axis in range(2):
            row[:, axis] = np.interp(fractions * length[-1], [0.0, *length], points[:, axis])
    return out
