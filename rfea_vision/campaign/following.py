"""Whether the motion of a run follows its pressure: else it is the log of another run, a late clock, or a wrong sign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import bend_sign
from rfea_vision.campaign.tracked import motion_of, swing

if TYPE_CHECKING:
    import xarray as xr

_LOW_KPA = 0.5  # a pressure that changes by less stands still: soft actuators are driven with 10 to 500 kPa
# mm of the tip, or deg: a tube beside the one that was driven seemed to move by 0.008 mm, a few of its standard errors.
_STILL = 0.05
# Least share of the pressure's variance that a linear function of the tip's place explains up to half a second later (s). The share is
# 0.85 to 1.00 in the runs of a twin and of a real finger, and 0.26 for a staircase beside the log of a sum of sines.
_FOLLOWS, _LAGS_S = 0.5, np.arange(0.0, 0.51, 0.05)
# Longer delays (s): slow rubber, a long line, a log on another clock. At most a fifth of the run, as with more any two series agree.
_LATE_S, _LATE_SHARE = np.arange(0.6, 5.01, 0.1), 0.2
# No tube moves before its pressure. Leads (s) that are tried, up to half of a run:
_AHEAD_S, _AHEAD_SHARE = np.arange(0.2, 5.01, 0.1), 0.5
# A lead is doubted where the motion explains this share of the pressure's variance at it, and leaves at most this part of what it
# leaves at the best delay (delays in steps of so many s). Chosen: with right clocks 0.95 to 0.99 is explained without delay.
_TOLD_AHEAD, _UNTOLD, _FINE_S = 0.9, 0.5, 0.01
# Share of the frames that an offset puts outside of the log, from which the one of the other sign is tried: that of `sync`'s note.
_OUTSIDE = 0.02
_FEWEST = 20  # frames: of fewer a good fit may be chance
# Frames from which another order, or another rate, is judged; more do not change the answer. Chosen.
_ENOUGH_FRAMES = 1000
# Of the tip's distance from the clamp, or of 100 deg, by which no tube creeps at a constant pressure. Chosen.
_DRIVEN = 0.1
# Share of the pressure's variance that another order or rate must explain in addition: half a step between delays costs less.
_MORE = 0.02
# Least share of the chambers' pressures that is left when they are added with their signs. An antagonistic pair is driven by its
# difference, which leaves all. A real finger whose two chambers are inflated together had 0.06 left by opposite signs.
_CANCELLED = 0.2
_HARDLY = 0.1  # share of the strongest chamber's motion: the side of one that moves the tube by less cannot be told
# Shares of an angle's range. A first value nearer to zero than the first was set to zero, if its pressure should bend the tube by more
# than the second. Chosen: the noise of an angle is below the first, what friction and creep leave is below the second.
_SET_TO_ZERO, _SHOULD_BE = 0.02, 0.2
# Share of the highest pressure below which the tube is at rest, and an angle (deg) that is too large for a tube at rest: sensors count
# from the level (90) or from above (180). It must also be twice the range, as creep leaves less. Chosen.
_AT_REST, _FAR_DEG = 0.05, 60.0


@dataclass(frozen=True)
class Pair:
    """What moves (n, 1 or 2), an angle in deg or a tip in mm, its times (n,) in s on the log's clock, and the log (samples,)."""

    motion: FloatArray
    time_s: FloatArray
    log_s: FloatArray
    pressure_kPa: FloatArray

    @property
    def unit(self) -> str:
        """Of the motion."""
        return "deg" if self.motion.shape[1] == 1 else "mm"

    @property
    def swing_kPa(self) -> float:
        """How far the pressure goes."""
        return float(np.ptp(self.pressure_kPa))

    @property
    def lasts_s(self) -> float:
        """How long the motion lasts."""
        return float(np.ptp(self.time_s))

    @property
    def late_s(self) -> FloatArray:
        """Delays (s) beyond the usual ones that are tried for a run that lasts so long."""
        return _LATE_S[: np.searchsorted(_LATE_S, _LATE_SHARE * self.lasts_s)]

    @property
    def latest_s(self) -> float:
        """The longest delay (s) that such a run tells."""
        return min(_LATE_S[-1], _LATE_SHARE * self.lasts_s)

    def earlier_kPa(self, lag_s: float = 0.0) -> FloatArray:
        """The pressure (n,) so much earlier than each frame."""
        return np.interp(self.time_s - lag_s, self.log_s, self.pressure_kPa)

    def followed(self, lags_s: FloatArray) -> tuple[float | None, float, float]:
        """Share of the pressure that the motion explains linearly at the best of these lags, that lag (s), and the first slope.

        The share is None where the pressure stands still.
        """
        design = np.column_stack([self.motion, np.ones(len(self.motion))])
        best: tuple[float | None, float, float] = (None, 0.0, 0.0)
        for lag_s in lags_s:
            pressure = self.earlier_kPa(lag_s)
            if np.ptp(pressure) > _LOW_KPA:
                slopes = np.linalg.lstsq(design, pressure, rcond=None)[0]
                share = 1.0 - float(np.var(pressure - design @ slopes) / np.var(pressure))
                if best[0] is None or share > best[0]:
                    best = (share, float(lag_s), float(slopes[0]))
        return best

    def squares(self, lag_s: float) -> FloatArray:
        """(3,) sums of squares of an angle and of the pressure so much earlier, each about its mean, and of their products."""
        angle, pressure = self.motion[:, 0] - self.motion[:, 0].mean(), self.earlier_kPa(lag_s)
        pressure -= pressure.mean()
        return np.array([angle @ angle, pressure @ pressure, angle @ pressure])


