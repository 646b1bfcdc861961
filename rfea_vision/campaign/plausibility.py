"""Doubts about data that are readable, and probably not what was meant: told before anything is fitted to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray, stretches
from rfea_vision.artefacts.measurement import TENSION_kPa, bend_sign
from rfea_vision.campaign.sensors import of_mixed, of_pauses, of_standstill, of_tension
from rfea_vision.campaign.tracked import across, begins_at, lengths, motion_of, swing, valid_rows
from rfea_vision.scatter import third_difference_noise
from rfea_vision.units import counted

if TYPE_CHECKING:
    import xarray as xr

    from rfea_vision.readers.pressure import PressureLog

SAME_RATE = 0.02  # share by which two rates differ and are the same: NTSC's 29.97 for 30, and rounding, are far below
SLOW_MOTION = 1.5  # least ratio of filming to playing: cameras that film 50 and play 25 have 2
# Highest pressures (kPa) that are doubted. Soft actuators are driven with 10 to 500 kPa: a factor of six is left to both sides, and the
# usual slips are factors of 1000 (Pa, ms, m) or 57 (radians).
_HIGH_KPA, _LOW_KPA = 3000.0, 0.5
# pressure of the atmosphere (kPa) from 2,000 m up to a high at sea level: what an absolute sensor reads at rest
_AIR_kPa = (80.0, 110.0)
_VACUUM_KPA = -101.325  # no gauge pressure lies below
_UNLIKE = 50.0  # ratio of the highest pressures of two runs: that of bar and kPa is 100
# ratio of the durations of log and pictures: with a wrong unit it is 60 or 1000, and two parts of one run are not that unlike
_TOO_LONG = 50.0
# the same of a track whose times count in ones: stills are taken once a second while the log runs
_COUNTED = 2.0
# s of the units in which a log that seems too short may count; the name '' stands for pictures in ms
_LONG_UNITS = {"min": 60.0, "": 1000.0, "hour": 3600.0, "day": 86400.0}
# Ratio of two runs' motions per kPa. The smallest slip between units is 6.9 (psi for kPa); a tube that softens as it bends moves twice
# as far per kPa, and runs in which the tube moves as far rarely have pressures that differ by half of this.
_OTHERWISE = 4.0
# distance of the tip from the clamp, in lengths of the tube: a soft arm stretches a little, and markers stand a little off
_REACH = 1.15
_USUAL = 99  # percentile of those distances that counts: single leaps of a track tell no length
# share of its length by which the tip of a driven tube moves to its side; a third of it to the other side may be how it hangs. Chosen.
_ASIDE = 0.2
# s, and share of the film, that the picture must stand still: slips of a recorder last for a few pictures
_STANDS_S, _STANDS = 0.5, 0.1
# fewest pictures from which motion can be told from noise
_FEW_PICTURES = 10
# s, and share of the film, by which the last picture may come before the announced end: a few pictures, and sound that goes on
_TAIL_S, _TAIL = 0.25, 0.02
# usual steps in the times of pictures that are a gap; where more than this share of the steps are, the rate itself varies
_GAP_STEPS, _GAPS = 4.0, 0.1
# units in which a track may be given in place of mm, in mm; their ratios are told apart by a length that is known to a fifth
_SHORTER = {"cm": 10.0, "inches": 25.4, "m": 1000.0}
# share by which the centre line may be longer or shorter than the tube: soft arms stretch, and markers stand a little off
_OTHER_LENGTH = 0.2
# distance of the tip from the clamp, in lengths of the tube, when it bends by 217 deg: a tube that never comes out farther is shorter
_CURLED = 0.5
# height of the tip above the clamp at the beginning, in lengths of the tube, that is reached only where up and down are exchanged
_UPWARDS = 0.5
# distance of the tip from the clamp, in lengths of the tube, below which the track is in m, or another unit far larger than mm
_UNMOVED = 0.02
# standard errors, in lengths of the tube and in deg, that hide a bend by 6 deg, or half of one by 40 deg. Chosen.
_BLIND, _BLIND_DEG = 0.05, 20.0
# a standard error, in lengths of the tube, that no camera reaches (1.5 um of 155 mm), and how many of them rows must then scatter by
_TOO_SURE, _SCATTER = 1e-5, 30.0
# deg between two steps along a line, in half of the rows, that mean two points are exchanged: no tube turns back within a step
_FOLDED_DEG = 150.0
# deg from one row to the next, as a sensor that counts from 0 to 360 jumps by a full turn
_TURNED_DEG = 180.0
# distance of a place from the clamp, in lengths of the tube, that no tube reaches; and the share of rows up to which these are outliers
_OFF, _FEW = 2.0, 0.05


def of_pressure(log: PressureLog) -> list[str]:
    """Doubt a log, where its reader has not: the unit or the sign of its pressure, or that it is one."""
    if log.doubts:
        return list(log.doubts)
    pressure_kPa = log.pressure_kPa
    highest, span = float(np.abs(pressure_kPa).max()), float(np.ptp(pressure_kPa))
    if log.tendon:  # a force, to which no size of a pressure applies
        return of_tension(pressure_kPa / TENSION_kPa)
    high = np.abs(pressure_kPa) > _HIGH_KPA
    if 0 < high.mean() < _FEW:
        text = f"reaches {highest:.6g} kPa, in {high.sum()} of {len(pressure_kPa)} rows only"
        return [f"{text}; is it how the logger marks what it missed? Take these rows out"]
    if highest > _HIGH_KPA:
        return [f"reaches {highest:.6g} kPa; is it in Pa? Or in kPa, where bar or MPa is declared? pressure.unit says which"]
    if span == 0:
        return ["is flat: nothing can be synchronised or fitted on it; is it the right column?"]
    if highest < _LOW_KPA:
        return [f"stays below {highest:.3g} kPa; is it in bar or MPa? pressure.unit says which unit it is in"]
    lowest = float(pressure_kPa.min())
    emptiest = min((float(gauge.min()) for gauge in log.chambers.values()), default=lowest)
    if emptiest < _VACUUM_KPA:
        return [f"falls to {emptiest:.0f} kPa, below vacuum; is its sign turned in the log?"]
    if _AIR_kPa[0] <= lowest <= _AIR_kPa[1]:
        return [
            f"never falls below {lowest:.1f} kPa, the pressure of air; is it absolute? Then write pressure.reference: absolute"
        ]
    steps = np.diff(pressure_kPa)
    if len(steps) > 20 and np.ptp(steps) < 1e-3 * abs(float(steps.mean())):
        return ["rises by the same amount in every row, as a clock does; is it the column of time?"]
    return of_standstill(pressure_kPa)


def beside_others(name: str, highest_kPa: Mapping[str, float]) -> str:
    """Doubt a log whose pressures are of another size than those of every other run; empty where there is no doubt."""
    others = [value for other, value in highest_kPa.items() if other != name]
    if not others or not _LOW_KPA <= highest_kPa.get(name, 0.0) < min(others) / _UNLIKE:
        return ""  # one that is lower still is doubted by itself
    own = f"reaches {highest_kPa[name]:.3g} kPa, every other run at least {min(others):.3g} kPa"
    return f"{own}; is it in bar or MPa? pressure.unit says which unit it is in"


def of_times(log_s: FloatArray, pictures_s: FloatArray, *, filmed: bool = False) -> list[str]:
    """Doubt the unit of a clock: how long the log (rows,) and the pictures (frames,) last.

    `filmed`: the times are those that a film tells of itself, which in slow motion are not those of filming.
    """
    camera, logged = float(np.ptp(pictures_s)), float(np.ptp(log_s))
    if mixed := of_mixed(log_s):
        return mixed
    if len(pictures_s) < _FEW_PICTURES:
        return [f"there are {len(pictures_s)} pictures of the run, over {camera:.3g} s; is the track whole?"]
    both = f"the log lasts {logged:.4g} s, the pictures {camera:.4g} s"
    if logged > _TOO_LONG * camera:
        if abs(np.log(logged / max(camera, 1e-12) / 60.0)) < np.log(2.0):
            return [f"{both}; does the time of the pictures count in min? track.time_unit says which unit it is in"]
        return [f"{both}; is the time of the log in ms? Then write pressure.time_unit: ms"]
    if camera > _COUNTED * logged and np.all(np.diff(pictures_s) == 1.0):
        return [f"{both}; the time of the pictures counts in ones: is it the number of the frame?"]
    if camera > _TOO_LONG * logged:
        unit = min(_LONG_UNITS, key=lambda name: abs(np.log(camera / max(logged, 1e-12) / _LONG_UNITS[name])))
        if unit:
            return [f"{both}; does the log count in units of one {unit}? Then write pressure.time_unit: {unit}"]
        return [f"{both}; is the time of the pictures in ms?"]
    if logged >= 0.9 * camera:
        return of_pauses(log_s)
    slow = f"{both}; is it slow motion? Then video.rate says how fast it was filmed, such as 240 Hz. Or was the log cut off?"
    return [slow if filmed and camera > SLOW_MOTION * logged else f"{both}; only what both cover can be used"]


def of_track(track: xr.Dataset, length_mm: float) -> list[str]:
    """Doubt a track of another tool: its unit and its axes, by the length of the tube."""
    text = _of_angles(track) if "bend_angle" in track else ""
    if "tip" in track:
        tip, lines = valid_rows(track, "tip"), valid_rows(track, "midline") if "midline" in track else None
        text = (
            _of_places(tip, lines, length_mm)
            or ("" if lines is None else _folded(lines))
            or _of_length(lines, float(np.percentile(np.hypot(*tip.T), _USUAL)), length_mm)
            or _of_errors(track, length_mm)
            or _of_axes(tip, str(track.attrs.get("bends", "left")), length_mm)
        )
    return [text] if text else []


def _of_places(tip: FloatArray, lines: FloatArray | None, length_mm: float) -> str:
    """Doubt unit, rows and origin of a tip (n, 2) and of the centre line (n, points, 2) to it; empty where they may be right."""
    distance = np.hypot(*tip.T)
    far, off = float(distance.max()), distance > _OFF * length_mm
    at_most = f"the tip is at most {far:.4g} mm from the clamp, and the tube {length_mm:.4g} mm long"
    if 0 < off.mean() < _FEW:
        return f"{at_most}; {off.sum()} rows lie beyond any tube: leave empty those in which none was seen"
    if far < _UNMOVED * length_mm:
        if lines is not None and np.hypot(*lines[:, 0].T).max() > _CURLED * length_mm:
            return f"{at_most}, and its first point as far as the tube is long; are the points written from tip to clamp?"
        return f"{at_most}; are these mm?"
    if lines is not None and (text := _of_origin(lines, length_mm)):
        return text
    if off.any():
        return f"{at_most}; are these mm? And is the clamp where x and y are 0?"
    if np.percentile(distance, _USUAL) > _REACH * length_mm:
        return f"{at_most}; is actuator.length that of the part that bends, and the track's first point at its clamp?"
    return ""


def _of_axes(tip: FloatArray, bends: str, length_mm: float) -> str:
    """Doubt the axes of a tip (n, 2): mirrored, swapped or upside down; empty where they may be right."""
    outwards = -bend_sign(bends) * across(tip) / length_mm
    if -np.percentile(outwards, 5) > max(_ASIDE, 2 * np.percentile(outwards, 95)):
        aside = "the tip goes to the other side than actuator.bends says"
        return f"{aside}; is that right, is the track mirrored, or does it run backwards?"
    x_mm, above_mm = begins_at(tip)
    if abs(above_mm) < 0.2 * length_mm < 0.8 * length_mm < abs(x_mm):
        beside, below = f"{abs(x_mm):.3g} mm beside the clamp", f"{abs(above_mm):.3g} mm below"
        return f"begins with the tip {beside} and {below}; are x and y swapped?"
    if above_mm > _UPWARDS * length_mm:
        return f"begins with the tip {above_mm:.3g} mm above the clamp; does y count downwards, as in pictures?"
    return ""


def _of_angles(track: xr.Dataset) -> str:
    """Doubt an angle alone: its unit, its turns and its standard errors; empty where they may be right."""
    angles = valid_rows(track, "bend_angle")
    if turns := int(np.sum(np.abs(np.diff(angles)) > _TURNED_DEG)):
        return (
            f"jumps by more than half a turn from row to row, {counted(turns, 'time')}; does the sensor begin anew after a full "
            "turn? Write the angle on beyond it"
        )
    widest = float(np.nanmax(np.abs(angles)))
    if widest < np.pi:
        return f"never bends beyond {widest:.3g} deg; are these radians?"
    if (sigma := float(np.nanmedian(track["bend_angle_sigma"]))) > _BLIND_DEG:
        return f"its standard errors, sigma_deg, are {sigma:.3g} deg; is the unit right?"
    return ""


def of_upside_down(track: xr.Dataset, length_mm: float, gravity_deg: float | None = 0.0) -> list[str]:
    """Doubt a film in which the tube begins with its tip above its clamp: an arc comes no higher than a fifth of its length.

    Where no gravity pulls in the plane (None), the picture may be turned as it likes, and the frame is to be turned as the tube lies.
    """
    above_mm = begins_at(valid_rows(track, "tip"))[1]
    if above_mm < _UPWARDS * length_mm:
        return []
    if gravity_deg is None:
        return [
            f"begins with the tip {above_mm:.3g} mm above the clamp, and a tube at rest points down from it; without gravity that is "
            "where the tube lies: write vertical: rest in camera"
        ]
    return [
        f"begins with the tip {above_mm:.3g} mm above the clamp; is the film upside down? Then turn it and the photos of the board by "
        "half a turn; if the tube stands, write rig: {gravity: up}"
    ]


def _of_origin(lines: FloatArray, length_mm: float) -> str:
    """Doubt a centre line (n, points, 2) of the tube's length that begins elsewhere than at the origin; empty where it begins there."""
    x, y = np.median(lines[:, 0], axis=0)
    along = float(np.nanmedian(lengths(lines)))
    if np.hypot(x, y) < _ASIDE * length_mm or abs(along / length_mm - 1) > _OTHER_LENGTH:
        return ""
    return f"its line begins at x = {x:.4g}, y = {y:.4g} mm, and the clamp is where both are 0; count x and y from the clamp"


