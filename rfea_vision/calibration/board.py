"""The calibration boards: what is printed on them, in mm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rfea_vision.errors import InputError


@dataclass(frozen=True)
class Board:
    """A checkerboard or ChArUco board.

    Attributes
    ----------
    kind : ``checkerboard`` or ``charuco``
    inner_corners : corners where four squares meet, (per row, per column)
    square_m : side of a square
    marker_m, dictionary : side of a marker and its dictionary (such as ``DICT_5X5_100``); ChArUco only
    """

    kind: Literal["checkerboard", "charuco"]
    inner_corners: tuple[int, int]
    square_m: float
    marker_m: float | None = None
    dictionary: str | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("checkerboard", "charuco"):
            raise InputError(f"camera.board.kind: '{self.kind}' is unknown; use checkerboard or charuco")
        if min(self.inner_corners) < 2:
            raise InputError("camera.board.inner_corners: give two numbers of at least 2, such as [9, 6]")
        if not self.square_m > 0:
            raise InputError("camera.board.square must be positive, such as 12 mm")
        if self.kind == "charuco":
            if self.marker_m is None or not 0 < self.marker_m < self.square_m:
                raise InputError("camera.board.marker: a charuco board needs a marker side smaller than its square")
            import cv2  # a quarter of a second that campaigns with a checkerboard need not pay

            if not hasattr(cv2.aruco, self.dictionary_name):
                raise InputError(
                    f"camera.board.dictionary: '{self.dictionary}' is unknown; use one such as DICT_5X5_100"
                )

    @property
    def dictionary_name(self) -> str:
        """OpenCV's name of the marker dictionary."""
        name = (self.dictionary or "DICT_5X5_100").upper()
        return name if name.startswith("DICT_") else f"DICT_{name}"

    @property
    def square_mm(self) -> float:
        """Side of a square in mm."""
        return 1000.0 * self.square_m

    @property
    def corners_mm(self) -> NDArray[np.float64]:
        """Inner corners on the board, (columns * rows, 2) mm, row by row; x along a row, y from row to row."""
        columns, rows = self.inner_corners
        y, x = np.mgrid[0:rows, 0:columns]
        return self.square_mm * np.column_stack([x.ravel(), y.ravel()]).astype(float)

    def charuco(self, *, legacy: bool = False) -> Any:
        """OpenCV's ChArUco board with the same numbers, in mm; `legacy` as printed before OpenCV 4.6."""
        import cv2

        columns, rows = self.inner_corners
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary_name))
        marker_mm = 1000.0 * (self.marker_m or 0.0)
        board = cv2.aruco.CharucoBoard((columns + 1, rows + 1), self.square_mm, marker_mm, dictionary)
        board.setLegacyPattern(legacy)
        return board