def _seen(motion: FloatArray, time_s: FloatArray, log_s: FloatArray) -> NDArray[np.bool_]:
    """The frames (n,) that were measured while the log ran; none where they are too few to tell anything."""
    seen = (time_s >= log_s[0]) & (time_s <= log_s[-1]) & (np.isfinite(motion).all(axis=1) if len(motion) else False)
    return seen & (seen.sum() >= _FEWEST)


def pair_of(track: xr.Dataset, time_s: FloatArray, log_s: FloatArray, pressure_kPa: FloatArray) -> Pair | None:
    """What was measured of a run while its log ran, by the arguments of `of_pair`; None where it is too little to tell anything."""
    motion, _ = motion_of(track)
    seen = _seen(motion, time_s, log_s)
    return Pair(motion[seen], time_s[seen], log_s, pressure_kPa) if seen.any() else None


def of_pair(
    track: xr.Dataset,
    time_s: FloatArray,
    log_s: FloatArray,
    pressure_kPa: FloatArray,
    pushes_kPa: Mapping[str, FloatArray] | None = None,
    own_s: FloatArray | None = None,
    *,
    held: bool = False,
) -> list[str]:
    """Doubt that a log belongs to a run: a tube follows its pressure, and its motion explains most of it.

    `time_s` (frames,) are those of the frames on the log's clock, `log_s` and `pressure_kPa` (samples,) the log's; `pushes_kPa`
    of several chambers what each adds to that sum, with its sign; `own_s` (frames,) what a film tells of its times itself, where a rate
    was given; `held` whether the tube was let go by hand. Runs that are alike cannot be told apart by this.
    """
    motion, _ = motion_of(track)
    if len(motion) and not ((time_s >= log_s[0]) & (time_s <= log_s[-1])).any():
        both = f"its pictures are from {time_s[0]:.6g} to {time_s[-1]:.6g} s and its log from {log_s[0]:.6g} to {log_s[-1]:.6g} s"
        return [f"{both} by the clocks that are declared, and never meet; correct sync.value, or write sync.method: motion"]
    pair = pair_of(track, time_s, log_s, pressure_kPa)
    if pair is None:
        return []
    others = _other_times(time_s, own_s, _seen(motion, time_s, log_s))
    text = _at_rest(pair) or _cancelled(pair, pushes_kPa or {}) or _unfollowed(track, pair, others, pushes_kPa or {}, held=held)
    return [text] if text else []


