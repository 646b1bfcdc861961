"""Calibration: are distances on the plane of motion right, and do the uncertainties say so?"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.calibration.projection import perturbed_cameras, pixels_to_plane_mm, unproject
from testing.board_photos import RayCamera, photo, poses, texture_of
from testing.scenes import Lens

SCENES = 40
RIG_MM = np.array([[0.0, 0.0], [-30.0, -150.0], [-110.0, -90.0], [-118.0, -40.0], [0.0, -155.0], [-75.0, -130.0]])


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    cv2.setNumThreads(1)
    errors, predicted, seconds = [], [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lens = Lens().scaled(0.5)
        board = Board("checkerboard", (9, 6), 0.012)
        camera, texture = RayCamera(lens.size, lens.matrix, lens.distortion), texture_of(board)
        in_plane = lens.rotation, lens.translation + lens.rotation @ np.array([-100.0, 45.0, 0.0])
        for scene in range(SCENES):
            rng = np.random.default_rng(500 + scene)
            files = []
            for k, pose in enumerate(poses(camera, board, 12, 500 + scene, distance=(190, 380))):
                files.append(folder / f"{scene}_{k}.png")
                cv2.imwrite(str(files[-1]), photo(camera, board, texture, *pose, rng))
            plane = folder / f"{scene}_plane.png"
            cv2.imwrite(str(plane), photo(camera, board, texture, *in_plane, rng))
            begun = time.perf_counter()
            calibration = calibrate(files, plane, board)
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
            "target": "92 to 98",
            "met": 92 <= inside <= 98,
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
