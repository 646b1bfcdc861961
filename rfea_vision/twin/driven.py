"""Runs whose pressure a digital hydraulic drive makes: valve commands in, pressure out, the tube as its load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rfea_vision.drive import Drive, DutyControl, ValveCommands
from rfea_vision.errors import InputError
from rfea_vision.twin.draw import Run, move
from rfea_vision.twin.excitation import Programme
from rfea_vision.twin.options import TwinOptions
from rfea_vision.twin.plant import Plant, PlantMotion


def play(plant: Plant, run: Run, options: TwinOptions) -> tuple[PlantMotion, Run, ValveCommands | None]:
    """Let the plant play a run.

    With a drive the run comes back with the pressure that it made, and with what its valves were told.

    Raises
    ------
    InputError
        A lag of the line is hidden; a drive has its own.
    """
    if options.drive is None:
        return move(plant, run, options.step_s), run, None
    if plant.law.hidden("pressure_lag.T") > 0:
        raise InputError(
            "simulate: pressure_lag cannot hide behind --drive, which has its own line; choose one of them"
        )
    wanted = run.programme
    control = DutyControl(lambda time: float(wanted.at(np.array([time]))[0]))
    valves = control if options.drive == "duty" else options.drive
    start, end = float(wanted.time_s[0]), float(wanted.time_s[-1])
    drive = Drive(pressure_Pa=0.0)
    line, told = [0.0], []

    def felt(pressure: float) -> float:
        return float(plant.felt_pressure(np.array([0.0]), np.array([pressure]))[0])

    def supply(time: float, flow: float) -> float:
        told.append((time - options.step_s, *valves.at(time - options.step_s, drive.state.pressure_Pa)))
        line.append(drive.step(options.step_s, supply=told[-1][1], drain=told[-1][2], tube_flow_m3_s=flow))
        return felt(line[-1])

    motion = plant.run(lambda time: np.full(time.shape, felt(0.0)), start, end, options.step_s, supply=supply)
    commands = np.array(told)
    changes = np.any(np.diff(commands[:, 1:], axis=0, prepend=-1.0) != 0, axis=1)
    made = replace(run, programme=Programme(wanted.kind, motion.time_s, np.array(line)))
    return motion, made, ValveCommands(*commands[changes].T)
