"""What a tube went through before a run: the logs of the runs before it, where these followed without a rest."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from rfea_vision.artefacts import Recording
from rfea_vision.campaign import Campaign, ExperimentSpec
from rfea_vision.errors import InputError
from rfea_vision.units import parse_moment

#: Pause between two runs (s) where `recorded_at` does not give it, and the shortest and the longest that is simulated: after the
#: longest, creep has died away, and what has softened stays soft.
UNTOLD_PAUSE_S, SHORTEST_PAUSE_S, LONGEST_PAUSE_S = 3.0, 1e-3, 10.0


def runs_before(campaign: Campaign, experiment: ExperimentSpec) -> list[ExperimentSpec]:
    """Runs whose memory a run carries, oldest first: back to one that began fresh, or to the first of all.

    Raises
    ------
    InputError
        If some of the campaign's runs say when they were recorded, and others do not: their order is unknown.
    """
    if experiment.memory != "carried":
        return []
    runs = list(campaign.experiments)
    untold = [run for run in runs if run.recorded_at is None]
    if untold and len(untold) < len(runs):
        raise InputError(
            f"{untold[0].file}: recorded_at: is missing, while other runs say theirs and "
            f"'{experiment.name}' has `memory: carried`; give it, so that their order is known"
        )
    runs.sort(key=lambda run: (_recorded_at(run) or datetime.min.replace(tzinfo=UTC), run.name))
    names = [run.name for run in runs]
    last = names.index(experiment.name)
    first = last
    while first > 0 and runs[first].memory == "carried":
        first -= 1
    return runs[first:last]


def with_earlier_pressure(recording: Recording, campaign: Campaign, experiment: ExperimentSpec) -> Recording:
    """Return the recording with the pressure of the runs whose memory it carries, on its own log's clock.

    Raises
    ------
    InputError
        If one of those runs has no log.
    """
    before = runs_before(campaign, experiment)
    if not before:
        return recording
    from rfea_vision.readers.pressure import read_pressure

    time, pressure = np.empty(0), np.empty(0)
    for run, following in zip(before, [*before[1:], experiment], strict=True):
        if run.pressure.constant:
            raise InputError(f"{run.file}: pressure.value: '{experiment.name}' carries its memory; give its log")
        log = read_pressure(run.pressure, run.name)
        took_s = float(log.time_s[-1] - log.time_s[0])
        time = np.concatenate([time, log.time_s - log.time_s[-1]])
        pressure = np.concatenate([pressure, log.pressure_kPa])
        time -= _pause_s(run, following, took_s)
        if following is not experiment:
            after = read_pressure(following.pressure, following.name)
            time -= float(after.time_s[-1] - after.time_s[0])
    own = recording.dataset["log_time"].values
    period = float(np.median(np.diff(own)))
    time += round(time[0] / period) * period - time[0]  # on the grid of the run's own log
    data = recording.dataset.assign_coords(
        earlier_time=(
            "earlier_time",
            time + own[0],
            {"units": "s", "long_name": "time on the log's clock, before the log"},
        )
    )
    data["earlier_pressure"] = (
        ("earlier_time",),
        pressure,
        {"units": "kPa", "long_name": "gauge pressure in the runs before"},
    )
    data.attrs["carries_memory_of"] = ", ".join(run.name for run in before)
    return Recording(data)


def _pause_s(run: ExperimentSpec, following: ExperimentSpec, took_s: float) -> float:
    begun, next_begun = _recorded_at(run), _recorded_at(following)
    if begun is None or next_begun is None:
        return UNTOLD_PAUSE_S
    pause_s = (next_begun - begun).total_seconds() - took_s
    if pause_s < -0.1 * took_s:  # a date without a time of day
        return UNTOLD_PAUSE_S
    return float(np.clip(pause_s, SHORTEST_PAUSE_S, LONGEST_PAUSE_S))


def _recorded_at(run: ExperimentSpec) -> datetime | None:
    if run.recorded_at is None:
        return None
    moment = parse_moment(run.recorded_at)
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


__all__ = ["runs_before", "with_earlier_pressure"]
