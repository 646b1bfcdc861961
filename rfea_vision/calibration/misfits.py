"""Photos that show the board well and still do not belong with the others: bent, shaken, zoomed, turned, mirrored, copies.

Such photos hardly show in the residuals of all, since the six numbers of each pose swallow most of what is wrong, and
yet they move the principal point by many standard errors. So the lens is sought that the larger half of the photos agree
on (least trimmed squares, Rousseeuw 1984), and the others are judged by it.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.calibration.board import Board
from rfea_vision.calibration.bundle import Lens, solve_bundle, solve_pose
from rfea_vision.calibration.corners import BoardView, Refused, shown_grid
from rfea_vision.calibration.photos import Photo, read_photo
from rfea_vision.calibration.projection import rms_distance
from rfea_vision.errors import DataError

ASKED_FOR_GRID = 4  # photos, a quarter of a second each: in one of six a stray corner had grown a grid by a row
FEWEST = 4  # photos: of fewer, nobody knows which is the bad one
POOR_PHOTO, POOR_PX = 3.0, 0.1  # times the median distance, and at least so much
STARTS, START_WITH, ROUNDS = 6, 5, 4  # random sets of photos, photos in each, and rounds of leaving out
WORSE, EXPLAINED = 1.5, 0.5  # times the median distance before, and what is left of it once the photo is turned back
_TURNS = {"turned by half": (True, True), "mirrored": (True, False), "mirrored upside down": (False, True)}


def same_picture(path: Path, grey: NDArray[np.uint8], seen: dict[str, Path]) -> Refused | None:
    """Refuse a photo (rows, columns) that is, pixel by pixel, an earlier one: it would count twice. `seen` remembers them."""
    key = hashlib.sha256(str(grey.shape).encode() + grey.tobytes()).hexdigest()
    earlier = seen.setdefault(key, path)
    return None if earlier == path else Refused(path, f"the same picture as {earlier.name}")


def refuse_part_of_larger(views: Sequence[BoardView], board: Board, like: Photo | None) -> None:
    """Refuse a declared checkerboard that is only a part of the one in the photos: which part was found may differ.

    Raises
    ------
    DataError
        If two of the first photos show the same larger grid, before one shows the declared one.
    """
    declared, larger = sorted(board.inner_corners), Counter[tuple[int, int]]()
    for view in views[:ASKED_FOR_GRID] if board.kind == "checkerboard" else ():
        photo = read_photo(view.file)
        shown = None if photo is None else shown_grid(photo.shown(like))
        if shown is None:
            continue
        if sorted(shown) == declared:
            return
        larger[shown] += all(a >= b for a, b in zip(sorted(shown), declared, strict=True))
        if larger[shown] == 2:
            raise DataError(
                f"camera.board.inner_corners: [{board.inner_corners[0]}, {board.inner_corners[1]}] is a part of a larger "
                f"board: photos such as {view.file.name} show {shown[0]} x {shown[1]} inner corners; write "
                f"[{shown[0]}, {shown[1]}]"
            )


def without_misfits(
    views: Sequence[BoardView], size: tuple[int, int], models: Sequence[str]
) -> tuple[list[BoardView], list[Refused]]:
    """Leave out photos that do not agree with most of the others.

    Parameters
    ----------
    views : corners of every photo
    size : picture width and height in px
    models : lenses that may be the right one; what one of them explains is no misfit
    """
    far = np.ones(len(views), dtype=bool)
    solved: list[tuple[Lens, FloatArray]] = []
    for model in models if len(views) >= FEWEST else ():
        found = agreed_lens(views, size, model)
        if found is None:
            continue
        solved.append(found)
        far &= found[1] > _limit(found[1])
        if not far.any():
            break
    if not solved:
        return list(views), []
    lens, distance = min(solved, key=lambda item: float(np.median(item[1])))
    usual = float(np.median(distance))
    kept, refused = [], []
    for view, own, bad in zip(views, distance, far, strict=True):
        how = turned_against(lens, view, size, usual)
        if how:
            said = f"{how} against the others: turn it back, or take it again as the camera films"
            refused.append(Refused(view.file, said))
        elif bad:
            refused.append(Refused(view.file, _far_worse(float(own), usual)))
        else:
            kept.append(view)
    return (kept, refused) if len(kept) > len(refused) else (list(views), [])


def doubt_of_plane(
    plane_view: BoardView, views: Sequence[BoardView], size: tuple[int, int], model: str
) -> tuple[str, str]:
    """How the plane photo is turned against the others, and whether it fits far worse than they; empty where not."""
    lens = solve_bundle(views, size, model, reweight=False).lens
    distance = np.array([distance_px(lens, view) for view in views])
    usual, far = float(np.median(distance)), distance_px(lens, plane_view)
    doubt = f"{plane_view.file.name} {_far_worse(far, usual)}" if far > _limit(distance) else ""
    return turned_against(lens, plane_view, size, usual), doubt


def agreed_lens(views: Sequence[BoardView], size: tuple[int, int], model: str) -> tuple[Lens, FloatArray] | None:
    """Lens of the photos that agree, and the distance, px, of every photo (n,) from it; None if no fit succeeds."""
    count = len(views)
    half = max(count // 2 + 1, FEWEST - 1)
    generator = np.random.default_rng(0)
    starts = [np.arange(count)]
    starts += [generator.choice(count, START_WITH, replace=False) for _ in range(STARTS if count > START_WITH else 0)]
    found: list[tuple[float, NDArray[np.intp]]] = []
    for chosen in starts:
        for _ in range(ROUNDS):
            tried = _fit(views, chosen, size, model)
            if tried is None:
                break
            order = np.argsort(tried[1])[:half]
            found.append((float(np.sum(tried[1][order] ** 2)), order))
            if set(order) == set(chosen):
                break
            chosen = order
    if not found:
        return None
    best, kept = None, min(found, key=lambda item: item[0])[1]
    for _ in range(ROUNDS):
        best = _fit(views, kept, size, model) or best
        if best is None:
            return None
        more = np.flatnonzero(best[1] <= _limit(best[1]))
        if set(more) == set(kept):
            break
        kept = more
    return best


def turned_against(lens: Lens, view: BoardView, size: tuple[int, int], usual_px: float) -> str:
    """How a photo is turned, if it fits worse than usual and turning it back explains that; empty otherwise."""
    far = distance_px(lens, view)
    if far < WORSE * usual_px:
        return ""
    near = {how: distance_px(lens, _turned(view, size, axes)) for how, axes in _TURNS.items()}
    how = min(near, key=lambda name: near[name])
    return how if near[how] < EXPLAINED * far else ""


def distance_px(lens: Lens, view: BoardView) -> float:
    """Root mean square distance of a photo's corners from where a lens puts them, its pose free."""
    return rms_distance(solve_pose(lens, view)[2])


def _limit(distance: FloatArray) -> float:
    return max(POOR_PHOTO * float(np.median(distance)), POOR_PX)


def _fit(
    views: Sequence[BoardView], chosen: NDArray[np.intp], size: tuple[int, int], model: str
) -> tuple[Lens, FloatArray] | None:
    try:
        lens = solve_bundle([views[i] for i in chosen], size, model, reweight=False).lens
        return lens, np.array([distance_px(lens, view) for view in views])
    except (DataError, np.linalg.LinAlgError):
        return None


def _far_worse(far_px: float, usual_px: float) -> str:
    return (
        f"fits far worse than the others ({far_px:.2f} px, median {usual_px:.2f} px): the board was bent or moving, or "
        "zoom, focus or camera were others"
    )


def _turned(view: BoardView, size: tuple[int, int], how: tuple[bool, bool]) -> BoardView:
    """The view in the turned picture; a mirror turns the numbering of the corners too."""
    pixels = np.where(how, np.array(size) - 1.0 - view.pixels, view.pixels)
    board = view.board_mm * ([-1.0, 1.0] if how[0] != how[1] else [1.0, 1.0])
    return replace(view, pixels=pixels, board_mm=board)
