"""Calibration: are distances on the plane of motion right, and do the uncertainties say so?"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rfea_vision.calibration import Board, calibrate
from rfea_vision.calibration.projection import perturbed_cameras, pixels_to_plane_mm, unproject
from tests.measurement.scenes import Lens, board_pictures, plane_picture

SCENES = 12
RIG_MM = np.array([[0.0, 0.0], [-30.0, -150.0], [-110.0, -90.0], [-118.0, -40.0], [0.0, -155.0], [-75.0, -130.0]])


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    cv2.setNumThreads(1)
    errors, predicted, seconds = [], [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for scene in range(SCENES):
            lens = Lens().scaled(0.5)
            files = []
            for k, image in enumerate(board_pictures(lens, 12, 500 + scene)):
                files.append(folder / f"{scene}_{k}.png")
                cv2.imwrite(str(files[-1]), image)
            plane = folder / f"{scene}_plane.png"
            cv2.imwrite(str(plane), plane_picture(lens, scene))
            begun = time.perf_counter()
            calibration = calibrate(files, plane, Board("checkerboard", (9, 6), 0.012))
            seconds.append(time.perf_counter() - begun)
            pixels = lens.project(RIG_MM)
            found = pixels_to_plane_mm(calibration, pixels)
            errors.append((found - found[0] - RIG_MM)[1:])
            moved = [unproject(camera, pixels) for camera in perturbed_cameras(calibration)]
            changes = np.array([(m - m[0]) - (found - found[0]) for m in moved])
            predicted.append(np.sqrt(np.sum(changes**2, axis=0))[1:])
    error, sigma = np.array(errors), np.array(predicted)
    rms = float(np.sqrt(np.mean(np.sum(error**2, axis=-1))))
    inside = 100 * float(np.mean(np.abs(error) < 1.96 * sigma))
    said = (
        f"{SCENES} scenes of 12 photos, 360 x 640 px, 2 px/mm; distance from the clamp to places that the tube visits"
    )
    return [
        {
            "name": "place on the plane of motion",
            "value": round(rms, 4),
            "unit": "mm",
            "target": "<= 0.1",
            "met": rms <= 0.1,
            "against": said,
        },
        {
            "name": "95 % interval of a place contains the truth",
            "value": round(inside, 1),
            "unit": "%",
            "target": "90 to 99",
            "met": 90 <= inside <= 99,
            "against": said,
        },
        {
            "name": "time of a calibration",
            "value": round(float(np.median(seconds)), 2),
            "unit": "s",
            "target": "none",
            "met": None,
            "against": said,
        },
    ]