def _unfollowed(
    track: xr.Dataset, pair: Pair, others: Mapping[str, FloatArray], pushes_kPa: Mapping[str, FloatArray], *, held: bool
) -> str:
    """Why a motion does not follow its pressure as it should; empty where it does."""
    share, _, slope = pair.followed(_LAGS_S)
    in_others = _in_other_times(pair, others, share or 0.0)
    if share is None:
        return in_others or ("" if held else _undriven(pair))
    if share < _FOLLOWS and len(pushes_kPa) > 1:
        each, against = _each_for_itself(pair, pushes_kPa)
        if each >= _FOLLOWS:  # it is the log of this run: levers that differ are for the fit to find, a sign is not
            follows = f"the motion follows the chambers to {100 * each:.0f} %, but {', '.join(against)} against the others"
            return f"{follows} by the signs that they have; is a sign the wrong way round?" if against else ""
    if text := in_others or _ahead(pair, share):
        return text
    late = ""
    if share < _FOLLOWS:
        at_once = f"the motion follows this pressure to {100 * max(share, 0.0):.0f} %"
        then, late_s, slope = pair.followed(pair.late_s)
        if then is None or then < _FOLLOWS:
            return f"{at_once} only; is it the log of another run?"
        late = (
            f"{at_once} at once and to {100 * then:.0f} % {late_s:.1f} s later; "
            "is one of the clocks late, or the log that of another run? A long line and slow rubber do so, too"
        )
    turned = _mirrored(track, pair) if pair.unit == "mm" else _angle_doubts(pair, slope)
    return "; ".join(filter(None, (late, turned)))


def _at_rest(pair: Pair) -> str:
    """Doubt the tube where a motion stands still and the pressure does not; else empty."""
    went = swing(pair.motion)
    if pair.swing_kPa <= _LOW_KPA or went >= _STILL:
        return ""
    still = f"what was tracked moves by {went:.2g} {pair.unit} only"
    return f"goes by {pair.swing_kPa:.3g} kPa and {still}; is it the right tube? 'rfea open' lets you point at it"


def _undriven(pair: Pair) -> str:
    """Doubt the column of a pressure that stands still while the tube goes far; else empty."""
    went = swing(pair.motion)
    if went < _DRIVEN * (float(np.linalg.norm(pair.motion, axis=1).max()) if pair.unit == "mm" else 100.0):
        return ""
    return (
        f"stays within {pair.swing_kPa:.2g} kPa of {np.mean(pair.pressure_kPa):.3g} kPa while the tube goes by {went:.3g} "
        f"{pair.unit}; is it the right column? Of a tube that is let go by hand, 'start' tells how it was held"
    )


def _cancelled(pair: Pair, pushes_kPa: Mapping[str, FloatArray]) -> str:
    """Doubt the signs of chambers that leave little of their pressures, where the tube moves; else empty."""
    each_kPa = sum(float(np.ptp(push)) for push in pushes_kPa.values())
    if each_kPa <= _LOW_KPA or pair.swing_kPa >= _CANCELLED * each_kPa or swing(pair.motion) < _STILL:
        return ""
    return (
        f"the chambers push with {each_kPa:.3g} kPa in all, of which their signs leave {pair.swing_kPa:.2g}, and the tube moves; "
        "do they bend it to the same side? Then give them the same sign"
    )


def _mirrored(track: xr.Dataset, pair: Pair) -> str:
    """Doubt the side to which a tip goes as the pressure rises, where `bends` of its track names the other; else empty."""
    outwards = -bend_sign(str(track.attrs.get("bends", "left"))) * pair.motion[:, 0]
    if not np.ptp(outwards) or float(np.corrcoef(outwards, pair.earlier_kPa())[0, 1]) >= -_FOLLOWS:
        return ""
    return (
        "the tube moves to the other side than actuator.bends says while the pressure rises; is the track mirrored, or the sign "
        "of the pressure turned?"
    )


def _angle_doubts(pair: Pair, kPa_per_deg: float) -> str:
    """Doubt sign and zero of an angle by its pressure; empty where both may be right."""
    if kPa_per_deg < 0 and not _rises(pair):
        first = (
            "the angle falls while the pressure rises; positive is where actuator.bends points: if the sensor counts the other way, or "
            "from the bent tube, give the pressure sign: -1"
        )
    else:
        first = _counted_from_the_start(pair, kPa_per_deg)
    return "; ".join(filter(None, (first, _counted_from_elsewhere(pair))))


def _ahead(pair: Pair, at_once: float) -> str:
    """Doubt the clocks where a motion tells far more of a later pressure than of those `at_once` or before; else empty."""
    told, lag_s, _ = pair.followed(-_AHEAD_S[: np.searchsorted(_AHEAD_S, _AHEAD_SHARE * pair.lasts_s)])
    if told is None or told < _TOLD_AHEAD or 1 - told > _UNTOLD * (1 - at_once):
        return ""
    longest_s = max(_LAGS_S[-1], pair.latest_s)
    late, _, _ = pair.followed(np.arange(0.0, longest_s, _FINE_S))  # a period ahead is a delay, too
    if 1 - told > _UNTOLD * (1 - (late or 0.0)):
        return ""
    return (
        f"the tube moves {-lag_s:.1f} s before this pressure (which it then follows to {100 * told:.0f} %, and to "
        f"{100 * max(at_once, 0.0):.0f} % at once); are the clocks right? sync.value is the log's clock less the camera's: is its sign "
        "turned?"
    )


