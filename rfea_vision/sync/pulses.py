"""The offset from pulses that both clocks saw: a lamp in the picture, or a logged trigger."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Track
from rfea_vision.errors import DataError, InputError, RfeaError
from rfea_vision.scatter import scatter
from rfea_vision.sync.alignment import Alignment

LOW, HIGH = 0.35, 0.65  # of the swing: a signal has switched once it has passed both
LEAST_CONTRAST = 6.0  # swing over the noise from frame to frame
FLASH_CONTRAST = 15.0  # the same for single flashes: the largest of many noisy frames is no flash
MOST_SEEDS = 60  # pulses from which an offset is tried: more repeat the same pattern
FEWEST_SEEN = 3  # switches in common where the log covers only a part of the film
SURE_FRAMES = 0.4  # so near to a pulse, and so sure, the motion must be to tell which one it is
LATE_FRAMES = 0.35  # a frame that lies so far from its pulse belongs to another


def switch_times(time_s: FloatArray, signal: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Times at which a two-level signal switches, between samples by interpolation, and whether up (1) or down (-1).

    time_s, signal : (samples,); samples that are not finite are left out.
    Noise that crosses the middle without leaving its level does not count. Empty for a signal without two levels.
    """
    good = np.isfinite(signal)
    time, value = time_s[good], signal[good]
    if len(value) < 3:
        return np.empty(0), np.empty(0, dtype=np.int64)
    low, high = np.percentile(value, [1, 99])
    noise = float(scatter(np.diff(value))) / np.sqrt(2)
    if not high - low > max(LEAST_CONTRAST * noise, 1e-9):  # flashes that are seldom on lie beyond the percentiles
        low, high = value.min(), value.max()
        noise *= FLASH_CONTRAST / LEAST_CONTRAST
    if not high - low > max(LEAST_CONTRAST * noise, 1e-9):
        return np.empty(0), np.empty(0, dtype=np.int64)
    level = (value - low) / (high - low)
    state = np.where(level > HIGH, 1, np.where(level < LOW, -1, 0))
    known = np.flatnonzero(state != 0)
    turns = np.flatnonzero(np.diff(state[known]) != 0)
    before, after = known[turns], known[turns + 1]
    times, kinds = [], []
    for a, b in zip(before, after, strict=True):
        crossing = a + int(np.argmax((level[a + 1 : b + 1] > 0.5) == (state[b] > 0)))
        share = (0.5 - level[crossing]) / (level[crossing + 1] - level[crossing])
        times.append(time[crossing] + np.clip(share, 0, 1) * (time[crossing + 1] - time[crossing]))
        kinds.append(state[b])
    return np.array(times), np.array(kinds, dtype=np.int64)


def align_by_trigger(
    track: Track,
    log_time_s: FloatArray,
    signal: FloatArray,
    *,
    experiment: str,
    by_motion: Callable[[], Alignment] | None = None,
) -> Alignment:
    """One pulse per frame, or one at the first frame.

    log_time_s, signal : (samples,) clock of the log, and the trigger's level in any unit; a pulse begins where it rises

    Where evenly spaced pulses begin before the film, pulses and frames alone do not say which pulse is the first frame's: that is
    decided by the offset that `by_motion` finds, where it is given, which need only be right to a fraction of a frame.

    Raises
    ------
    InputError
        If there is no pulse.
    DataError
        If pulses and frames do not belong together.
    """
    times, kinds = switch_times(log_time_s, signal)
    pulses, frames = times[kinds > 0], track.time_s
    step = float(np.median(np.diff(log_time_s)))
    if len(pulses) == 0:
        raise InputError(f"{experiment}: sync: the trigger column never switches; check sync.channel")
    if len(pulses) < 0.5 * len(frames) or len(frames) <= 3:
        note = ""
        if len(pulses) > 1:
            apart = float(np.min(np.diff(pulses)))
            note = f"{len(pulses)} pulses, the nearest {apart:.2f} s apart: the first was taken for the start of the film"
        return Alignment(float(pulses[0] - frames[0]), step / np.sqrt(12), note=note)
    if len(pulses) == len(frames):  # unless as many frames were dropped as pulses came before the film
        found = _fitting(frames, pulses, step)
        if found is not None:
            return found
    # Frames were dropped after their pulse, or pulses go on: the first belongs to the first, time stamps tell the rest.
    matched = _matched(frames, pulses, 0, step)
    if matched is not None:
        found, last = matched
        said = f"{len(pulses) - len(frames)} of {len(pulses)} pulses have no frame; "
        after = len(pulses) - 1 - last
        before = _pulses_before(by_motion, found, pulses, after) if after else 0
        if before is None:
            said += (
                f"the first pulse was taken for the first frame, and {after} come after the last; if pulses began before "
                f"the film, the offset is too small, by {float(np.mean(np.diff(pulses))):.3g} s for each"
            )
        elif after:
            found, last = _matched(frames, pulses, before, step) or matched
            said += f"by the motion, {before} came before the film and {len(pulses) - 1 - last} after it"
        else:
            said += "the time stamps of the frames told which"
        return replace(found, note=said)
    raise DataError(
        f"{experiment}: sync: {len(pulses)} trigger pulses for {len(frames)} frames, and their times do not tell which "
        "belong together; use sync.method motion"
    )