def _folded(lines: FloatArray) -> str:
    """Doubt the order of points of a centre line (n, points, 2) that goes back on itself; empty where it does not."""
    steps = np.diff(lines, axis=1)
    headings = np.arctan2(steps[..., 1], steps[..., 0])
    turns_deg = np.degrees(np.abs((np.diff(headings, axis=1) + np.pi) % (2 * np.pi) - np.pi))
    folded = np.flatnonzero(np.nanmedian(turns_deg, axis=0) > _FOLDED_DEG) + 1
    if not folded.size:
        return ""
    return f"its line goes back on itself at point {' and '.join(f'{k:02d}' for k in folded[:2])}; are points of it swapped?"


def _of_errors(track: xr.Dataset, length_mm: float) -> str:
    """Doubt the standard errors of places that are given: their unit; empty where they may be right."""
    sigma, tip = float(np.nanmedian(track["tip_sigma"])), valid_rows(track, "tip")
    if sigma > _BLIND * length_mm:
        return f"its standard errors, sigma_mm, are {sigma:.3g} mm, and the tube {length_mm:.4g} mm long; are they in um?"
    scatter = float(third_difference_noise(tip).max())
    if sigma < _TOO_SURE * length_mm and scatter > _SCATTER * sigma:
        remedy = "are they in m?" if sigma else "leave the column out where they are not known"
        return f"its standard errors, sigma_mm, are {sigma:.2g} mm, and its rows scatter by {scatter:.2g} mm; {remedy}"
    return ""


