"""Board photos in, `Calibration` out: corners, lens models, plane of motion, uncertainty."""

from rfea_vision.calibration.board import Board
from rfea_vision.calibration.calibrate import calibrate
from rfea_vision.calibration.projection import mm_per_pixel, pixels_to_plane_mm, plane_mm_to_pixels
from rfea_vision.calibration.storage import load_calibration, save_calibration, save_ros

__all__ = [
    "Board",
    "calibrate",
    "load_calibration",
    "mm_per_pixel",
    "pixels_to_plane_mm",
    "plane_mm_to_pixels",
    "save_calibration",
    "save_ros",
]