def _matched(frames: FloatArray, pulses: FloatArray, first: int, step: float) -> tuple[Alignment, int] | None:
    """Each frame beside its pulse, pulse number `first` beside the first frame; the last frame's pulse. None: no match.

    By time alone; or, as clocks may drift apart by whole frames, from each pulse to the next by the time between the frames.
    """

    def nearest(times: FloatArray) -> NDArray[np.int64]:
        after = np.clip(np.searchsorted(pulses, times), 1, len(pulses) - 1)
        return after - (times - pulses[after - 1] < pulses[after] - times)

    def by_steps() -> NDArray[np.int64]:
        at = [first]
        for apart in np.diff(frames):
            at.append(int(nearest(pulses[at[-1]] + apart)))
        return np.array(at)

    for choose in (lambda: nearest(frames + pulses[first] - frames[0]), by_steps):
        chosen = choose()
        found = _fitting(frames, pulses[chosen], step) if len(np.unique(chosen)) == len(frames) else None
        if found is not None:
            return found, int(chosen[-1])
    return None


def _fitting(frames: FloatArray, pulses: FloatArray, step: float) -> Alignment | None:
    """The line through frames and their pulses; None where one of them lies so far from it that it belongs to another."""
    found = _line(frames, pulses, step)
    late = pulses - (frames * (1 + 1e-6 * found.drift_ppm) + found.offset_s)
    return found if np.abs(late).max() < LATE_FRAMES * float(np.median(np.diff(frames))) else None


def _pulses_before(
    by_motion: Callable[[], Alignment] | None, found: Alignment, pulses: FloatArray, most: int
) -> int | None:
    """How many pulses came before the film, by the motion; None where it cannot tell one pulse from the next."""
    if by_motion is None:
        return None
    try:
        moved = by_motion()
    except RfeaError:
        return None
    apart = float(np.median(np.diff(pulses)))
    share = (moved.offset_s - found.offset_s) / apart
    number = round(share)
    sure = 2.0 * moved.offset_stderr_s < SURE_FRAMES * apart and abs(share - number) < SURE_FRAMES
    return number if sure and 0 <= number <= most else None


