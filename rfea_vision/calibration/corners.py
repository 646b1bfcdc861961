"""Board corners in a photo, to a fraction of a pixel, or the reason why not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.calibration.board import Board

MINIMUM_CORNERS = 8
BLURRED_RISE_OF_SQUARE = 0.33


@dataclass(frozen=True)
class BoardView:
    """Corners of one photo: on the board (n, 2) mm, in the picture (n, 2) px; `rise_px` is the 10-90 % edge rise."""

    file: Path
    board_mm: NDArray[np.float64]
    pixels: NDArray[np.float64]
    rise_px: float = float("nan")


@dataclass(frozen=True)
class Refused:
    """A photo that was left out, and why."""

    file: Path
    reason: str


def read_grey(path: Path) -> NDArray[np.uint8] | None:
    """Read a picture as grey levels; None if it cannot be read."""
    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError:
        return None
    if data.size == 0:
        return None
    return cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)  # pyright: ignore[reportReturnType]


def find_corners(path: Path, grey: NDArray[np.uint8], board: Board) -> BoardView | Refused:
    """Find the board in one photo.

    A checkerboard must be whole (its corners carry no names); of a ChArUco board any part with enough corners counts.
    """
    if board.kind == "charuco":
        return _find_charuco(path, grey, board)
    found = _find_checkerboard(grey, board.inner_corners)
    if found is None:
        return Refused(path, _why_no_checkerboard(grey, board.inner_corners))
    square_px = _smallest_spacing(found, board.inner_corners)
    height, width = grey.shape
    to_border = float(min(found.min(), width - 1 - found[:, 0].max(), height - 1 - found[:, 1].max()))
    if to_border < 0.25 * square_px:
        return Refused(
            path, f"incomplete: cut off, a corner lies {max(to_border, 0.0):.0f} px from the border of the picture"
        )
    rise = _edge_rise(grey, found, board.inner_corners)
    if rise > BLURRED_RISE_OF_SQUARE * square_px:
        return Refused(path, f"blurred: its edges rise over {rise:.1f} px, its squares are {square_px:.0f} px")
    return BoardView(path, board.corners_mm, found, rise)


def _find_checkerboard(grey: NDArray[np.uint8], grid: tuple[int, int]) -> NDArray[np.float64] | None:
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(grey, grid, flags=flags)
    if not found:
        found, corners = cv2.findChessboardCornersSB(grey, grid, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return None
    corners = np.asarray(corners, dtype=np.float32).reshape(-1, 1, 2)
    half = int(np.clip(0.35 * _smallest_spacing(corners[:, 0], grid), 3, 11))
    return refine_corners(grey, corners[:, 0], half)


def refine_corners(grey: NDArray[np.uint8], corners: NDArray[np.floating], half_px: int) -> NDArray[np.float64]:
    """Sub-pixel corners from the gradients within `half_px`."""
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    start = np.ascontiguousarray(corners, dtype=np.float32).reshape(-1, 1, 2)
    refined = cv2.cornerSubPix(grey, start, (half_px, half_px), (-1, -1), criteria)
    return np.asarray(refined, dtype=float).reshape(-1, 2)


def _smallest_spacing(corners: NDArray[np.floating], grid: tuple[int, int]) -> float:
    lattice = np.asarray(corners, dtype=float).reshape(grid[1], grid[0], 2)
    along = np.linalg.norm(np.diff(lattice, axis=1), axis=-1)
    across = np.linalg.norm(np.diff(lattice, axis=0), axis=-1)
    return float(min(along.min(), across.min()))


def _edge_rise(grey: NDArray[np.uint8], corners: NDArray[np.float64], grid: tuple[int, int]) -> float:
    """10-90 % rise, in px, of the edges between neighbouring corners of a row, from contrast over steepest slope."""
    lattice = corners.reshape(grid[1], grid[0], 2)
    middle = 0.5 * (lattice[:, 1:] + lattice[:, :-1]).reshape(-1, 2)
    along = (lattice[:, 1:] - lattice[:, :-1]).reshape(-1, 2)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / length
    reach = 0.4 * length
    steps = np.linspace(-1, 1, 61)
    places = middle[:, None, :] + steps[None, :, None] * (reach * normal)[:, None, :]
    profile = cv2.remap(grey, places.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # pyright: ignore[reportCallIssue, reportArgumentType]
    profile = np.asarray(profile, dtype=float).reshape(len(middle), 61)
    swing = np.abs(np.median(profile[:, :10], axis=1) - np.median(profile[:, -10:], axis=1))
    smooth = (profile[:, :-2] + profile[:, 1:-1] + profile[:, 2:]) / 3
    slope = np.abs(np.diff(smooth, axis=1)).max(axis=1) / (steps[1] - steps[0]) / reach[:, 0]
    good = swing > 10
    # A Gaussian edge of contrast c and steepest slope m rises from 10 to 90 % over 1.02 c / m.
    return float(np.median(1.02 * swing[good] / slope[good])) if good.any() else float("inf")


def _why_no_checkerboard(grey: NDArray[np.uint8], grid: tuple[int, int]) -> str:
    columns, rows = grid
    for fewer in ((columns, rows - 1), (columns - 1, rows), (columns - 1, rows - 1), (columns - 2, rows)):
        if min(fewer) < 3:
            continue
        found, _ = cv2.findChessboardCornersSB(grey, fewer)
        if found:
            return f"incomplete: only {fewer[0]} x {fewer[1]} of its {columns} x {rows} corners are in the picture"
    small = cv2.GaussianBlur(grey, (0, 0), 1.0)
    contrast = float(np.percentile(small, 95) - np.percentile(small, 5))
    detail = float(np.percentile(np.abs(cv2.Laplacian(small, cv2.CV_64F)), 99))
    if contrast > 20 and detail < 0.06 * contrast:
        return "blurred: no sharp corners in it"
    return f"no board of {columns} x {rows} corners found: cut off, hidden, or another board"


def _find_charuco(path: Path, grey: NDArray[np.uint8], board: Board) -> BoardView | Refused:
    best: tuple[NDArray[np.float64], NDArray[np.int64]] | None = None
    for legacy in (False, True):
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board.charuco(legacy=legacy)).detectBoard(grey)
        if ids is not None and (best is None or len(ids) > len(best[1])):
            best = np.asarray(corners, dtype=float).reshape(-1, 2), np.asarray(ids, dtype=np.int64).ravel()
    if best is None or len(best[1]) < MINIMUM_CORNERS:
        count = 0 if best is None else len(best[1])
        return Refused(
            path,
            f"incomplete: {count} of its corners found, {MINIMUM_CORNERS} needed (cut off, blurred, or another board)",
        )
    pixels, ids = best
    board_mm = board.corners_mm[ids]
    if np.linalg.matrix_rank(board_mm - board_mm.mean(axis=0)) < 2:
        return Refused(path, "incomplete: its corners lie on one line")
    spacing = np.linalg.norm(pixels[:, None] - pixels[None], axis=-1)
    np.fill_diagonal(spacing, np.inf)
    half = int(np.clip(0.25 * np.median(spacing.min(axis=1)), 3, 9))
    return BoardView(path, board_mm, refine_corners(grey, pixels, half))