def of_sign(track: xr.Dataset, time_s: FloatArray, log_s: FloatArray, pressure_kPa: FloatArray, value_s: float | None) -> str:
    """Doubt the sign of an offset `value_s` with which frames lie outside the log and with the other sign none do; else empty.

    The other arguments are those of `of_pair`. A log that began late may look like this, so the motion must follow its pressure, too,
    with the other sign alone.
    """
    turned_s = time_s - 2 * (value_s or 0.0)
    out, out_turned = (float(np.mean((times < log_s[0]) | (times > log_s[-1]))) for times in (time_s, turned_s))
    turned = pair_of(track, turned_s, log_s, pressure_kPa)
    if not value_s or out < _OUTSIDE or out_turned >= _OUTSIDE or turned is None:
        return ""
    pair = pair_of(track, time_s, log_s, pressure_kPa)
    told, told_turned = (0.0 if one is None else max(one.followed(_LAGS_S)[0] or 0.0, 0.0) for one in (pair, turned))
    if told_turned < _FOLLOWS or 1 - told_turned > _UNTOLD * (1 - told):
        return ""
    return (
        f"with sync.value {value_s:g} s {100 * out:.0f} % of the frames lie outside the log and the motion follows it to "
        f"{100 * told:.0f} %, with {-value_s:g} s {100 * out_turned:.0f} % do and it follows to {100 * told_turned:.0f} %; is its sign "
        "turned round? It is the log's clock less the camera's"
    )


def of_order(
    track: xr.Dataset, time_s: FloatArray, log_s: FloatArray, pressure_kPa: FloatArray, own_s: FloatArray | None = None
) -> str:
    """Doubt order or rate of the frames where motion and pressure could not be brought together; empty where neither is why.

    The arguments are those of `of_pair`, but that the clocks need not be one.
    """
    motion, _ = motion_of(track)
    seen = np.asarray(np.isfinite(motion).all(axis=1))
    if seen.sum() < _FEWEST:
        return ""
    pair = Pair(motion[seen], time_s[seen], log_s, pressure_kPa)
    return _in_other_times(pair, _other_times(time_s, own_s, seen), 0.0)


def _other_times(time_s: FloatArray, own_s: FloatArray | None, seen: NDArray[np.bool_]) -> dict[str, FloatArray]:
    """What the times (frames,) of those frames that were seen would be, were the film turned round or another rate right."""
    others = {"backwards": time_s[0] + time_s[-1] - time_s} | ({} if own_s is None else {"rate": own_s})
    return {name: times[seen] for name, times in others.items()}


