"""Motions: how far a body is bent, and how it rings, in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Rng = np.random.Generator
PER_FRAME = 8  # places in time at which a motion is tabled


@dataclass(frozen=True)
class Motion:
    """How far a body is bent, of its most (-1 to 1), and how it wobbles in its second shape, at frames (n,)."""

    name: str
    frames: np.ndarray
    bent: np.ndarray
    wobble: np.ndarray

    def at(self, frame: float) -> tuple[float, float]:
        return float(np.interp(frame, self.frames, self.bent)), float(np.interp(frame, self.frames, self.wobble))


def _slow(u: np.ndarray, rng: Rng) -> np.ndarray:
    hold = rng.uniform(0, 0.2)
    return 0.5 - 0.5 * np.cos(2 * np.pi * np.clip((u - hold / 2) / (1 - hold), 0, 1))


def _steps(u: np.ndarray, rng: Rng) -> np.ndarray:
    count = int(rng.integers(3, 7))
    levels = np.concatenate([[0], rng.uniform(0.1, 1, count)])
    wanted = levels[np.minimum((u * (count + 0.7)).astype(int), count)]
    return _lagged(wanted / max(levels.max(), 1e-6), u, rng.uniform(0.025, 0.06))


def _lagged(wanted: np.ndarray, u: np.ndarray, lag: float) -> np.ndarray:
    """Twice a delay of first order, as air takes its time."""
    share = 1 - np.exp(-np.diff(u, prepend=0) / lag)
    for _ in range(2):
        out, state = np.empty_like(wanted), wanted[0]
        for k, (w, s) in enumerate(zip(wanted, share, strict=True)):
            state += s * (w - state)
            out[k] = state
        wanted = out
    return wanted


def _sinusoid(u: np.ndarray, rng: Rng) -> np.ndarray:
    return 0.5 - 0.5 * np.cos(
        2 * np.pi * rng.uniform(1.2, 3.5) * u + (rng.uniform(0, 1.5) if rng.random() < 0.3 else 0)
    )


def _ringing(u: np.ndarray, rng: Rng) -> np.ndarray:
    out = np.zeros_like(u)
    rate, damping = 2 * np.pi * rng.uniform(5, 10), rng.uniform(4, 9)
    for start, size in ((0.08, 1.0), (rng.uniform(0.5, 0.6), -rng.uniform(0.4, 1.0))):
        since = np.maximum(u - start, 0)
        out += size * (1 - np.exp(-damping * since) * np.cos(rate * since))
    return out / np.abs(out).max()


def _curl(u: np.ndarray, rng: Rng) -> np.ndarray:
    return np.clip(u / rng.uniform(0.75, 0.95), 0, 1) ** rng.uniform(0.9, 1.6)


def _swing(u: np.ndarray, rng: Rng) -> np.ndarray:
    return np.sin(2 * np.pi * rng.uniform(1.5, 4) * u + rng.uniform(0, 6)) * np.exp(-rng.uniform(0, 2) * u)


def _by_hand(u: np.ndarray, rng: Rng) -> np.ndarray:
    knots = np.cumsum(rng.normal(0, 1, 9)) * np.array([0, *np.ones(8)])
    smooth = np.interp(u, np.linspace(0, 1, 9), knots)
    width = len(u) // 12 * 2 + 1
    kernel = np.hanning(width + 2)[1:-1]
    smooth = np.convolve(np.pad(smooth, width // 2, mode="edge"), kernel / kernel.sum(), mode="valid")
    return (smooth - smooth.min()) / max(np.ptp(smooth), 1e-6)


MOTIONS: dict[str, tuple[Callable[[np.ndarray, Rng], np.ndarray], float]] = {
    "bends and returns": (_slow, 1.4), "steps": (_steps, 1.3), "sinusoid": (_sinusoid, 1.3), "bends and rings": (_ringing, 0.8),
    "curls": (_curl, 0.8), "swings": (_swing, 0.8), "moved by hand": (_by_hand, 0.6),
}  # fmt: skip


def motion(rng: Rng, count: int, *, both_ways: bool) -> Motion:
    """A motion over `count` frames; only what bends both ways swings."""
    names = [name for name in MOTIONS if both_ways or name != "swings"]
    weights = np.array([MOTIONS[name][1] for name in names])
    name = str(rng.choice(names, p=weights / weights.sum()))
    frames = np.arange(-PER_FRAME, count * PER_FRAME + 1) / PER_FRAME
    u = np.clip(frames / count, 0, 1)
    bent = MOTIONS[name][0](u, rng)
    if both_ways and name in ("sinusoid", "moved by hand") and rng.random() < 0.5:
        bent = (2 * bent - 1) * rng.uniform(0.6, 1)
    quick = np.gradient(np.gradient(bent)) / (np.abs(np.gradient(np.gradient(bent))).max() + 1e-12)
    alive = rng.uniform(0, 0.012) * np.sin(2 * np.pi * frames / rng.uniform(5, 14) + rng.uniform(0, 6))
    return Motion(name, frames, bent, rng.uniform(0, 0.05) * quick + alive)


def slower(given: Motion, by: float) -> Motion:
    """The same motion's first part, stretched over as many frames."""

    def stretched(what: np.ndarray) -> np.ndarray:
        return np.interp(given.frames / by, given.frames, what)

    return Motion(given.name, given.frames, stretched(given.bent), stretched(given.wobble))
