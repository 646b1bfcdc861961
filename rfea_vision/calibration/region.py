"""How far a calibration can be trusted where the tube is: in mm on the plane of motion, and as a share of its length."""

from __future__ import annotations

import numpy as np

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Calibration, Track
from rfea_vision.artefacts.rows import RegionQuality
from rfea_vision.calibration.projection import (
    has_plane,
    perturbed_cameras,
    pixels_to_plane_mm,
    plane_mm_to_pixels,
    unproject,
)
from rfea_vision.lines import rig_axes

MOST_FRAMES = 40  # of a track: the region that it visits changes slowly


def place_covariance_mm2(calibration: Calibration, points_mm: FloatArray, origin_mm: FloatArray) -> FloatArray:
    """Covariance (n, 2, 2) mm^2 of plane points (n, 2) mm relative to an origin (2,) that is itself seen."""
    every = np.vstack([np.asarray(origin_mm, dtype=float)[None], np.asarray(points_mm, dtype=float)])
    pixels = plane_mm_to_pixels(calibration, every)
    moved = np.array([unproject(camera, pixels) - every for camera in perturbed_cameras(calibration)])
    if moved.size == 0:
        return np.zeros((len(points_mm), 2, 2))
    change = moved[:, 1:] - moved[:, :1]
    return np.einsum("kni,knj->nij", change, change)


def halves_difference_mm(calibration: Calibration, points_mm: FloatArray, origin_mm: FloatArray) -> FloatArray | None:
    """By how much (n,) mm the two halves of the photos disagree about plane points; None where they were not solved."""
    cameras = calibration.quality.get("cross_validation", {}).get("halves")
    if not cameras:
        return None
    every = np.vstack([np.asarray(origin_mm, dtype=float)[None], np.asarray(points_mm, dtype=float)])
    pixels = plane_mm_to_pixels(calibration, every)
    first, second = (unproject(np.asarray(camera, dtype=float), pixels) for camera in cameras)
    apart = (first - first[0]) - (second - second[0])
    return np.linalg.norm(apart[1:], axis=1)


def over_region(
    calibration: Calibration,
    points_mm: FloatArray,
    origin_mm: FloatArray,
    length_mm: float,
    where: str = "where the tube is",
) -> RegionQuality:
    """Standard error and cross-validated difference over a region, and a sentence.

    Parameters
    ----------
    points_mm : (n, 2) on the plane of motion
    origin_mm : (2,) the clamp on that plane
    length_mm : of the tube
    where : the region, as the sentence calls it
    """
    sigma = np.sqrt(np.trace(place_covariance_mm2(calibration, points_mm, origin_mm), axis1=1, axis2=2))
    worst, usual = float(np.nanmax(sigma)), float(np.sqrt(np.nanmean(sigma**2)))
    found: RegionQuality = {
        "sigma_mm": usual,
        "sigma_worst_mm": worst,
        "sigma_percent_of_length": 100 * usual / length_mm,
        "sigma_worst_percent_of_length": 100 * worst / length_mm,
    }
    sentence = (
        f"{where}, the calibration places a point to {usual:.3g} mm ({100 * usual / length_mm:.2g} % of the "
        f"tube's length), {worst:.3g} mm at worst"
    )
    apart = halves_difference_mm(calibration, points_mm, origin_mm)
    if apart is not None:
        disagree_mm = float(np.sqrt(np.nanmean(apart**2)))
        found["cross_validated_mm"] = disagree_mm
        sentence += f"; two halves of the photos disagree there by {disagree_mm:.3g} mm"
    found["sentence"] = sentence
    return found


def visited(calibration: Calibration, track: Track, length_mm: float) -> RegionQuality | None:
    """The same over the places that a tracked tube has visited; None where the track does not say where they are."""
    dataset = track.dataset
    needed = ("clamp_plane_x_mm", "clamp_plane_y_mm", "down_plane_x", "down_plane_y")
    if not has_plane(calibration) or "midline" not in dataset or any(key not in dataset.attrs for key in needed):
        return None
    origin = np.array([dataset.attrs["clamp_plane_x_mm"], dataset.attrs["clamp_plane_y_mm"]])
    down = np.array([dataset.attrs["down_plane_x"], dataset.attrs["down_plane_y"]])
    valid = np.flatnonzero(track.valid)
    if len(valid) == 0:
        return None
    chosen = valid[np.linspace(0, len(valid) - 1, min(MOST_FRAMES, len(valid))).astype(int)]
    line = dataset["midline"].values[chosen][:, 2::3].reshape(-1, 2)
    return over_region(calibration, origin + line @ rig_axes(down), origin, length_mm)


def reach_of(calibration: Calibration, clamp_px: FloatArray, length_mm: float) -> tuple[FloatArray, FloatArray]:
    """Places that a tube clamped at given pixels can reach, hanging to either side: (n, 2) mm, and its origin."""
    origin = pixels_to_plane_mm(calibration, np.mean(np.asarray(clamp_px, dtype=float).reshape(-1, 2), axis=0))
    radius, angle = np.meshgrid(length_mm * np.array([0.4, 0.7, 1.0]), np.radians(np.linspace(-180, 0, 13)))
    places = origin + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1).reshape(-1, 2)
    seen = _in_picture(calibration, places)
    return (seen if len(seen) else places), origin


def middle_of(calibration: Calibration, length_mm: float) -> tuple[FloatArray, FloatArray]:
    """Places around the middle of the picture that a tube could fill, (n, 2) mm, and the place above them to clamp it."""
    size = np.array([calibration.image_width, calibration.image_height], dtype=float)
    centre = pixels_to_plane_mm(calibration, size / 2)
    offsets = 0.5 * length_mm * np.stack(np.meshgrid([-1.0, -0.5, 0, 0.5, 1], [-1.0, -0.5, 0, 0.5]), axis=-1)
    places = centre + offsets.reshape(-1, 2)
    seen = _in_picture(calibration, places)
    return (seen if len(seen) else centre[None]), centre + np.array([0.0, 0.5 * length_mm])


def _in_picture(calibration: Calibration, places: FloatArray) -> FloatArray:
    """Those of the places (n, 2) mm on the plane that the camera sees."""
    pixels = plane_mm_to_pixels(calibration, places)
    last = [calibration.image_width - 1, calibration.image_height - 1]
    return places[np.all((pixels >= 0) & (pixels <= last), axis=1)]
