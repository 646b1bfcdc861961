"""What runs have in common and should not, and what a repeat should have in common with the run that it repeats."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.campaign.specs import ExperimentSpec
from rfea_vision.campaign.tracked import lengths, motion_of
from rfea_vision.files import sha256_of
from rfea_vision.scatter import rounding_noise

if TYPE_CHECKING:
    import xarray as xr

    from rfea_vision.readers.pressure import PressureLog

#: Parts of a run that no two runs have in common, and how they are alike.
_COPIED = {"video": "film, byte by byte", "track": "track, row by row", "pressure": "log, row by row"}

# share of a motion's range within which two motions agree in every row: no two runs do, and a copy with seven digits does
_SAME_MOTION = 1e-5
# least share of a pressure's variance that the repeated run's pressure explains; repeats with a valve leave 0.01 at most. Chosen.
_REPEATED = 0.8
# shifts (s) between the beginnings of a repeat and of what it repeats that are tried, as `before_repeat` of the fits does
_BEGINNINGS_S = np.arange(-0.5, 0.51, 0.02)
# tolerance, as a share of the missing points, with which the missing length must agree with them: whole lines miss nothing
_CUT_SHORT = 0.3
# kPa of standard deviation of a pressure that stands still, as soft actuators are driven with 10 to 500
_STILL_KPA = 0.5
# The first twentieth of a run is looked at; it is at rest if motion and pressure stay within this share of their swings.
_BEGINS, _QUIET = 20, 0.02
# Share of the highest pressure by which zeros of a sensor may differ between runs: data sheets give 0.5 % of the range and less. And
# the share of the motion that such a difference would cause, below which the tube is where it was. Chosen: friction holds a tube, but
# not in one run alone.
_ZERO, _UNMOVED = 0.03, 0.3
# rows, and steps of the last digit that the motion covers: with fewer, two motions may agree by chance
_FEW_ROWS = 20


def of_repeat(own: PressureLog, first: PressureLog, name: str) -> str:
    """Doubt that a run repeats another one, by their pressures; empty where these are alike, or both stand still."""
    time_s = np.arange(0.0, min(np.ptp(own.time_s), np.ptp(first.time_s)), _BEGINNINGS_S[1] - _BEGINNINGS_S[0])
    pressure = np.interp(own.time_s[0] + time_s, own.time_s, own.pressure_kPa)
    spread = float(np.var(pressure))
    if spread < _STILL_KPA**2:
        return ""
    begun_s = first.time_s[0] + time_s
    left = min(np.mean((np.interp(begun_s + late_s, first.time_s, first.pressure_kPa) - pressure) ** 2) for late_s in _BEGINNINGS_S)
    told = 1 - float(left) / spread
    if told >= _REPEATED:
        return ""
    return (
        f"its pressure is that of '{name}' to {100 * max(told, 0.0):.0f} % only, from their beginnings on; does it repeat another run? "
        "What repeats differ by is taken for what the tube itself does not repeat"
    )


@dataclass(frozen=True)
class Rest:
    """How a run begins while nothing moves: where the tip (2,) in mm or the angle (1,) in deg is, at which pressure (kPa).

    `per_kPa` is how far the tube goes for each kPa over the run, `highest_kPa` the highest pressure.
    """

    place: FloatArray
    pressure_kPa: float
    per_kPa: float
    highest_kPa: float


def rest_of(track: xr.Dataset, pressure_kPa: FloatArray) -> Rest | None:
    """How a run begins, by its pressure at each frame (frames,); None where it is not at rest then, or goes nowhere."""
    motion, _ = motion_of(track)
    if not len(motion):
        return None
    seen = np.isfinite(motion).all(axis=1) & np.isfinite(pressure_kPa)
    motion, pressure = motion[seen], pressure_kPa[seen]
    first = slice(max(3, len(pressure) // _BEGINS))
    swing = np.linalg.norm(np.ptp(motion, axis=0)) if len(pressure) >= _FEW_ROWS else 0.0
    swing_kPa = float(np.ptp(pressure)) if swing else 0.0
    if swing_kPa < _STILL_KPA or np.ptp(pressure[first]) > _QUIET * swing_kPa:
        return None
    if np.ptp(motion[first], axis=0).max() > _QUIET * swing:
        return None
    place = np.median(motion[first], axis=0)
    return Rest(place, float(np.median(pressure[first])), float(swing / swing_kPa), float(np.abs(pressure).max()))


def of_rest(name: str, rests: Mapping[str, Rest]) -> str:
    """Doubt the zero of a sensor: the tube rests in the same place as in all other runs, at another pressure; else empty."""
    own, others = rests.get(name), [rest for other, rest in rests.items() if other != name]
    if own is None or len(others) < 2 or any(rest.place.shape != own.place.shape for rest in others):
        return ""
    most_kPa = _ZERO * max(rest.highest_kPa for rest in rests.values())
    if np.ptp([rest.pressure_kPa for rest in others]) > most_kPa:
        return ""
    more_kPa = [own.pressure_kPa - rest.pressure_kPa for rest in others]
    for rest, kPa in zip(others, more_kPa, strict=True):
        expected = abs(kPa) * min(own.per_kPa, rest.per_kPa)
        if abs(kPa) < most_kPa or np.linalg.norm(own.place - rest.place) > _UNMOVED * expected:
            return ""
    return (
        f"begins with {np.median(more_kPa):+.3g} kPa against every other run, and the tube rests where it does there; was the sensor's "
        f"zero another? 'rfea fit --pressure-zero {abs(np.median(more_kPa)):.2g}kPa' finds one for each run"
    )


def line_of(track: xr.Dataset) -> tuple[int, float]:
    """Points of the centre line of a track or recording, and its length in mm; zeros where it has none."""
    if "midline" not in track:
        return 0, 0.0
    lines = track["midline"].values
    return lines.shape[1], float(np.nanmedian(lengths(lines)))


def of_line(name: str, lines: Mapping[str, tuple[int, float]]) -> str:
    """Doubt a centre line that has fewer points than that of another run of the tube, and is as much shorter; else empty."""
    count, long_mm = lines[name]
    other, (most, whole_mm) = max(lines.items(), key=lambda item: item[1])
    if not 1 < count < most or abs(long_mm / whole_mm - (count - 1) / (most - 1)) > _CUT_SHORT * (most - count) / (most - 1):
        return ""
    return f"its line has {count} points over {long_mm:.4g} mm, that of '{other}' {most} over {whole_mm:.4g}; are points of it missing?"


def _within(short: FloatArray, long: FloatArray) -> bool:
    """Whether rows of one motion stand, one after the other, in another one."""
    digits = np.sqrt(12) * max(rounding_noise(short), rounding_noise(long))  # of the one that was saved with fewer
    near = max(digits, _SAME_MOTION * float(np.ptp(long, axis=0).max()))
    count, places = len(short), np.arange(len(long) - len(short) + 1)
    if np.ptp(short, axis=0).max() < _FEW_ROWS * near:
        return False  # what rests is alike anywhere
    for row in (0, count // 2, count - 1):
        places = places[np.abs(long[places + row] - short[row]).max(axis=1) <= near]
    return any(np.abs(long[at : at + count] - short).max() <= near for at in places)


def alike(
    experiments: Sequence[ExperimentSpec], motions: Mapping[str, FloatArray] | None = None
) -> list[tuple[ExperimentSpec, str, str]]:
    """Doubt a film, a track, a pressure log or a motion that stands in two runs: the second of each pair, its key, and why.

    `motions` (rows, columns) by run are alike where one is the other or a part of it, to the digits that were saved; rows without
    numbers do not count.
    """
    found = []
    for key, what in _COPIED.items():
        having = [(item, part) for item in experiments if (part := getattr(item, key)) is not None]
        files = [(item, part) for item, part in having if part.file is not None and part.file.is_file()]
        sizes = Counter(part.file.stat().st_size for _, part in files)  # a film is read only where another is as long
        seen: dict[tuple[object, ...], ExperimentSpec] = {}
        for item, part in files:
            if sizes[part.file.stat().st_size] > 1:
                taken = [getattr(part, name, None) for name in ("pressure", "angle", "points", "individual")]
                first = seen.setdefault((sha256_of(part.file), *taken), item)
                if first is not item:
                    found.append(
                        (item, key, f"is the same {what}, as that of '{first.name}'; was it copied by mistake?")
                    )
    said = {item.name for item, _, _ in found}
    seen_to_move = [(item, (motions or {}).get(item.name, np.empty((0, 1)))) for item in experiments]
    moving = [(item, rows[np.isfinite(rows).all(axis=1)]) for item, rows in seen_to_move]
    moving = [(item, rows) for item, rows in moving if len(rows) >= _FEW_ROWS]
    for (first, other), (item, own) in combinations(moving, 2):
        short, long = sorted((own, other), key=len)
        if item.name not in said and short.shape[1] == long.shape[1] and _within(short, long):
            said.add(item.name)
            text = f"is the same track as that of '{first.name}', or a part of it, saved in another way; was it copied by mistake?"
            found.append((item, "track" if item.track else "video", text))
    return found