def _of_length(lines: FloatArray | None, far_mm: float, length_mm: float) -> str:
    """Doubt the tube's length (mm) by the centre line, or where there is none by how far the tip comes out; empty where it fits."""
    if lines is not None:
        along = float(np.nanmedian(lengths(lines)))
        if abs(along / length_mm - 1) <= _OTHER_LENGTH:
            return ""
        both = f"the centre line is {along:.4g} mm long, and the tube {length_mm:.4g} mm"
        for unit, times in _SHORTER.items():
            if abs(times * along / length_mm - 1) <= _OTHER_LENGTH:
                return f"{both}; is the track in {unit}? Write its columns in mm"
        return f"{both}; is actuator.length that of the part that bends?"
    if far_mm >= _CURLED * length_mm:
        return ""
    reached = f"the tip never comes farther than {far_mm:.4g} mm from the clamp"
    return f"{reached}, and the tube is {length_mm:.4g} mm long; is actuator.length right?"


@dataclass(frozen=True)
class Response:
    """How far a run's tip (mm) or angle (deg) goes from side to side, and its pressure (kPa)."""

    unit: str
    swing: float
    swing_kPa: float

    @property
    def per_kPa(self) -> float:
        """Swing in `unit` per kPa of the pressure's swing."""
        return self.swing / self.swing_kPa