def align_by_lamp(track: Track, log_time_s: FloatArray, signal: FloatArray, *, experiment: str) -> Alignment:
    """Pair the switches of a lamp in the pictures with those in the log, by the pattern of their intervals.

    log_time_s, signal : (samples,) clock of the log, and the lamp's level in any unit

    Raises
    ------
    InputError
        If the lamp is not seen to switch, or the patterns differ.
    DataError
        If the pattern repeats and fits at several places.
    """
    if "lamp" not in track.dataset:
        raise InputError(
            f"{experiment}: sync: the track has no lamp brightness; give sync.box, the lamp's box in pixels, and track again"
        )
    seen, seen_kinds = switch_times(track.time_s, track.dataset["lamp"].values.astype(float))
    logged, logged_kinds = switch_times(log_time_s, signal)
    if len(seen) == 0:
        raise InputError(f"{experiment}: sync: the lamp never switches in the picture; check sync.box")
    if len(logged) == 0:
        raise InputError(f"{experiment}: sync: the lamp never switches in the log; check sync.channel")
    # Either clock knows a switch to its own step.
    frame = float(max(np.median(np.diff(track.time_s)), np.median(np.diff(log_time_s))))
    best: tuple[float, float, int] | None = None
    tried: list[tuple[float, float]] = []
    for polarity in (1, -1):  # some drivers log 0 for a lit lamp
        for a, kind in zip(seen[:MOST_SEEDS], seen_kinds[:MOST_SEEDS], strict=True):
            for b in logged[logged_kinds == polarity * kind]:
                cost = _mismatch(seen + (b - a), polarity * seen_kinds, logged, logged_kinds, frame)
                if polarity == 1 or best is None or cost < 0.5 * best[0]:
                    tried.append((cost, float(b - a)))
                    if best is None or cost < best[0]:
                        best = cost, float(b - a), polarity
    assert best is not None
    _refuse_ambiguous(tried, best[0], best[1], frame, len(seen), experiment)
    shifted = seen + best[1]
    distance = np.abs(shifted[:, None] - logged[None, :])
    distance[:, :] = np.where((best[2] * seen_kinds)[:, None] == logged_kinds[None, :], distance, np.inf)
    nearest = distance.argmin(axis=1)
    near = distance[np.arange(len(seen)), nearest] < 1.5 * frame
    within = int(np.sum((shifted > log_time_s[0]) & (shifted < log_time_s[-1])))
    if near.sum() < max(0.5 * within, 1 if within == len(seen) else FEWEST_SEEN):
        raise InputError(f"{experiment}: sync: lamp and log do not switch in the same pattern; check sync.channel")
    return _line(seen[near], logged[nearest[near]], frame)


def _mismatch(
    shifted: FloatArray, kinds: NDArray[np.int64], logged: FloatArray, logged_kinds: NDArray[np.int64], frame: float
) -> float:
    """Frames by which the seen switches lie beside logged ones of their kind, three at most each."""
    total = 0.0
    for kind in (1, -1):
        ours, theirs = shifted[kinds == kind], logged[logged_kinds == kind]
        if len(theirs) == 0:
            total += 3.0 * len(ours)
            continue
        after = np.clip(np.searchsorted(theirs, ours), 1, max(len(theirs) - 1, 1))
        gap = np.minimum(np.abs(ours - theirs[np.minimum(after, len(theirs) - 1)]), np.abs(ours - theirs[after - 1]))
        total += float(np.minimum(gap / frame, 3.0).sum())
    return total


def _refuse_ambiguous(
    tried: list[tuple[float, float]], least: float, offset: float, frame: float, count: int, experiment: str
) -> None:
    """Refuse a pattern that fits at several offsets: of a lamp that blinks evenly, or once where the log switches often."""
    rivals = [where for cost, where in tried if abs(where - offset) > 4 * frame and cost <= least + 0.5 * count]
    if rivals:
        other = min(rivals, key=lambda where: abs(where - offset))
        raise DataError(
            f"{experiment}: sync: the lamp's pattern fits at offsets of {offset:.3f} s and {other:.3f} s alike; let it "
            "blink unevenly, or use sync.method trigger or motion"
        )


def _line(camera: FloatArray, log: FloatArray, step: float) -> Alignment:
    """Offset and drift of matched times; the standard error of the offset is that at camera time 0."""
    difference = log - camera
    if len(camera) < 8:
        return Alignment(float(difference.mean()), step / np.sqrt(12 * len(camera)))
    middle = camera.mean()
    x = np.column_stack([np.ones(len(camera)), camera - middle])
    solution, *_ = np.linalg.lstsq(x, difference, rcond=None)
    spread = max(float(np.std(difference - x @ solution, ddof=2)), step / np.sqrt(12) / 3)
    covariance = spread**2 * np.linalg.inv(x.T @ x)
    drifts = abs(solution[1]) > 3 * np.sqrt(covariance[1, 1])
    drift = float(solution[1]) if drifts else 0.0
    offset = float(difference.mean()) - drift * middle
    variance = covariance[0, 0] + (covariance[1, 1] * middle**2 if drifts else 0.0)
    return Alignment(offset, float(np.sqrt(variance)), 1e6 * drift, 1e6 * float(np.sqrt(covariance[1, 1])))
