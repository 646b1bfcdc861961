"""A tube that is drawn, not simulated: a bend that follows the pressure with some ringing, creep and a tilt.

The first rung lacks the creep, the second one the tilt.
"""

from __future__ import annotations

import numpy as np

RATE_HZ = 240.0
NODES = 33
SEGMENTS = 16
LENGTH_MM = 155.0
RADIUS_MM = 4.0
NOISE_MM = 0.06
RUNGS = ("base", "base+maxwell", "base+maxwell+gravity_tilt")
ROLES = {"steps-270kPa": "train", "ramps-220kPa": "train", "steps-180kPa": "validate", "mixed-250kPa": "test"}
CREEP = (1.0, 0.05, 0.0)  # share of the creep that a rung still lacks
TILT = (1.0, 1.0, 0.0)


def pressure_kPa(name: str, time: np.ndarray) -> np.ndarray:
    peak = float(name.split("-")[1].removesuffix("kPa"))
    knots = {
        "steps": ([0, 0.5, 0.56, 2.0, 2.06, 3.3, 3.36, 4.6, 4.66, 9], [0, 0, 1, 1, 0.45, 0.45, 0.8, 0.8, 0, 0]),
        "ramps": ([0, 0.4, 2.2, 2.9, 4.4, 5.2, 9], [0, 0, 1, 1, 0.15, 0.6, 0.6]),
        "mixed": ([0, 0.4, 0.46, 1.6, 2.9, 2.96, 4.2, 4.26, 9], [0, 0, 0.6, 0.6, 1, 0.3, 0.3, 0.75, 0.1]),
    }[name.split("-")[0]]
    return peak * np.interp(time, *knots)


def follow(drive: np.ndarray, step: float, natural_Hz: float, damping: float) -> np.ndarray:
    omega, x, v = 2 * np.pi * natural_Hz, drive[0], 0.0
    out = np.empty_like(drive)
    for i, target in enumerate(drive):
        v += step * (omega**2 * (target - x) - 2 * damping * omega * v)
        x += step * v
        out[i] = x
    return out


def lag(drive: np.ndarray, step: float, constant_s: float) -> np.ndarray:
    out, z = np.empty_like(drive), drive[0]
    for i, target in enumerate(drive):
        z += step * (target - z) / constant_s
        out[i] = z
    return out


def shape(angle_deg: np.ndarray, tilt_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Centre line (time, node, xy) in mm of a tube that bends left, and the angle of each segment in deg."""
    sigma = (np.arange(SEGMENTS) + 0.5) / SEGMENTS
    weight = 1 + 0.18 * (1 - 2 * sigma) + 0.1 * np.cos(5 * sigma)
    theta = np.radians(angle_deg)[:, None] * weight / weight.sum() + np.radians(tilt_deg) * (1 - sigma) / SEGMENTS
    fine = 8
    step_length = LENGTH_MM / SEGMENTS + RADIUS_MM * theta
    phi = np.cumsum(np.repeat(theta / fine, fine, axis=1), axis=1) - np.repeat(theta / fine, fine, axis=1) / 2
    ds = np.repeat(step_length / fine, fine, axis=1)
    x = np.concatenate([np.zeros((len(theta), 1)), np.cumsum(-np.sin(phi) * ds, axis=1)], axis=1)
    y = np.concatenate([np.zeros((len(theta), 1)), np.cumsum(-np.cos(phi) * ds, axis=1)], axis=1)
    at = np.linspace(0, SEGMENTS * fine, NODES)
    low = np.minimum(at.astype(int), SEGMENTS * fine - 1)
    part = at - low
    line = np.stack([v[:, low] * (1 - part) + v[:, low + 1] * part for v in (x, y)], axis=-1)
    return line, np.degrees(theta)


def normals(line: np.ndarray) -> np.ndarray:
    tangent = np.gradient(line, axis=1)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    return np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)


def phases(pressure: np.ndarray, time: np.ndarray) -> np.ndarray:
    slope = np.gradient(pressure, time)
    out = np.where(slope > 20, "rise", np.where(slope < -20, "fall", "hold")).astype(object)
    changed = np.flatnonzero(np.diff((np.abs(slope) > 20).astype(int)) == -1)
    for index in changed:
        out[index + 1 : index + 60] = "ringing"
    out[(pressure < 1) & (out == "hold")] = "rest"
    return out.astype(str)


def experiment(name: str, seconds: float, seed: int) -> dict:
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    log = np.arange(round(seconds * 1000)) / 1000
    p_log = pressure_kPa(name, log)
    fast = follow(0.58 * p_log, 1e-3, 3.6, 0.3)
    slow = 0.06 * lag(fast, 1e-3, 1.2) - 0.02 * fast
    frames = np.minimum(np.round(time * 1000).astype(int), len(log) - 1)
    truth, theta = shape((fast + slow)[frames], 2.0)
    measured = truth + rng.normal(0, NOISE_MM, truth.shape) * np.linspace(0, 1, NODES)[None, :, None]
    models = [
        shape((fast + (1 - lacks) * slow)[frames], 2.0 * (1 - tilt)) for lacks, tilt in zip(CREEP, TILT, strict=True)
    ]
    return {
        "name": name, "time": time, "log": log, "p_log": p_log + rng.normal(0, 0.2, len(log)), "p": p_log[frames],
        "measured": measured, "theta": theta, "models": models, "rng": rng, "offset": 0.1 + 0.137 * seed,
    }  # fmt: skip