def response(track: xr.Dataset, pressure_kPa: FloatArray) -> Response | None:
    """Return how far a run and its log (samples,) go; None where too little of either was seen."""
    places, unit = motion_of(track)
    places = places[np.isfinite(places).all(axis=1)]
    swing_kPa = float(np.ptp(np.percentile(pressure_kPa, (1, 99))))
    if len(places) < 20 or swing_kPa < _LOW_KPA:
        return None
    return Response(unit, swing(places), swing_kPa)


def of_response(name: str, responses: Mapping[str, Response]) -> str:
    """Doubt the unit of a log where the tube goes as far as in other runs and the pressure does not; empty where there is no doubt.

    A run that is faster than the others goes less far for each kPa, too, but has their pressures.
    """
    own = responses.get(name)
    others = [item for other, item in responses.items() if other != name and own and item.unit == own.unit]
    if own is None or not others:
        return ""
    most, least = max(item.per_kPa for item in others), min(item.per_kPa for item in others)
    lower = min(item.swing_kPa for item in others) / own.swing_kPa
    higher = own.swing_kPa / max(item.swing_kPa for item in others)
    if most > _OTHERWISE / 2 * least:
        return ""  # runs that are unlike each other tell nothing of this one
    if own.per_kPa > _OTHERWISE * most and lower > _OTHERWISE / 2:
        said = f"{own.per_kPa / most:.2g} times more for each kPa"
    elif own.per_kPa < least / _OTHERWISE and higher > _OTHERWISE / 2 and len(others) > 1:  # of two runs the first
        said = f"{least / max(own.per_kPa, 1e-12):.2g} times less for each kPa"
    else:
        return ""
    return f"the tube moves {said} than in any other run; is pressure.unit right? One psi is 6.9 kPa, one bar 100"


