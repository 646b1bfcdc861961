"""The offset from pulses that both clocks saw: a lamp in the picture, or a logged trigger."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts import Track
from rfea_vision.errors import DataError
from rfea_vision.sync.motion import Alignment

FloatArray = NDArray[np.float64]
_NOTHING = (np.empty(0), np.empty(0))


def switch_times(time_s: FloatArray, signal: FloatArray, *, rising: bool = True) -> FloatArray:
    """Times at which a two-level signal crosses its middle, between samples by interpolation."""
    low, high = np.nanpercentile(signal, [5, 95])
    if not high - low > 1e-9:
        low, high = np.nanmin(signal), np.nanmax(signal)
    above = signal > 0.5 * (low + high)
    change = np.flatnonzero(above[1:] & ~above[:-1] if rising else ~above[1:] & above[:-1])
    share = (0.5 * (low + high) - signal[change]) / (signal[change + 1] - signal[change])
    return time_s[change] + np.clip(share, 0, 1) * (time_s[change + 1] - time_s[change])


def align_by_trigger(track: Track, log_time_s: FloatArray, signal: FloatArray, *, experiment: str) -> Alignment:
    """One pulse per frame, or one at the first frame."""
    pulses = switch_times(log_time_s, signal)
    frames = track.time_s
    step = float(np.median(np.diff(log_time_s)))
    if len(pulses) == 0:
        raise DataError(f"{experiment}: sync: the trigger column never switches; check sync.channel")
    if len(pulses) >= 0.5 * len(frames) and len(frames) > 3:
        count = min(len(pulses), len(frames))
        if abs(len(pulses) - len(frames)) > 0.02 * len(frames) + 1:
            raise DataError(
                f"{experiment}: sync: {len(pulses)} trigger pulses for {len(frames)} frames; frames were lost, use sync.method motion"
            )
        return _line(frames[:count], pulses[:count], step)
    return Alignment(float(pulses[0] - frames[0]), step / np.sqrt(12), 0.0, 0.0, 1.0, _NOTHING, "")


def align_by_lamp(track: Track, log_time_s: FloatArray, signal: FloatArray, *, experiment: str) -> Alignment:
    """Pair the lamp's switching in the picture with that in the log; the pattern of intervals decides which is which."""
    if "lamp" not in track.dataset:
        raise DataError(
            f"{experiment}: sync: the track has no lamp brightness; give sync.led as a box in pixels and track again"
        )
    lamp = track.dataset["lamp"].values
    seen = np.sort(np.concatenate([switch_times(track.time_s, lamp), switch_times(track.time_s, lamp, rising=False)]))
    logged = np.sort(np.concatenate([switch_times(log_time_s, signal), switch_times(log_time_s, signal, rising=False)]))
    frame = float(np.median(np.diff(track.time_s)))
    if len(seen) == 0 or len(logged) == 0:
        where = "picture" if len(seen) == 0 else "log"
        raise DataError(f"{experiment}: sync: the lamp never switches in the {where}; check sync.led and sync.channel")
    best: tuple[float, float] | None = None
    for a in seen[: min(len(seen), 60)]:
        for b in logged:
            shifted = seen + (b - a)
            gaps = np.abs(shifted[:, None] - logged[None, :]).min(axis=1)
            cost = float(np.minimum(gaps, 3 * frame).sum())
            if best is None or cost < best[0]:
                best = cost, b - a
    assert best is not None
    nearest = np.abs(seen[:, None] + best[1] - logged[None, :]).argmin(axis=1)
    near = np.abs(seen + best[1] - logged[nearest]) < 1.5 * frame
    if near.sum() < max(1, 0.5 * len(seen)):
        raise DataError(f"{experiment}: sync: lamp and log do not switch in the same pattern; check sync.channel")
    return _line(seen[near], logged[nearest][near], frame)


def _line(camera: FloatArray, log: FloatArray, step: float) -> Alignment:
    """Offset and drift of matched times."""
    difference = log - camera
    if len(camera) < 8:
        return Alignment(float(difference.mean()), step / np.sqrt(12 * len(camera)), 0.0, 0.0, 1.0, _NOTHING, "")
    middle = camera.mean()
    x = np.column_stack([np.ones(len(camera)), camera - middle])
    solution, *_ = np.linalg.lstsq(x, difference, rcond=None)
    spread = max(float(np.std(difference - x @ solution)), step / np.sqrt(12) / 3)
    covariance = spread**2 * np.linalg.inv(x.T @ x)
    drift = float(solution[1]) if abs(solution[1]) > 3 * np.sqrt(covariance[1, 1]) else 0.0
    offset = float(difference.mean()) - drift * middle
    return Alignment(
        offset, float(np.sqrt(covariance[0, 0])), 1e6 * drift, 1e6 * float(np.sqrt(covariance[1, 1])), 1.0, _NOTHING, ""
    )
