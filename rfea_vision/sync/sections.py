"""The tube's equation of motion at a few cross-sections, as terms of a regression whose left side is the pressure.

At every cross-section the pressure's moment is balanced by stiffness, damping, and the moment of everything beyond it:
its weight and its inertia. The last is known from the picture up to one factor, since the mass is spread evenly:

    p(t) = (c1 + c2 q + c3 q^2 + c4 q^3 + c5 sigma) q + (c6 + c7 q) q'+ + (c8 + c9 q) q'- + c10 q^2 q'
         + (c11 + c12 q + c13 q^2) M + c14 M_tip,

with q the bend of a short section, M the moment of an even tube about it and M_tip that of a point mass at the tip.
The powers of q stand for a bore that changes with the bend. All sections share the coefficients.

The tube's mass lies on the line that keeps its length, which the picture shows only beside the centre line: that grows
by the tube's radius times the bend, and by this the radius is known.

What a tube may have beside this (`SUPPLEMENTS`): damping that varies along it, friction, damping quadratic in the
speed, creep, hysteresis, drag of the air or water about it. Each is a column of its own, and is taken in only where
the data ask for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy import constants
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Track, bend_sign
from rfea_vision.lines import from_down
from rfea_vision.scatter import leaps

MODES = 3  # Legendre modes of the tangent angle beside its mean: more carry little but noise
SECTIONS = 4  # cross-sections at which the balance is written, one more than MODES
PIECES = 4  # pieces per section, for the integrals
SUPPLEMENTS = ("profile", "friction", "quadratic damping", "creep", "hysteresis", "drag")
FRICTION_WIDTH = 0.15  # of the speed's root mean square
HYSTERESIS_WIDTH = 0.1  # of the swing
CREEP_S = 0.5  # of the creep supplement: between the swing and the run
ANGLE_STIFFNESS, ANGLE_INERTIA = 0, 6  # places among the terms of one angle
DIFFERENCE = 8  # order of the differences in time that hold noise and hardly any motion
REPEAT_SMOOTHING = 2.0  # frames
REPEAT_STANDS_OUT, REPEAT_SHARE = 6.0, 0.35  # of a frame's expected motion: over its noise, and what a repeat shows
MOST_RADIUS = 0.15  # of the length: what the centre line may grow per radian


@dataclass(frozen=True)
class ObservedMotion:
    """Amplitudes (n, m) of the motion at times (n,) s: of modes of the tangent angle, or one angle alone.

    `gravity_m_s2` is its vector where the resting tube points down and bends to the left; `length_m` is the length of the line
    that keeps it; `modal` tells whether the whole shape is known, `repeats` how many frames were left out since they show the
    one before once more.
    """

    time_s: FloatArray
    amplitudes: FloatArray
    length_m: float
    modal: bool
    repeats: int = 0
    gravity_m_s2: tuple[float, float] = (0.0, -constants.g)

    @property
    def bend_rad(self) -> FloatArray:
        """The tip's bend (or what stands for it), (n,)."""
        return self.amplitudes.sum(axis=1) if self.modal else self.amplitudes[:, 0]

    @property
    def swing_rad(self) -> float:
        """Its range."""
        return float(np.ptp(self.bend_rad))


def gravity_of(gravity_deg: float | None) -> tuple[float, float]:
    """Gravity (m/s^2) that points so far from down, positive towards the side of the bend; None where the plane of motion is level."""
    if gravity_deg is None:
        return 0.0, 0.0
    angle = np.radians(gravity_deg)
    return -constants.g * float(np.sin(angle)), -constants.g * float(np.cos(angle))


def motion_of(track: Track, bends: str, gravity_deg: float | None = 0.0) -> ObservedMotion:
    """Valid frames of a track as an `ObservedMotion`; midline (of five nodes or more), bend angle or tip, whichever is the first there.

    Frames that stand out alone from their neighbours, as where a marker is mistaken, are left out.

    gravity_deg : where gravity points, as in `gravity_of`
    """
    dataset, valid = track.dataset, track.valid
    time = track.time_s[valid]
    sign = bend_sign(bends)
    length, modal = 1.0, False
    if "midline" in dataset and dataset.sizes["node"] > MODES + 1:  # as many stretches between nodes as modes and their mean
        found, length = _modes(dataset["midline"].values[valid] * 1e-3, sign)
        modal = True
    elif "bend_angle" in dataset:
        found = np.radians(dataset["bend_angle"].values[valid])[:, None]
    else:
        found = 2 * from_down(dataset["tip"].values[valid], sign)[:, None]  # a chord's direction is half of the bend
    good = np.all(np.isfinite(found), axis=1)
    time, found = time[good], found[good]
    first = np.concatenate([[True], np.diff(time) > 1e-9])
    time = time[first]
    found = np.asarray(found[first] if modal else np.unwrap(found[first], axis=0), dtype=float)
    steady = ~leaps(found)
    time, found = time[steady], found[steady]
    new = ~repeated(time, found)
    return ObservedMotion(time[new], found[new], length, modal, int(np.sum(~new)), gravity_of(gravity_deg))