def of_rate(given_Hz: float | None, own_Hz: float | None) -> list[str]:
    """Doubt a rate of filming that is not that of slow motion: such files play at half the rate of filming at most."""
    if given_Hz is None or not own_Hz or abs(given_Hz / own_Hz - 1) < SAME_RATE or given_Hz > SLOW_MOTION * own_Hz:
        return []
    return [
        f"{given_Hz:g} Hz replaces the {own_Hz:.4g} frames/s that the file tells of itself, and slow motion plays slower than it was "
        "filmed; leave video.rate out, or is it another film's?"
    ]


def of_end(last_s: float, announced_s: float | None, *, listed: bool = False) -> list[str]:
    """Doubt a film whose last picture (s) comes long before the end that its file announces: its tail was lost.

    `listed`: the file has that picture, and nobody has tried to read it; what was cut off may have left a part of it.
    """
    if announced_s is None or announced_s - last_s < max(_TAIL_S, _TAIL * announced_s):
        return []
    which = "the last picture that is in the file" if listed else "the last picture that can be read"
    return [
        f"{which} is at {last_s:.2f} s, and the file announces {announced_s:.2f} s; was it cut off, or its end damaged? Copy it again, "
        "or go on with what is there"
    ]


def of_gaps(pictures_s: FloatArray, *, counted: bool = False) -> list[str]:
    """Doubt pictures (frames,) of which some are missing in the middle: dropped while filming, or not copied.

    `counted`: these are the times of the file's own clock, and those of the run are counted from a rate that was given.
    """
    steps = np.diff(pictures_s)
    gaps = np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) if len(steps) >= _FEW_PICTURES else np.empty(0, dtype=int)
    if not 0 < len(gaps) < _GAPS * len(steps):
        return []
    longest = gaps[np.argmax(steps[gaps])]
    many = f"{len(gaps)} times, for {steps[gaps].sum():.2f} s together, the longest " if len(gaps) > 1 else ""
    missing = f"pictures are missing {many}from {pictures_s[longest]:.2f} to {pictures_s[longest + 1]:.2f} s"
    if counted:
        return [
            f"{missing} of the file's own clock, and video.rate counts pictures: all that follow are dated too early; copy the film "
            "again, or make a run of each part"
        ]
    return [f"{missing}; copy them again if they are elsewhere, or go on: nothing is made up in between"]


def of_copies(time_s: FloatArray, is_copy: NDArray[np.bool_]) -> list[str]:
    """Doubt a film (frames,) that stands still while the tube moved: one stretch of copies, of half a second and a tenth of it."""
    begins, ends = stretches(is_copy)
    if not begins.size:
        return []
    longest = int(np.argmax(ends - begins))
    from_s, to_s = float(time_s[begins[longest]]), float(time_s[ends[longest] - 1])
    if to_s - from_s < max(_STANDS_S, _STANDS * float(np.ptp(time_s))):
        return []
    stands = f"the picture stands still from {from_s:.2f} to {to_s:.2f} s, and no frames were measured there"
    return [f"{stands}; did the light go out, or the recorder hang?"]


def of_damage(damaged_s: FloatArray) -> list[str]:
    """Doubt a film in which the decoder met damage (places, 2): from the first wrong picture to the last that is built on it."""
    if not len(damaged_s):
        return []
    places = f"in {len(damaged_s)} places, the longest " if len(damaged_s) > 1 else ""
    begins, ends = damaged_s[np.argmax(np.ptp(damaged_s, axis=1))]
    return [
        f"the film is damaged {places}from {begins:.2f} to {ends:.2f} s, where pictures are lost or wrong in part; copy it again, or "
        "look at the track there (--preview)"
    ]
