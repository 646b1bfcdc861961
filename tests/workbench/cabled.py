"""A campaign whose tube is only found with hints: pale, on ruled paper, before cables of its own width's half."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from testing.phone import Arm, Room, Truth, film

RATE_HZ, FRAMES = 40.0, 100
OFFSET_S = 1.234  # log clock minus camera clock
CLAMP_PX, LENGTH_MM, PX_PER_MM = (120.0, 40.0), 90.0, 2.2
#: Roles, and from when (s) which pressure (kPa) is held.
RUNS = {"steps": ("train", {0.3: 120, 1.1: 40, 1.7: 75}), "held-out": ("validate", {0.3: 90, 1.1: 150, 1.8: 60})}


def cables(picture: np.ndarray) -> None:
    """Seven of them, behind the tube."""
    for row in range(60, 240, 28):
        cv2.line(picture, (0, row), (240, row + 15), (90.0, 120.0, 140.0), 6, cv2.LINE_AA)


def bend_rad(pressure_kPa: np.ndarray, step_s: float) -> np.ndarray:
    """A tube of one mode, and a spring behind a dashpot beside its stiffness: what the paper's model lacks."""
    frequency, damping, relaxing, decay_s, gain = 2 * np.pi * 2.5, 0.12, 0.25, 0.4, 0.9 / 150
    bend, rate, stretched, found = gain * pressure_kPa[0], 0.0, 0.0, []
    for pressure in pressure_kPa:
        force = gain * pressure - bend - relaxing * stretched
        rate += step_s * (frequency**2 * force - 2 * damping * frequency * rate)
        bend += step_s * rate
        stretched += step_s * (rate - stretched / decay_s)
        found.append(bend)
    return np.array(found)


def write_campaign(folder: Path) -> Truth:
    """Write films, logs and files without hints; the first frame shows the same in every film."""
    rng = np.random.default_rng(1)
    fine = np.arange(-0.5, FRAMES / RATE_HZ + 0.5, 1e-3)
    window = np.hanning(61) / np.hanning(61).sum()  # a valve opens in some hundredths of a second
    pale = Arm(length=LENGTH_MM, opacity=0.8, rgb=(205.0, 205.0, 200.0), glare=0.2, marks=4, swell=0.1)
    for number, (name, (role, steps)) in enumerate(RUNS.items()):
        held = np.array([10.0, *steps.values()])[np.searchsorted([*steps], fine, side="right")]
        pressure = np.convolve(np.pad(held, 30, mode="edge"), window, mode="valid")
        run = folder / name
        run.mkdir(parents=True)
        room = Room((240, 260), PX_PER_MM, CLAMP_PX, ruled=6.0, seed=4 + number, more=cables)
        bends = np.interp(np.arange(FRAMES) / RATE_HZ, fine, bend_rad(pressure, 1e-3))
        arm = replace(pale, stretch=pale.half_width * bends.max() / LENGTH_MM)  # the outer side keeps its length
        truth = film(run / "film.mp4", arm, room, -bends, rate_Hz=RATE_HZ)
        log = np.column_stack([fine + OFFSET_S, pressure + rng.normal(0, 0.2, fine.size)])[::5]
        np.savetxt(run / "pressure.csv", log, "%.4f", ",", header="time_s,pressure_kPa", comments="")
        (run / "experiment.yaml").write_text(
            f"format: rfea-experiment/1\nname: {name}\nrole: {role}\nvideo: {{file: film.mp4}}\npressure: {{file: pressure.csv}}\n"
        )
    x, y = CLAMP_PX
    (folder / "campaign.yaml").write_text(
        "format: rfea-campaign/1\nname: cables  # hang behind the tube\n"
        f"actuator: {{length: {LENGTH_MM:g} mm, outer_radius: 6 mm, inner_radius: 4 mm, bends: left}}\n"
        f"camera: {{scale: {{points: [[{x}, {y}], [{x}, {y + LENGTH_MM * PX_PER_MM}]], distance: {LENGTH_MM:g} mm}}}}\n"
    )
    return truth
