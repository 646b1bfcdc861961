"""`synchronise`: a track and its pressure log become a recording."""

from __future__ import annotations

from pathlib import PurePath

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Recording, Track
from rfea_vision.artefacts.clocks import SYNC_METHODS
from rfea_vision.artefacts.measurement import TENSION_kPa
from rfea_vision.errors import DataError, InputError
from rfea_vision.readers.pressure import PressureLog
from rfea_vision.sync.alignment import Alignment
from rfea_vision.sync.motion import FLAT_REMEDY, LEAST_SWING_KPA, align_by_motion
from rfea_vision.sync.pulses import align_by_lamp, align_by_trigger


def synchronise(
    track: Track,
    log: PressureLog,
    *,
    experiment: str,
    role: str,
    bends: str,
    method: str = "motion",
    value_s: float | None = None,
    channel: str | None = None,
    repeat_of: str | None = None,
    gravity_deg: float | None = 0.0,
) -> Recording:
    """Put a track and a pressure log on the log's clock.

    Parameters
    ----------
    track, log : what was measured
    experiment, role, bends : carried along
    method : ``motion``, ``led`` (lamp in the picture, `channel` of the log), ``trigger`` (`channel` of the log, one
        pulse per frame or one at the start), ``offset`` (`value_s`) or ``common_clock``
    value_s : log clock minus camera clock, for ``offset``
    repeat_of : experiment whose excitation is repeated
    gravity_deg : where gravity points, from down and positive towards the side of the bend; None where the plane of motion is
        level. Of ``motion`` alone

    Raises
    ------
    InputError
        If the method is unknown or lacks its value, or no frame lies within the log by the clocks that were declared.
    DataError
        If the log is flat or too short, or the two do not belong together.
    """
    if method not in SYNC_METHODS:
        raise InputError(f"{experiment}: sync.method: '{method}' is unknown; use one of {', '.join(SYNC_METHODS)}")
    notes = check_log(log.time_s, log.pressure_kPa, experiment, moving=method == "motion")
    alignment = _align(track, log, experiment, bends, method, value_s, channel, gravity_deg)
    shifted = track.time_s * (1 + 1e-6 * alignment.drift_ppm) + alignment.offset_s
    covered = _covered(shifted, track, log.time_s, experiment, method)
    if np.mean(covered) < 0.98:
        notes.append(f"{100 * np.mean(~covered):.0f} % of the frames lie outside the log")
    dataset = _on_log_clock(track, log, shifted)
    if len(alignment.curve[0]):
        dataset = dataset.assign_coords(sync_offset=("sync_offset", alignment.curve[0], {"units": "s"}))
        dataset["sync_explained"] = xr.Variable(("sync_offset",), alignment.curve[1], {"units": "1"})
    about = {"experiment": experiment, "role": role, "bends": bends, "sync_method": method}
    said = {"sync_notes": "; ".join(filter(None, [*notes, alignment.note])), "pressure_source": PurePath(log.source).name}
    repeats = {"repeat_of": repeat_of} if repeat_of else {}
    dataset.attrs = {**track.dataset.attrs, **about, **alignment.attributes, **said, **repeats}
    return Recording(dataset)


def _covered(
    shifted: FloatArray, track: Track, log_time: FloatArray, experiment: str, method: str
) -> NDArray[np.bool_]:
    """Which frames (n,) lie within the log; an error where none does that was measured."""
    covered = (shifted >= log_time[0]) & (shifted <= log_time[-1])
    if not np.any(covered & track.valid):
        kind = InputError if method in ("common_clock", "offset") else DataError  # what was declared, or what was found
        raise kind(
            f"{experiment}: sync: no frame lies within the log: by '{method}' they go from {shifted[0]:.6g} to {shifted[-1]:.6g} s, "
            f"and the log from {log_time[0]:.6g} to {log_time[-1]:.6g} s; correct sync.value, or use sync.method motion"
        )
    return covered


def _on_log_clock(track: Track, log: PressureLog, time_s: FloatArray) -> xr.Dataset:
    """The track at times (n,) of the log's clock, and the pressure beside it: of each chamber, too, where there are several."""
    dataset = track.dataset.assign_coords(
        time=("time", time_s, {"units": "s", "long_name": "time on the log's clock"}),
        log_time=("log_time", log.time_s, {"units": "s"}),
    )
    attributes = {"units": "kPa", "long_name": f"tension, 1 N as {TENSION_kPa:g} kPa" if log.tendon else "gauge pressure"}
    dataset["pressure"] = (("log_time",), log.pressure_kPa, attributes)
    if log.chambers:
        signs = ("chamber", [log.signs[name] for name in log.chambers])
        dataset = dataset.assign_coords(chamber=("chamber", list(log.chambers)), chamber_sign=signs)
        dataset["chamber_pressure"] = (("chamber", "log_time"), np.stack(list(log.chambers.values())), attributes)
        dataset["pressure"].attrs["long_name"] = "sum of the chambers' gauge pressures, each times its sign"
    return dataset


