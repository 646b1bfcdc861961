"""The offset of a pressure that changes slowly, from the bend alone.

Of a slow pressure the band in which `rfea_vision.sync.motion` compares holds next to nothing but noise, and creep and a lag lead an
offset astray there by more than its error says. Below it the tube is at
rest at every instant: the pressure is what stiffness makes of the bend b,

    p(t + offset) = c0 + c1 b + c2 b^2,

and the offset shows where either begins, ends or turns. A tube's own lag is not told from an offset there, so that the offset is
told by an interval: all that explain the pressure as well as the best (F test of one more unknown, with as many independent values
as the residuals' correlation in time leaves), by this law and with a third power or creep beside it. Creep makes the bend late, never
early. So does what rubs, which looks like an offset on the way out and back alike: what bodies usually rub is in the standard error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import f as fisher

from rfea_vision.arrays import FloatArray
from rfea_vision.errors import DataError
from rfea_vision.sync.alignment import Alignment
from rfea_vision.sync.ambiguity import check_direction, short_log, slow_note
from rfea_vision.sync.filters import LOW_HZ, FilteredMotion, Target, gauss
from rfea_vision.sync.sections import CREEP_S

MOST_IN_BAND = 0.07  # of the pressure's range, at any instant: a step leaves half there, a ramp over 1 s 0.07 and over 4 s 0.02
MOST_OF_BEND = 0.1  # of the bend's range: the same, with room for a film's noise
LEAST_EXPLAINED = 0.9  # any two steps of other runs share half, and slow curves have little more than two ends to agree in
LEAST_COVERED = 0.5  # of the film
LEAST_MOVING = 0.05  # of the pressure's variance in the whole log, as in `motion.search`
STEP_S, MOST_SAMPLES = 0.01, 400
FEWEST = 2.0  # independent residuals beyond the law's unknowns
# Of the pressure's range, 1 s.d., chosen: rubber, bellows and pleats take up a few hundredths to a tenth more on the way out than back.
RUBS = 0.05
LAG_S = 1 / (10 * np.sqrt(12))  # of the tube itself: anything up to the inverse of a slow one's first mode, in rad/s


def is_slow(seen: FilteredMotion, target: Target) -> bool:
    """Whether the band holds next to nothing of the pressure, nor of the bend."""
    bend = _bend(seen)
    fast = bend - gauss(bend, seen.rate, LOW_HZ)
    moves = float(np.max(np.abs(fast[seen.solid]), initial=0.0))
    pressed = float(np.max(np.abs(target.values)))
    slow = pressed < MOST_IN_BAND * float(np.ptp(target.smooth)) and moves < MOST_OF_BEND * float(np.ptp(bend))
    return slow and bool(seen.solid.any())


def _bend(seen: FilteredMotion) -> FloatArray:
    """Bend at the tip (n,), smoothed as the pressure is."""
    bend = seen.raw.sum(axis=1) if seen.motion.modal else seen.raw[:, 0]
    return gauss(gauss(bend, seen.rate, 2 * seen.high), seen.rate, seen.high)


def align_by_bend(seen: FilteredMotion, target: Target, *, experiment: str, bends: str) -> Alignment:
    """Offset (s) of a slow pressure, the middle of all that explain it alike, and their spread as its standard error.

    Raises
    ------
    DataError
        If the bend explains too little of the pressure, or so much at any offset that none can be told.
    """
    thin = slice(None, None, max(len(seen.grid) // MOST_SAMPLES, 1))
    bend = _bend(seen)
    decay = np.exp(-1 / (CREEP_S * seen.rate))
    crept = np.asarray(lfilter([1 - decay], [1.0, -decay], bend, zi=decay * bend[:1])[0], dtype=float)
    times, solid = seen.grid[thin], seen.solid[thin]
    law = np.column_stack([bend, bend**2])[thin]
    reach = (1 - LEAST_COVERED) * (times[-1] - times[0])
    offsets = np.arange(target.first - times[0] - reach, target.last - times[-1] + reach, STEP_S)
    shares = _shares(law, times, solid, target, offsets)
    covered = np.array([np.mean(target.inside(times[solid] + offset)) for offset in offsets], dtype=float)
    best = int(np.argmax(shares * covered)) if len(offsets) else 0
    told = float(shares[best]) if len(offsets) else 0.0
    if told < LEAST_EXPLAINED:
        against = int(np.argmin(shares * covered)) if len(offsets) else 0
        if len(offsets) and shares[against] * covered[against] < -LEAST_EXPLAINED:
            use = solid & target.inside(times + offsets[against])
            check_direction(law[use, 0], _values(target, times[use], float(offsets[against])), experiment=experiment, bends=bends)
        why = short_log(times, target.time, LEAST_COVERED) or "check that motion and log belong together"
        raise DataError(
            f"{experiment}: sync: the pressure changes slowly, and the bend explains only {100 * max(told, 0.0):.0f} % of it at any "
            f"offset, which is little for so slow a change; {why}, or use sync.method offset"
        )
    cubic, creeping = np.column_stack([law, bend[thin] ** 3]), np.column_stack([law, crept[thin]])
    power = np.array([_power(target, times[solid & target.inside(times + offset)], offset) for offset in offsets], dtype=float)
    comparable = (covered >= LEAST_COVERED) & (power >= 0.5 * power[best])
    alike, possible = np.zeros((2, len(offsets)), dtype=bool)
    for columns, late in ((law, False), (cubic, False), (creeping, True)):
        near, far = _alike(columns, times, solid, target, offsets, covered, power, late=late)
        alike, possible = alike | near, possible | (far & comparable)
    places = np.flatnonzero(possible)
    ends = comparable & ~(np.append(comparable[1:], False) & np.append(False, comparable[:-1]))
    low, high = float(offsets[places[0]]), float(offsets[places[-1]])
    apart_s = float(np.max(np.diff(offsets[places]), initial=0.0))
    if np.any(possible & ends) or apart_s > 1 / LOW_HZ:
        raise DataError(
            f"{experiment}: sync: the pressure changes too slowly to tell the offset: the bend explains it alike at {low:.2f} s and at "
            f"{high:.2f} s; let film and log begin before the pressure rises and end after it rests, begin the run with a step, or use "
            "sync.method led, trigger or offset"
        )
    low, high = float(offsets[alike].min()), float(offsets[alike].max())
    error = float(np.linalg.norm([(high - low) / (2 * 1.96), LAG_S, _moved_by_rubbing(target, times[solid] + offsets[best])]))
    curve = (offsets, np.maximum(shares * covered, 0.0))
    note = slow_note(high - low) if high > low else ""
    return Alignment(0.5 * (low + high), error, explained=told, curve=curve, note=note)


def _values(target: Target, times: FloatArray, offset: float) -> FloatArray:
    return np.interp(times + offset, target.time, target.smooth)


def _moved_by_rubbing(target: Target, log_s: FloatArray) -> float:
    """By how much (s) least squares move an offset for a pressure that leads by `RUBS` of its range on either way, at times (n,) s."""
    slope = np.interp(log_s, target.time, target.smooth_slope)
    return RUBS * float(np.ptp(target.smooth)) * float(np.sum(np.abs(slope)) / max(float(slope @ slope), 1e-30))


def _power(target: Target, times: FloatArray, offset: float) -> float:
    return float(np.var(_values(target, times, offset))) if len(times) else 0.0


def _shares(
    columns: FloatArray,
    times: FloatArray,
    solid: NDArray[np.bool_],
    target: Target,
    offsets: FloatArray,
    *,
    late: bool = False,
) -> FloatArray:
    """Share (k,) of the pressure that columns (n, c) explain within the log; negative where the first falls as it rises.

    0 where too little of the film lies within the log, or the pressure hardly moves. A last column that is `late` counts where its sign
    makes the bend follow the pressure.
    """
    least = LEAST_MOVING * float(np.var(target.smooth))
    shares = np.zeros(len(offsets))
    for k, offset in enumerate(offsets):
        use = solid & target.inside(times + offset)
        if use.sum() < max(LEAST_COVERED * solid.sum(), 4 * columns.shape[1]):
            continue
        y, x = _values(target, times[use], offset), columns[use]
        y, x = y - y.mean(), x - x.mean(axis=0)
        if np.mean(y**2) < least:
            continue
        q, r = np.linalg.qr(x / (np.linalg.norm(x, axis=0) + 1e-12))
        along = q.T @ y
        if late and along[-1] * r[-1, -1] > 0:  # the sign of the last coefficient
            along = along[:-1]
        shares[k] = float(along @ along / (y @ y)) * (1 if x[:, 0] @ y > 0 else -1)
    return shares


def _alike(
    columns: FloatArray,
    times: FloatArray,
    solid: NDArray[np.bool_],
    target: Target,
    offsets: FloatArray,
    covered: FloatArray,
    power: FloatArray,
    *,
    late: bool,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which offsets (k,) explain the pressure as well as the best one, by the columns (n, c) of a law: near it, and anywhere.

    Near it the noise is the same, and one unknown is tested. Farther away other noise of the log meets the same film: there the
    residuals' mean squares are compared, in kPa^2 by the pressure's `power` (k,), as a film that is half outside of the log has half
    of a ramp to explain.
    """
    shares = _shares(columns, times, solid, target, offsets, late=late)
    best = int(np.argmax(shares * covered))
    use = solid & target.inside(times + offsets[best])
    x = np.column_stack([np.ones(int(use.sum())), columns[use]])
    y = _values(target, times[use], offsets[best])
    rest = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    lags = np.correlate(rest, rest, "full")[len(rest) - 1 :] / max(float(rest @ rest), 1e-30)
    until = int(np.argmax(lags < 0)) or len(lags)
    alone = len(rest) / (1 + 2 * float(lags[1:until].sum()))
    freedom = max(float(alone) - x.shape[1], FEWEST)
    left = 1 - shares
    near = left <= left[best] * (1 + float(fisher.ppf(0.95, 1, freedom)) / freedom)
    far = left * power <= left[best] * power[best] * float(fisher.ppf(0.95, freedom, freedom))
    return near, near | (far & (shares >= LEAST_EXPLAINED))
