"""A film that needs a hint: two tubes hang side by side, and the one that stands out more is not the one that is driven."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from testing.scenes import Lens, Look, film

APART_MM = 70.0
FRAMES, RATE_HZ = 60, 60.0
HIDDEN = range(40, 46)  # somebody stands before the camera
LAMP_PX = (12, 16, 14, 14)  # left, top, width, height: it follows the log's column `blink`
SWITCHED_S = (0.09, 0.21, 0.39, 0.44, 0.56, 0.83)  # on, off, on ...
OFFSET_S = 0.42  # log clock minus camera clock


def lit(time_s: np.ndarray | float) -> np.ndarray:
    """Whether the lamp is on at these times of the camera's clock."""
    return np.searchsorted(SWITCHED_S, time_s) % 2 == 1


def write_log(folder: Path) -> None:
    """Add the log of the film's pressure, on a clock of its own, with the lamp's signal."""
    times = np.arange(-0.5, 1.5, 0.004)
    log = np.column_stack([times + OFFSET_S, 40 * (1 - np.cos(2 * np.pi * times)), 5 * lit(times)])
    np.savetxt(folder / "swing" / "pressure.csv", log, "%.4f", ",", header="time_s,pressure_kPa,blink", comments="")
    with (folder / "swing" / "experiment.yaml").open("a") as file:
        file.write("pressure: {file: pressure.csv}\n")


def write_film(folder: Path) -> dict[str, list[float]]:
    """Write the campaign; returns pixels of the driven tube: the two edges of its clamp and its tip, and the other's middle."""
    lens = Lens(distortion=np.zeros(5), rotation=np.eye(3), translation=np.array([40.0, -80.0, 400.0])).scaled(0.5)
    beside = Lens(**{**vars(lens), "translation": lens.translation - [APART_MM, 0, 0]})
    times = np.arange(FRAMES) / RATE_HZ
    driven, _, shapes = film(lens, Look(tube=120.0), 2 + 7 * (1 - np.cos(2 * np.pi * times)), rate_Hz=RATE_HZ)
    still, _, _ = film(beside, Look(tube=215.0), [2.0], rate_Hz=RATE_HZ)
    run = folder / "swing"
    (run / "frames").mkdir(parents=True)
    half = round(float(lens.project(np.array([[-APART_MM / 2, 0.0]]))[0, 0]))
    x, y, wide, high = LAMP_PX
    for number, picture in enumerate(driven):
        if number in HIDDEN:
            picture = np.full_like(picture, 60)
        seen = np.hstack([still[0][:, :half] if number not in HIDDEN else picture[:, :half], picture[:, half:]])
        seen[y : y + high, x : x + wide] = 230 if lit(times[number]) else 30
        cv2.imwrite(str(run / "frames" / f"{number:03d}.png"), seen)
    rows = [f"{number:03d}.png,{time:.6f}" for number, time in enumerate(times)]
    (run / "frames.csv").write_text("file,time_s\n" + "\n".join(rows) + "\n")
    edges = lens.project(np.array([[-4.0, 0.0], [4.0, 0.0]]))
    tip = lens.project(shapes[0].tip[None])[0]
    (folder / "campaign.yaml").write_text(
        "format: rfea-campaign/1\nname: two tubes  # bench 3\n"
        "camera:\n  # no board at hand that day\n  scale: {points: "
        f"[{[round(float(v), 1) for v in edges.mean(axis=0)]}, {[round(float(v), 1) for v in tip]}], distance: 155 mm}}\n"
    )
    (run / "experiment.yaml").write_text(
        "format: rfea-experiment/1\nname: swing\nrole: train  # the only one\nframes: {folder: frames, times: frames.csv}\n"
    )
    return {"left": edges[0].tolist(), "right": edges[1].tolist(), "tip": tip.tolist(), "other": [half / 2, 300.0]}
