"""Board corners in a photo, to a fraction of a pixel, or the reason why not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rfea_vision.calibration.board import Board
from rfea_vision.calibration.saddle import fit_corners

MINIMUM_CORNERS = 8  # twice the four that a homography needs
NEIGHBOURS = 6  # nearest corners that say the size of a square
SMOOTHING = 0.17  # of the window's reach
BLURRED_RISE_OF_SQUARE = 0.33  # an edge that rises over a third of a square is blurred
LEAST_CONTRAST = 12.0  # grey levels
MOST_WHITE = 0.3  # of the picture


@dataclass(frozen=True)
class BoardView:
    """Corners of one photo: on the board (n, 2) mm, in the picture (n, 2) px; `rise_px` is the 10-90 % edge rise."""

    file: Path
    board_mm: NDArray[np.float64]
    pixels: NDArray[np.float64]
    rise_px: float = float("nan")


@dataclass(frozen=True)
class Refused:
    """A photo that was left out, and why; `shown` is the grid of corners that it does show, if any."""

    file: Path
    reason: str
    shown: tuple[int, int] | None = None


def find_corners(path: Path, grey: NDArray[np.uint8], board: Board) -> BoardView | Refused:
    """Find the board in one photo, of grey levels (rows, columns).

    A checkerboard must be whole (its corners carry no names); of a ChArUco board any part with enough corners counts.
    """
    if board.kind == "charuco":
        return _find_charuco(path, grey, board)
    found = _find_checkerboard(grey, board.inner_corners)
    if found is None:
        return _why_no_checkerboard(path, grey, board.inner_corners)
    square_px = _smallest_spacing(found, board.inner_corners)
    height, width = grey.shape
    to_border = float(min(found.min(), width - 1 - found[:, 0].max(), height - 1 - found[:, 1].max()))
    if to_border < 0.25 * square_px:
        return Refused(
            path, f"incomplete: cut off, a corner lies {max(to_border, 0.0):.0f} px from the border of the picture"
        )
    rise = _edge_rise(grey, found, board.inner_corners)
    if not np.isfinite(rise):  # no edges between them
        another = _why_no_checkerboard(path, grey, board.inner_corners)
        if another.shown not in (None, _larger_first(board.inner_corners)):
            return another
    if rise > BLURRED_RISE_OF_SQUARE * square_px:
        return _blurred(path, rise, square_px)
    return BoardView(path, board.corners_mm, found, rise)


def _find_checkerboard(grey: NDArray[np.uint8], grid: tuple[int, int]) -> NDArray[np.float64] | None:
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(grey, grid, flags=flags)
    if not found:
        found, corners = cv2.findChessboardCornersSB(grey, grid, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return None
    corners = np.asarray(corners, dtype=float).reshape(-1, 2)
    columns, rows = grid
    y, x = np.mgrid[0:rows, 0:columns]
    half = int(np.clip(0.35 * _smallest_spacing(corners, grid), 3, 11))
    return refine_corners(
        grey,
        corners,
        np.column_stack([x.ravel(), y.ravel()]).astype(float),
        half,
        float(np.clip(SMOOTHING * half, 0.5, 1.5)),
    )


def refine_corners(
    grey: NDArray[np.uint8], corners: NDArray[np.float64], board: NDArray[np.float64], half_px: int, smoothing_px: float
) -> NDArray[np.float64]:
    """Sub-pixel corners (n, 2) px from the grey levels (rows, columns) within `half_px` of `corners` (n, 2) px.

    `board` (n, 2) are their places on the board, in any unit; `smoothing_px` is the standard deviation of the blur before the fit.
    """
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    start = np.ascontiguousarray(corners, dtype=np.float32).reshape(-1, 1, 2)
    near = cv2.cornerSubPix(grey, start, (half_px, half_px), (-1, -1), criteria)
    near = np.asarray(near, dtype=float).reshape(-1, 2)
    # Pixels sample an edge; what lies beyond their reach folds back and moves an edge that is level in the picture by
    # up to 0.02 px, period one pixel. Smoothing first takes that off at next to no cost in noise.
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), smoothing_px)
    fitted, _ = fit_corners(
        np.asarray(smooth, dtype=np.float32), near, _edge_normals(near, board), half_px, limit_px=0.3 * half_px
    )
    lost = ~np.isfinite(fitted[:, 0])
    # A corner beside the border of the picture, or under a reflection, keeps the place that its gradients give.
    return np.where(lost[:, None], near, fitted)


def _edge_normals(corners: NDArray[np.float64], board: NDArray[np.float64]) -> NDArray[np.float64]:
    """Directions, in the picture, of the normals of the two edges at each corner, from its neighbours, (n, 2) rad."""
    count = min(NEIGHBOURS, len(board) - 1)
    apart = np.linalg.norm(board[:, None] - board[None], axis=-1)
    nearest = np.argsort(apart, axis=1, kind="stable")[:, 1 : count + 1]
    by = board[nearest] - board[:, None]
    to = corners[nearest] - corners[:, None]
    along = np.linalg.pinv(by) @ to  # (n, 2 board axes, 2)
    return np.arctan2(along[..., 1], along[..., 0]) + np.pi / 2


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


def _why_no_checkerboard(path: Path, grey: NDArray[np.uint8], grid: tuple[int, int]) -> Refused:
    columns, rows = grid
    found = _shown_board(grey)
    shown = None if found is None else _larger_first(found[1])
    small = cv2.GaussianBlur(grey, (0, 0), 1.0)
    contrast = float(np.percentile(small, 95) - np.percentile(small, 5))
    if contrast < LEAST_CONTRAST:
        return Refused(path, f"no board found: black and white are only {contrast:.0f} grey levels apart")
    if found is not None:
        rise, square = _edge_rise(grey, *found), _smallest_spacing(*found)
        if rise > BLURRED_RISE_OF_SQUARE * square:
            return _blurred(path, rise, square)
    white = float(np.mean(grey >= 254))
    if white > MOST_WHITE:
        return Refused(path, f"too bright: {100 * white:.0f} % of the picture is plain white", shown)
    if shown is not None and sorted(shown) != sorted(grid):
        if all(a <= b for a, b in zip(sorted(shown), sorted(grid), strict=True)):
            reason = f"incomplete: only {shown[0]} x {shown[1]} of its {columns} x {rows} corners are seen"
            if shown == (columns - 1, rows - 1):
                reason += "; inner_corners are those between squares, one fewer than squares each way"
            return Refused(path, reason, shown)
        reason = f"another board: {shown[0]} x {shown[1]} inner corners are seen, {columns} x {rows} were looked for"
        return Refused(path, reason, shown)
    detail = float(np.percentile(np.abs(cv2.Laplacian(small, cv2.CV_64F)), 99))
    if detail < 0.06 * contrast:
        return Refused(path, "blurred: no sharp corners in it")
    return Refused(path, f"no board of {columns} x {rows} corners found: cut off, hidden, blurred, or another board")


def _blurred(path: Path, rise_px: float, square_px: float) -> Refused:
    if not np.isfinite(rise_px):
        return Refused(path, "too dark or too bright: the board's squares hardly differ")
    return Refused(path, f"blurred: its edges rise over {rise_px:.1f} px, its squares are {square_px:.0f} px")


def _shown_board(grey: NDArray[np.uint8]) -> tuple[NDArray[np.float64], tuple[int, int]] | None:
    """Corners (n, 2), row by row, of whatever checkerboard is in the picture, and how many per (row, column)."""
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(grey, (3, 3), flags)
    if not found or meta is None:
        return None
    rows, columns = np.asarray(meta).shape[:2]
    places = np.asarray(corners, dtype=float).reshape(-1, 2)
    if (columns, rows) == (3, 3) or _smallest_spacing(places, (columns, rows)) < 3:
        return None  # the seed alone, from which nothing grew, is found in any texture
    return places, (columns, rows)


def shown_grid(grey: NDArray[np.uint8]) -> tuple[int, int] | None:
    """Inner corners, the larger number first, of the largest checkerboard in a picture (rows, columns); None without one."""
    found = _shown_board(grey)
    return None if found is None else _larger_first(found[1])


def _larger_first(grid: tuple[int, int]) -> tuple[int, int]:
    return max(grid), min(grid)


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
    # Markers must stay out of the window, and must not be smeared into it: their corners come as near as the diagonal
    # of their margin.
    diagonal = (board.square_m - (board.marker_m or 0.0)) / (np.sqrt(2) * board.square_m)
    half = int(np.clip(0.7 * diagonal * np.median(spacing.min(axis=1)), 3, 9))
    return BoardView(path, board_mm, refine_corners(grey, pixels, board_mm, half, 0.3))