def repeated(time_s: FloatArray, amplitudes: FloatArray) -> NDArray[np.bool_]:
    """Which frames (n,) repeat the picture before, as late cameras do, by the amplitudes (n, m) at their times (n,) in s.

    A repeat shows an earlier instant than its time says: it hardly moves between frames that do, by more than the noise.
    """
    again = np.zeros(len(time_s), dtype=bool)
    if len(time_s) < 4 * DIFFERENCE:
        return again
    scaled = amplitudes / (np.sqrt(np.diag(noise_covariance(amplitudes))) + 1e-9)
    smooth, when = (gaussian_filter1d(values, REPEAT_SMOOTHING, axis=0) for values in (scaled, time_s))
    slope = np.diff(smooth, axis=0) / np.diff(when)[:, None]
    expected, moved = slope * np.diff(time_s)[:, None], np.diff(scaled, axis=0)
    share, square = _share(moved, expected)
    both, _ = _share(moved[1:] + moved[:-1], expected[1:] + expected[:-1])
    waits = (square > REPEAT_STANDS_OUT**2) & (share < REPEAT_SHARE)
    before, _ = _share(moved[:-1], expected[1:])
    # What begins or turns hesitates too; only a repeat goes on as before, by two steps at once.
    again[2:-1] = waits[1:-1] & (before[:-1] > 1 - REPEAT_SHARE) & (np.abs(both[1:] - 1) < REPEAT_SHARE)
    return again