def _align(
    track: Track,
    log: PressureLog,
    experiment: str,
    bends: str,
    method: str,
    value_s: float | None,
    channel: str | None,
    gravity_deg: float | None,
) -> Alignment:
    """Offset and drift by the method asked for."""
    log_time, pressure = log.time_s, log.pressure_kPa
    apart_s = log.zero_apart_s(track.dataset.attrs.get("clock_zero_s"))

    def by_motion() -> Alignment:
        return align_by_motion(track, log_time, pressure, experiment=experiment, bends=bends, gravity_deg=gravity_deg)

    if method == "common_clock":
        return Alignment(apart_s, note=log.zero_doubt(track.dataset.attrs.get("clock_zero_s")))
    if method == "offset":
        if value_s is None:
            raise InputError(f"{experiment}: sync.value is missing; give log clock minus camera clock, such as 12 ms")
        return Alignment(apart_s + float(value_s))
    if method == "motion":
        return by_motion()
    try:
        signal = log.signal(method, channel)
    except InputError as error:
        raise InputError(f"{experiment}: sync.channel: {error}") from error
    if method == "led":
        return align_by_lamp(track, log_time, signal, experiment=experiment)

    def checked_by_motion() -> Alignment:
        check_log(log_time, pressure, experiment, moving=True)
        return by_motion()

    return align_by_trigger(track, log_time, signal, experiment=experiment, by_motion=checked_by_motion)


def check_log(time_s: FloatArray, pressure_kPa: FloatArray, experiment: str, *, moving: bool) -> list[str]:
    """Say what is wrong with a log: flat or too short is an error for sync by motion, saturation a note.

    time_s, pressure_kPa : (samples,) the log on its own clock; moving : whether the clocks are found from the motion

    Raises
    ------
    DataError
        If sync by motion is asked for, and the log lasts less than a second or is flat.
    """
    swing = float(np.ptp(pressure_kPa))
    if moving and time_s[-1] - time_s[0] < 1.0:
        raise DataError(
            f"{experiment}: pressure: the log lasts {time_s[-1] - time_s[0]:.2f} s, too short to align by motion; "
            "use sync.method offset"
        )
    if moving and swing < LEAST_SWING_KPA:
        raise DataError(
            f"{experiment}: pressure: the log is flat ({swing:.2f} kPa); {FLAT_REMEDY}"
        )
    if (samples := _clipped(pressure_kPa)) == 0:
        return []
    return [f"the log stays at exactly {pressure_kPa.max():.1f} kPa for {samples} samples: is the sensor saturated?"]


#: Samples that are equal to the last digit: more is no chance.
HELD_SAMPLES = 20


def _clipped(pressure_kPa: FloatArray) -> int:
    """The most samples for which a sensor seems to stand at the end of its range; 0 where nothing says so.

    A sensor at its end is run into at speed, at one value alone, and again and again or in a log that stands still nowhere
    else. A line that is filled or vented comes to rest slowly; a log of what was commanded, if it runs into holds at speed,
    does so at every level.
    """
    swing, top = float(np.ptp(pressure_kPa)), pressure_kPa.max()
    turns = np.flatnonzero(np.diff(pressure_kPa)) + 1
    starts, ends = np.concatenate([[0], turns]), np.concatenate([turns, [pressure_kPa.size]])
    holds = [
        (int(start), int(end - start)) for start, end in zip(starts, ends, strict=True) if end - start > HELD_SAMPLES
    ]
    hit = [(start, samples) for start, samples in holds if _run_into(pressure_kPa, start, swing)]
    told = len(hit) > 1 or len(holds) == 1
    return max((samples for _, samples in hit if told and all(pressure_kPa[at] == top for at, _ in hit)), default=0)


def _run_into(pressure_kPa: FloatArray, start: int, swing_kPa: float) -> bool:
    """Whether the log (samples,) comes to what it holds from `start` on at speed.

    The last tenth of the swing is looked at, if it took four samples at least: at an even speed its last quarter takes a
    quarter of the time; a decay to 1 in 4,096, what a sensor of 12 bits can tell, three quarters. Half lies between.
    """
    width, off = 64, np.zeros(0)
    while not (off > 0.1 * swing_kPa).any() and off.size < start:  # most are come to within few samples
        off, width = np.abs(pressure_kPa[max(0, start - width) : start][::-1] - pressure_kPa[start]), 4 * width
    tenth, quarter = (int(np.argmax(np.append(off > part * swing_kPa, True))) for part in (0.1, 0.025))
    return tenth >= 4 and 2 * quarter <= tenth
