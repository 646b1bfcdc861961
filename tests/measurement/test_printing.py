"""What is printed is what the calibration finds, at the size that it says."""

import re
import zlib

import cv2
import numpy as np
import pytest

from rfea_vision.calibration.board import Board
from rfea_vision.calibration.corners import BoardView, find_corners
from rfea_vision.calibration.printing import board_pdf, board_picture

BOARDS = {
    "checkerboard": Board("checkerboard", (9, 6), 0.012),
    "charuco": Board("charuco", (9, 6), 0.020, 0.015, "DICT_5X5_100"),
}


@pytest.mark.parametrize("kind", BOARDS)
def test_the_printed_board_is_found(kind, tmp_path):
    board = BOARDS[kind]
    picture = cv2.resize(board_picture(board), None, fx=0.05, fy=0.05, interpolation=cv2.INTER_AREA)
    grey = cv2.copyMakeBorder(picture, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    view = find_corners(tmp_path / "board.png", np.asarray(grey, dtype=np.uint8), board)
    assert isinstance(view, BoardView), view
    assert len(view.pixels) == 54
    scale = np.linalg.norm(np.ptp(view.pixels, axis=0)) / np.linalg.norm(np.ptp(view.board_mm, axis=0))
    assert scale * board.square_mm == pytest.approx(42.0, rel=1e-3)  # 840 px per square, reduced 20 times


@pytest.mark.parametrize("kind", BOARDS)
def test_the_page_has_the_true_scale(kind):
    board = BOARDS[kind]
    page = board_pdf(board, "test")
    assert rb"a \(b\) \\ c" in board_pdf(board, "a (b) \\ c")
    width, height = map(float, re.search(rb"q ([\d.]+) 0 0 ([\d.]+) ", page).groups())
    assert width / 72 * 25.4 == pytest.approx(10 * board.square_mm, abs=1e-3)
    assert height / 72 * 25.4 == pytest.approx(7 * board.square_mm, abs=1e-3)
    paper = [float(side) for side in re.search(rb"MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", page).groups()]
    assert paper[0] > width and paper[1] > height
    start = int(re.search(rb"startxref\n(\d+)", page)[1])
    assert page[start:].startswith(b"xref")
    compressed = page[page.index(b"stream\n", page.index(b"/Subtype /Image")) + 7 :]
    bits = np.unpackbits(np.frombuffer(zlib.decompress(compressed), dtype=np.uint8))
    assert bits.size == board_picture(board).size
