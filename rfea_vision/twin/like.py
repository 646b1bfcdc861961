"""Twins of a campaign that somebody recorded: its pressure logs, roles, frames, clocks and noise, another tube in them.

What the critique makes of such twins says what it would make of the recordings, were that the tube.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.errors import DataError, InputError
from rfea_vision.files import write_text
from rfea_vision.scatter import third_difference_noise
from rfea_vision.twin.draw import Run, build_plant, move, posture_at
from rfea_vision.twin.excitation import GRID_S, Programme
from rfea_vision.twin.options import BaseParameters, TwinOptions
from rfea_vision.twin.writer import truth_of, whole_campaign, write_campaign, write_experiment, write_track

LEAST_NOISE_MM, LEAST_NOISE_DEG = 1e-3, 1e-3  # of recordings that claim none
BEFORE_S = 3.0  # log before the first frame that is played


def base_like(parameters: Mapping[str, float], segments: int) -> BaseParameters:
    """Base parameters per joint of a chain of eight, from fitted ones (SI) of a chain of `segments`."""
    scale = {name: 1.0 if name == "r_hyd" else 8 / segments for name in BaseParameters.__dataclass_fields__}
    return BaseParameters(**{name: scale[name] * parameters[name] for name in scale})


def tube_like(actuator: Actuator) -> Actuator:
    """The tube of the plant that stands for an actuator: one that was weighed has densities that give its mass.

    Raises
    ------
    InputError
        If it is no tube: the plant bends about its side alone.
    """
    if actuator.kind != "tube":
        raise InputError(
            f"simulate --like: the plant is a tube, and this campaign's section a {actuator.kind}; no twin of it can be made"
        )
    by_size = replace(actuator, mass_per_length=None)
    heavier = actuator.linear_density / by_size.linear_density
    return replace(by_size, density=heavier * actuator.density, fluid_density=heavier * actuator.fluid_density)


def simulate_like(
    out: Path,
    recordings: Mapping[str, Recording],
    options: TwinOptions,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Write a campaign of tracks with the excitation, frames, roles, clocks and noise of `recordings`.

    Parameters
    ----------
    out : the campaign folder to write; must not exist, or be empty
    recordings : by experiment
    options : the tube (`actuator`, `base`, `hidden`, `joints`, `seed`); what else it says is taken from the recordings

    Returns
    -------
    dict
        The truth, as `simulate` writes it.

    Raises
    ------
    InputError
        If `out` is already filled.
    DataError
        If there is no recording, or such a tube cannot be simulated.
    """
    if not recordings:
        raise DataError("simulate --like: the campaign has no recording to take after; run rfea sync first")
    _, base = build_plant(options)
    runs: list[Run] = []
    noises: dict[str, float] = {}
    with whole_campaign(out) as work:
        write_campaign(work, options.name or out.name, options, None)
        for index, (name, recording) in enumerate(recordings.items()):
            run = _run_like(name, recording, options.hidden)
            given = replace(options, base=base, gravity=_gravity(recording), **_observed(recording))
            plant, _ = build_plant(given)
            times = recording.time_s[recording.valid]
            camera_s = (times - run.offset_s) / (1 + run.drift)
            posture = posture_at(plant, move(plant, run, options.step_s), times)
            folder = work / name
            folder.mkdir()
            write_experiment(folder, run, given)
            _write_log(folder / "pressure.csv", recording)
            generator = np.random.default_rng([options.seed, 3, index])
            write_track(folder / "track.csv", camera_s, posture, given, generator)
            noises[name] = given.noise_angle_deg if given.observe == "angle" else given.noise_mm
            runs.append(run)
            if progress is not None:
                progress(index + 1, len(recordings))
        truth = {**truth_of(options, asdict(base), runs), "noise": noises}
        truth.pop("noise_mm", None)  # each run has its own
        if options.write_truth:
            write_text(out.with_name(f"{out.name}-truth.json"), json.dumps(truth, indent=1) + "\n")
    return truth


def _run_like(name: str, recording: Recording, hidden: Mapping[str, float]) -> Run:
    """Excitation and clocks of one recording; a hidden error of the clock needs a clock that claims to be known."""
    log, pressure = recording.dataset["log_time"].values, recording.dataset["pressure"].values
    first, last = recording.time_s[0], recording.time_s[-1]
    start = max(float(log[0]), float(first) - BEFORE_S)
    time = start + GRID_S * np.arange(int((min(float(log[-1]), float(last) + 0.1) - start) / GRID_S) + 1, dtype=float)
    attributes = recording.dataset.attrs
    offset, drift = float(attributes["offset_s"]), hidden.get("clock_drift.d", 0.0)
    claimed = offset + 0.5 * drift * float(last - first) - hidden.get("time_offset.dt", 0.0)
    programme = Programme("recorded", time, 1e3 * np.interp(time, log, pressure))
    return Run(name, recording.role, programme, offset, drift, claimed, attributes.get("repeat_of"))


def _gravity(recording: Recording) -> str | float:
    """Where gravity points in a run, as `TwinOptions.gravity` says it."""
    attributes = recording.dataset.attrs
    return "none" if attributes.get("gravity") == "none" else float(attributes.get("gravity_deg", 0.0)) or "down"


def _observed(recording: Recording) -> dict[str, Any]:
    """What the recording holds, its noise, and whether its clock was known beforehand."""
    dataset, valid = recording.dataset, recording.valid
    sync = "motion" if dataset.attrs.get("sync_method") == "motion" else "offset"
    if "midline" in dataset or "tip" in dataset:
        tip = dataset["tip"].values if "tip" in dataset else dataset["midline"].values[:, -1]
        observe = "midline" if "midline" in dataset else "tip"
        noise = max(noise_of(tip[valid]), LEAST_NOISE_MM)
        return {"observe": observe, "noise_mm": noise, "sync": sync}
    noise = max(noise_of(dataset["bend_angle"].values[valid][:, None]), LEAST_NOISE_DEG)
    return {"observe": "angle", "noise_angle_deg": noise, "sync": sync}


def noise_of(values: FloatArray) -> float:
    """Standard deviation of the noise of a smooth series (frames, k), from its third differences; taken as white."""
    return float(np.sqrt(np.mean(third_difference_noise(values[np.all(np.isfinite(values), axis=1)]) ** 2)))


def _write_log(path: Path, recording: Recording) -> None:
    """Write the recording's own pressure log."""
    dataset = recording.dataset
    rows = np.column_stack([dataset["log_time"].values, dataset["pressure"].values])
    lines = [f"{time:.6f},{pressure:.5f}" for time, pressure in rows]
    write_text(path, "\n".join(["time_s,pressure_kPa", *lines]) + "\n")