def _in_other_times(pair: Pair, others: Mapping[str, FloatArray], at_once: float) -> str:
    """Doubt the order or the rate of the frames where a motion tells far more of a pressure in `others` (n,); else empty.

    However the clocks are shifted: of a run that looks the same from its end to its beginning nothing is said.
    """
    few = slice(None, None, max(1, len(pair.motion) // _ENOUGH_FRAMES))

    def told(times: FloatArray) -> float:
        most_s = replace(pair, time_s=times).latest_s
        some = replace(pair, motion=pair.motion[few], time_s=times[few])
        return some.followed(np.arange(-most_s, most_s + _LAGS_S[1], _LAGS_S[1]))[0] or 0.0

    shares = {name: told(times) for name, times in others.items()}
    best = max(shares, key=shares.__getitem__)
    declared = max(at_once, told(pair.time_s))
    if shares[best] < max(_TOLD_AHEAD, declared + _MORE) or 1 - shares[best] > _UNTOLD * (1 - declared):
        return ""
    follows = f"the motion follows this pressure to {100 * max(declared, 0.0):.0f} %, and to {100 * shares[best]:.0f} %"
    if best == "backwards":
        return f"{follows} from its last picture to its first; does the film, or the track, run backwards?"
    return f"{follows} by the times that the film tells of itself; is video.rate right? Leave it out unless this is slow motion"


def _counted_from_the_start(pair: Pair, kPa_per_deg: float) -> str:
    """Doubt the zero of an angle that begins at zero where the pressure does not; else empty."""
    angle_deg, first_kPa = pair.motion[:, 0], float(pair.earlier_kPa()[0])
    bent_deg = first_kPa / kPa_per_deg if kPa_per_deg > 0 else 0.0
    if abs(angle_deg[0]) > _SET_TO_ZERO * np.ptp(angle_deg) or bent_deg < _SHOULD_BE * np.ptp(angle_deg):
        return ""
    return (
        f"the angle begins at {angle_deg[0]:.2g} deg where the pressure is {first_kPa:.3g} kPa, which elsewhere bends it by "
        f"{bent_deg:.2g} deg; is it counted from the first frame? Then fit with --angle-zero {bent_deg:.2g}deg"
    )


def _counted_from_elsewhere(pair: Pair) -> str:
    """Doubt the zero of an angle that is far from it wherever the pressure rests; else empty."""
    angle_deg, pressure_kPa = pair.motion[:, 0], np.abs(pair.earlier_kPa())
    rests = pressure_kPa < _AT_REST * pressure_kPa.max()
    if not rests.any() or abs(at_rest := float(np.median(angle_deg[rests]))) < max(_FAR_DEG, 2 * float(np.ptp(angle_deg[~rests]))):
        return ""
    return (
        f"the angle is {at_rest:.3g} deg where the pressure rests, and 0 is where the unloaded tube points; is it counted from another "
        "direction? Write the column from there on"
    )


def _rises(pair: Pair) -> bool:
    """Whether an angle may as well rise with a pressure, at whatever lag: of a sine, half a period later it does."""
    each = (pair.followed(np.array([lag_s])) for lag_s in (*_LAGS_S, *pair.late_s))
    return any(share is not None and share >= _FOLLOWS and slope > 0 for share, _, slope in each)


def together(runs: Sequence[Pair]) -> str:
    """Doubt the sign of an angle by all runs at once, where one alone, half a swing later, would do with the other; else empty."""
    if len(runs) < 2:
        return ""
    shortest = min(runs, key=lambda run: run.lasts_s)
    best = {1.0: (0.0, 0.0), -1.0: (0.0, 0.0)}  # by the sign of the lever: share of the angle's variance, and lag
    for lag_s in (*_LAGS_S, *shortest.late_s):
        sums = np.sum([run.squares(float(lag_s)) for run in runs], axis=0)
        if min(sums[0], sums[1]) > 0:
            sign = 1.0 if sums[2] >= 0 else -1.0
            best[sign] = max(best[sign], (float(sums[2] ** 2 / (sums[0] * sums[1])), float(lag_s)))
    (falls, lag_s), (rises, _) = best[-1.0], best[1.0]
    if falls < _FOLLOWS or rises >= _FOLLOWS:
        return ""
    return (
        f"in all {len(runs)} runs together the angle falls{f' {lag_s:.1f} s after' * bool(lag_s) or ' as'} the pressure rises (that "
        f"tells {100 * falls:.0f} % of it, the other sign {100 * rises:.0f} % at whatever delay); positive is where actuator.bends "
        "points: if the sensor counts the other way, or from the bent tube, give the pressure of every run sign: -1"
    )


def _each_for_itself(pair: Pair, pushes_kPa: Mapping[str, FloatArray]) -> tuple[float, list[str]]:
    """Share of a motion that chambers explain, each with a lever of its own, and which bend against the strongest."""
    centred = pair.motion - pair.motion.mean(axis=0)
    bend = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    best, against = 0.0, list[str]()
    for lag_s in _LAGS_S:
        pushes = np.column_stack([replace(pair, pressure_kPa=push).earlier_kPa(lag_s) for push in pushes_kPa.values()])
        pushes -= pushes.mean(axis=0)
        levers = np.linalg.lstsq(pushes, bend, rcond=None)[0]
        share = 1.0 - float(np.var(bend - pushes @ levers) / np.var(bend))
        if share > best:
            moves = levers * pushes.std(axis=0)
            leads = moves[np.abs(moves).argmax()]
            odd = moves / leads < -_HARDLY
            best, against = share, [f"'{name}'" for name, is_odd in zip(pushes_kPa, odd, strict=True) if is_odd]
    return best, against