def _share(moved: FloatArray, expected: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share of the expected steps (n, m) that was moved, (n,), and their squared length."""
    square = np.sum(expected**2, axis=1)
    return np.sum(expected * moved, axis=1) / np.maximum(square, 1e-12), square


def noise_covariance(amplitudes: FloatArray) -> FloatArray:
    """Covariance (m, m) of the amplitudes' white noise from their high differences in time."""
    differences = np.diff(amplitudes, n=DIFFERENCE, axis=0)
    return differences.T @ differences / len(differences) / comb(2 * DIFFERENCE, DIFFERENCE)


def _modes(midline_m: FloatArray, sign: float) -> tuple[FloatArray, float]:
    """Amplitudes (n, m) of the tangent's angle along the line that keeps its length, and its length."""
    step = np.diff(midline_m, axis=1)
    angle = np.unwrap(from_down(step, sign), axis=1)
    places = (np.arange(angle.shape[1]) + 0.5) / angle.shape[1]
    bend = angle @ np.linalg.pinv(_legendre(places)).sum(axis=0)  # at the tip, where every mode is 1
    length = np.linalg.norm(step, axis=-1).sum(axis=1)
    good = np.isfinite(bend) & np.isfinite(length)
    if not good.any():
        return np.full((len(angle), MODES + 1), np.nan), np.nan
    about = bend[good] - bend[good].mean()
    radius = float(about @ length[good]) / max(float(about @ about), 1e-12)
    radius = float(np.clip(radius, 0.0, MOST_RADIUS * length[good].mean()))
    kept = length - radius * bend
    along = (length[:, None] * places - radius * angle) / kept[:, None]
    design = _legendre(np.where(np.isfinite(along), along, places))
    normal = np.einsum("tki,tkj->tij", design, design)
    right = np.einsum("tki,tk->ti", design, angle)
    return np.linalg.solve(normal, right[..., None])[..., 0], float(kept[good].mean())


def _legendre(places: FloatArray) -> FloatArray:
    return np.asarray(np.polynomial.legendre.legvander(2 * places - 1, MODES), dtype=float)


def derivative(values: FloatArray, rate: float) -> FloatArray:
    """Fourth-order central time derivative of (samples, ...) along axis 0."""
    padded = np.pad(values, [(2, 2)] + [(0, 0)] * (values.ndim - 1), mode="edge")
    return (padded[:-4] - 8 * padded[1:-3] + 8 * padded[3:-1] - padded[4:]) * (rate / 12)


def terms(motion: ObservedMotion, amplitudes: FloatArray, rate: float) -> FloatArray:
    """Terms (sections, n, terms) from smooth, evenly sampled amplitudes (n, m)."""
    return _section_terms(motion, amplitudes, rate) if motion.modal else _angle_terms(amplitudes[:, 0], rate)[None]


def supplements(motion: ObservedMotion, amplitudes: FloatArray, rate: float) -> FloatArray:
    """Terms (sections, n, 6) of `SUPPLEMENTS`, in their order; 0 where one angle cannot show them."""
    if motion.modal:
        angle = amplitudes @ _legendre(np.linspace(0, 1, SECTIONS + 1)).T
        bends = np.diff(angle, axis=1)
        places = 2 * (np.arange(SECTIONS) + 0.5) / SECTIONS - 1
    else:
        bends, places = amplitudes[:, :1], np.zeros(1)
    drag = _drag(motion, amplitudes, rate) if motion.modal else np.zeros_like(bends)
    speed = derivative(bends, rate)
    mean_speed = float(np.sqrt(np.mean(speed.mean(axis=1) ** 2))) + 1e-12
    swing = float(np.ptp(bends.mean(axis=1))) + 1e-12
    decay = np.exp(-1 / (CREEP_S * rate))
    crept = lfilter([1 - decay], [1.0, -decay], bends, axis=0, zi=decay * bends[:1])[0]
    columns = [
        speed * places,
        np.tanh(speed / (FRICTION_WIDTH * mean_speed)),
        speed * np.abs(speed),
        crept,
        _lagging(bends, HYSTERESIS_WIDTH * swing),
        drag,
    ]
    return np.moveaxis(np.stack(columns, axis=-1), 1, 0)


def _lagging(bends: FloatArray, width: float) -> FloatArray:
    """Rate-independent hysteresis: after a reversal the sign of the motion is reached again within `width` (Dahl)."""
    change = np.diff(bends, axis=0)
    direction, kept = np.sign(change), np.exp(-np.abs(change) / width)
    out = np.zeros_like(bends)
    for k in range(len(change)):
        out[k + 1] = direction[k] + (out[k] - direction[k]) * kept[k]
    return out


def _angle_terms(angle: FloatArray, rate: float) -> FloatArray:
    """One angle: its own inertia and weight stand for those of the tube."""
    speed = derivative(angle, rate)
    push = derivative(speed, rate)
    up, down = np.maximum(speed, 0), np.minimum(speed, 0)
    return np.column_stack([angle, angle**2, angle**3, up, down, angle * speed, push, angle * push, speed**2])


def _places(motion: ObservedMotion, amplitudes: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Angles (n, k) and places (n, k, 2) m at the ends of all pieces, and the length of a piece."""
    count = SECTIONS * PIECES
    angle = amplitudes @ _legendre(np.linspace(0, 1, count + 1)).T
    piece = motion.length_m / count
    middle = 0.5 * (angle[:, 1:] + angle[:, :-1])
    steps = np.stack([-np.sin(middle), -np.cos(middle)], axis=-1) * piece
    place = np.concatenate([np.zeros((len(angle), 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    return angle, place, piece


def _moment(arm: FloatArray, force: FloatArray) -> FloatArray:
    """Moment (n,) against the bend, of forces (n, k, 2) at the ends of arms (n, k, 2)."""
    return -np.sum(arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0], axis=1)


def _drag(motion: ObservedMotion, amplitudes: FloatArray, rate: float) -> FloatArray:
    """Moment (n, sections) of a drag that grows with the square of the speed of everything beyond a section."""
    _, place, piece = _places(motion, amplitudes)
    speed = derivative(place, rate)
    force = speed * np.linalg.norm(speed, axis=-1, keepdims=True)
    middles = PIECES * np.arange(SECTIONS) + PIECES // 2
    return np.column_stack([_moment(place[:, k:] - place[:, k : k + 1], force[:, k:]) * piece for k in middles])


def _section_terms(motion: ObservedMotion, amplitudes: FloatArray, rate: float) -> FloatArray:
    angle, place, piece = _places(motion, amplitudes)
    pull = derivative(derivative(place, rate), rate)
    pull -= motion.gravity_m_s2
    centres, pulls = 0.5 * (place[:, 1:] + place[:, :-1]), 0.5 * (pull[:, 1:] + pull[:, :-1])
    out = []
    for section in range(SECTIONS):
        k = PIECES * section + PIECES // 2
        q = angle[:, PIECES * (section + 1)] - angle[:, PIECES * section]
        moment = _moment(centres[:, k:] - place[:, k : k + 1], pulls[:, k:]) * piece
        of_tip = _moment(place[:, -1:] - place[:, k : k + 1], pull[:, -1:])
        speed = derivative(q, rate)
        sigma = 2 * (section + 0.5) / SECTIONS - 1
        up, down = np.maximum(speed, 0), np.minimum(speed, 0)
        stiff = [q, q**2, q**3, q**4, q * sigma]
        damped = [up, down, q * up, q * down, q**2 * speed]
        out.append(np.column_stack([*stiff, *damped, moment, moment * q, moment * q**2, of_tip]))
    return np.stack(out)
