"""Write a generated campaign: the folder that a person would have filled, and the truth beside it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
import yaml

from rfea_vision.arrays import FloatArray
from rfea_vision.drive import ValveCommands
from rfea_vision.errors import InputError
from rfea_vision.files import write_dataset, write_text
from rfea_vision.twin.draw import (
    LOG_STEP_S,
    Posture,
    Run,
    build_plant,
    camera_times,
    draw_runs,
    highest_pressure,
    misread_plane,
    noise_like,
    posture_at,
)
from rfea_vision.twin.driven import play
from rfea_vision.twin.options import HIDDEN, TwinOptions, with_partners
from rfea_vision.twin.studio import Studio

NODES = 33  # of an exact track, as many as the tracker writes
_PLAYED, _FILMED = 200, 800  # steps of progress a run: filming takes four times as long


def simulate(
    out: Path, options: TwinOptions | None = None, progress: Callable[[int, int], None] | None = None
) -> dict[str, Any]:
    """Generate a campaign of a tube whose physics is known.

    Parameters
    ----------
    out : the campaign folder to write; must not exist, or be empty
    options : what to generate
    progress : called as progress(done, total)

    Returns
    -------
    dict
        The truth, as written to ``<out>-truth.json``: effects, their parameters (SI), base parameters (for n = 8), and
        per experiment the true offset between the clocks.

    Raises
    ------
    InputError
        If `out` is already filled.
    DataError
        If such a tube cannot be simulated.
    """
    options = options or TwinOptions()
    with whole_campaign(out) as work:
        plant, base = build_plant(options)
        runs = draw_runs(options, 0.0 if options.given is not None else highest_pressure(plant, options))
        camera_s = camera_times(options)
        report, total = progress or (lambda done, total: None), (_PLAYED + _FILMED) * len(runs)
        postures, told = [], []
        for index, run in enumerate(runs):
            report(_PLAYED * index, total)
            motion, runs[index], valves = play(plant, run, options)
            told.append(valves)
            postures.append(posture_at(plant, motion, run.offset_s + (1 + run.drift) * camera_s))
        studio = Studio(options, postures) if options.video else None
        camera = studio.write_calibration(work / "calibration") if studio else None
        write_campaign(work, options.name or out.name, options, camera)
        for index, (run, posture) in enumerate(zip(runs, postures, strict=True)):
            begun, folder = _PLAYED * len(runs) + _FILMED * index, work / run.name
            report(begun, total)
            generator = np.random.default_rng([options.seed, 3, index])
            folder.mkdir()
            write_experiment(folder, run, options)
            _write_pressure(folder / "pressure.csv", run, options, generator)
            _write_valves(folder / "valves.csv", told[index])
            if studio is None:
                write_track(folder / "track.csv", camera_s, posture, options, generator)
            else:

                def filmed(frames: int, begun: int = begun) -> None:
                    report(begun + _FILMED * frames // camera_s.size, total)

                studio.film(folder / "video.mp4", posture, filmed)
            if options.exact_tracks:
                _write_exact(out.with_name(f"{out.name}-truth") / f"{run.name}.nc", camera_s, posture)
        truth = truth_of(options, asdict(base), runs)
        if options.write_truth:
            write_text(out.with_name(f"{out.name}-truth.json"), json.dumps(truth, indent=1) + "\n")
    report(total, total)
    return truth


@contextmanager
def whole_campaign(out: Path) -> Iterator[Path]:
    """A folder to write to, which becomes `out` once it is finished; InputError if that is already filled."""
    out = out.resolve()  # `.` has no name
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: already there and not empty; choose another folder, or remove it first")
    work = out.with_name(f".{out.name}-unfinished")
    shutil.rmtree(work, ignore_errors=True)
    try:
        work.mkdir(parents=True)
        yield work
        if out.exists():
            out.rmdir()
        work.rename(out)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def truth_of(options: TwinOptions, base: dict[str, float], runs: list[Run]) -> dict[str, object]:
    """What `simulate` returns: hidden effects and their parameters (SI), base parameters, noise, and offsets (s) by run."""
    hidden = with_partners(options.hidden)
    return {
        "effects": sorted({key.split(".")[0] for key in hidden}),
        "parameters": hidden,
        "units": {key: HIDDEN[key].unit for key in hidden},
        "base": base,
        "seed": options.seed,
        **_noise(options),
        "experiments": {run.name: {"role": run.role, "offset_s": run.offset_s} for run in runs},
    }


def _noise(options: TwinOptions) -> dict[str, float]:
    if options.video:
        return {"image_noise_grey_levels": options.image_noise, "codec_qp": options.codec_qp}
    if options.observe == "angle":
        return {"noise_angle_deg": options.noise_angle_deg}
    return {"noise_mm": options.noise_mm}


def write_campaign(folder: Path, name: str, options: TwinOptions, camera: dict[str, object] | None) -> None:
    """Write campaign.yaml; `camera` is its section of that name, None of a campaign of tracks."""
    tube = options.actuator
    content: dict[str, Any] = {
        "format": "rfea-campaign/1",
        "name": name,
        "actuator": {
            "outer_radius": f"{tube.outer_radius * 1e3:.6g} mm",
            "inner_radius": f"{tube.inner_radius * 1e3:.6g} mm",
            "length": f"{tube.length * 1e3:.6g} mm",
            "density": f"{tube.density:.6g} kg/m^3",
            "fluid_density": f"{tube.fluid_density:.6g} kg/m^3",
            "bends": tube.bends,
        },
    }
    if camera is not None:
        content["camera"] = camera
    write_text(folder / "campaign.yaml", yaml.safe_dump(content, sort_keys=False))


def write_experiment(folder: Path, run: Run, options: TwinOptions) -> None:
    """Write experiment.yaml of one run."""
    content: dict[str, Any] = {"format": "rfea-experiment/1", "name": run.name, "role": run.role}
    if options.video:
        content["video"] = {"file": "video.mp4"}
        if options.scene.slow_motion:
            content["video"]["rate"] = f"{options.rate_Hz:g} Hz"
    else:
        content["track"] = {"file": "track.csv"}
    content["pressure"] = {"file": "pressure.csv"}
    if options.sync == "offset" or run.claimed_offset_s != run.offset_s or run.drift:
        # a hidden clock effect needs a clock that claims to be known, else synchronisation would simply find it
        content["sync"] = {"method": "offset", "value": f"{run.claimed_offset_s * 1e3:.4f} ms"}
    else:
        content["sync"] = {"method": options.sync}
    if options.gravity != "down":
        word = isinstance(options.gravity, str)
        content["rig"] = {"gravity": options.gravity if word else {"angle": f"{options.gravity:g} deg"}}
    if run.repeat_of:
        content["repeat_of"] = run.repeat_of
    write_text(folder / "experiment.yaml", yaml.safe_dump(content, sort_keys=False))


def _write_pressure(path: Path, run: Run, options: TwinOptions, generator: np.random.Generator) -> None:
    start, end = run.programme.time_s[[0, -1]]
    time = start + LOG_STEP_S * np.arange(int((end - start) / LOG_STEP_S + 1e-6) + 1)
    pressure = run.programme.at(time) / 1e3 + options.pressure_noise_kPa * generator.standard_normal(time.size)
    table = pd.DataFrame({"time_s": time, "pressure_kPa": pressure})
    write_text(path, table.to_csv(index=False, float_format="%.4f"))


def _write_valves(path: Path, valves: ValveCommands | None) -> None:
    if valves is not None:
        table = pd.DataFrame({"time_s": valves.time_s, "supply": valves.supply, "drain": valves.drain})
        write_text(path, table.astype({"supply": int, "drain": int}).to_csv(index=False, float_format="%.4f"))


def write_track(
    path: Path,
    camera_s: FloatArray,
    posture: Posture,
    options: TwinOptions,
    generator: np.random.Generator,
) -> None:
    """Write what a tracker would have seen at camera times (frames,) in s, with the noise that `options` asks for."""
    if options.observe == "angle":
        angle = np.degrees(posture.line(np.array([1.0]))[1][:, 0])
        noise = noise_like(angle.shape, options.noise_angle_deg, options.noise_correlation, generator)
        columns = {"angle_deg": angle + noise, "sigma_deg": np.full(angle.size, options.noise_angle_deg)}
    else:
        fraction, names = np.array([1.0]), ["tip_x_mm", "tip_y_mm"]
        if options.observe == "midline":
            fraction = np.linspace(0.0, 1.0, NODES)
            names = [f"{axis}{node:02d}_mm" for node in range(NODES) for axis in "xy"]
        points = misread_plane(posture.line(fraction)[0], options.hidden, options.actuator.mirror)
        points = points + noise_like(points.shape, options.noise_mm, options.noise_correlation, generator)
        columns = dict(zip(names, points.reshape(camera_s.size, -1).T, strict=True))
        columns["sigma_mm"] = np.full(camera_s.size, options.noise_mm)
    table = pd.DataFrame({"time_s": [f"{time:.6f}" for time in camera_s], **columns})
    write_text(path, table.to_csv(index=False, float_format="%.4f"))


def _write_exact(path: Path, camera_s: FloatArray, posture: Posture) -> None:
    points, phi = posture.line(np.linspace(0.0, 1.0, NODES))
    dataset = xr.Dataset(
        {
            "midline": (("time", "node", "xy"), points, {"units": "mm"}),
            "tip": (("time", "xy"), points[:, -1], {"units": "mm"}),
            "bend_angle": (("time",), np.degrees(phi[:, -1]), {"units": "deg"}),
            "width": (("time",), 2e3 * posture.outer_radius, {"units": "mm"}),
        },
        coords={"time": camera_s, "xy": ["x", "y"]},
    )
    write_dataset(path, dataset)
