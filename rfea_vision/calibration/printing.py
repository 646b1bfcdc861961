"""A board as PDF at true scale: what the calibration looks for is what is printed."""

from __future__ import annotations

import re
import zlib

import numpy as np
from numpy.typing import NDArray

from rfea_vision.calibration.board import Board

_PAPERS_MM = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "A2": (420.0, 594.0), "A1": (594.0, 841.0)}  # ISO 216
_MARGIN_MM = 10.0  # that printers leave white
_POINTS_PER_MM = 72.0 / 25.4  # of PDF
_PIXELS_PER_SQUARE = 840  # a multiple of most marker grids at 3/4 of a square; what is left is 0.1 % of a square


def board_picture(board: Board) -> NDArray[np.uint8]:
    """Return the board (rows, columns) without margin, white 255 and black 0, `_PIXELS_PER_SQUARE` per square."""
    columns, rows = (count + 1 for count in board.inner_corners)
    if board.kind == "charuco":
        size = (columns * _PIXELS_PER_SQUARE, rows * _PIXELS_PER_SQUARE)
        return np.asarray(board.charuco().generateImage(size, marginSize=0, borderBits=1), dtype=np.uint8)
    squares = (np.add.outer(np.arange(rows), np.arange(columns)) % 2).astype(np.uint8) * 255
    return np.kron(squares, np.ones((_PIXELS_PER_SQUARE, _PIXELS_PER_SQUARE), dtype=np.uint8))


def board_pdf(board: Board, title: str) -> bytes:
    """Return a PDF of one page, on the smallest paper that holds the board, with a line of text below it."""
    picture = board_picture(board)
    width_mm, height_mm = ((count + 1) * board.square_mm for count in board.inner_corners)
    paper_mm = _paper(width_mm, height_mm)
    page = [side * _POINTS_PER_MM for side in paper_mm]
    place = [side * _POINTS_PER_MM for side in (width_mm, height_mm)]
    left, bottom = (page[0] - place[0]) / 2, (page[1] - place[1]) / 2
    columns, rows = board.inner_corners
    text = f"{title}: {columns} x {rows} inner corners, squares of {board.square_mm:g} mm; print at 100 %, then measure"
    escaped = re.sub(r"([\\()])", r"\\\1", text)
    drawing = (
        f"q {place[0]:.4f} 0 0 {place[1]:.4f} {left:.4f} {bottom:.4f} cm /Board Do Q "
        f"BT /F1 7 Tf {left:.4f} {bottom - 12:.4f} Td ({escaped}) Tj ET"
    ).encode("latin-1", "replace")
    bits = zlib.compress(np.packbits(picture > 127, axis=1).tobytes(), 9)
    image = (
        f"<< /Type /XObject /Subtype /Image /Width {picture.shape[1]} /Height {picture.shape[0]} "
        f"/ColorSpace /DeviceGray /BitsPerComponent 1 /Filter /FlateDecode /Length {len(bits)} >>"
    )
    return _pdf(
        [
            b"<< /Type /Catalog /Pages 2 0 R >>",
            b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            (
                f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {page[0]:.4f} {page[1]:.4f}] /Contents 4 0 R "
                "/Resources << /XObject << /Board 5 0 R >> /Font << /F1 6 0 R >> >> >>"
            ).encode(),
            _stream(f"<< /Length {len(drawing)} >>", drawing),
            _stream(image, bits),
            b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        ]
    )


def _paper(width_mm: float, height_mm: float) -> tuple[float, float]:
    """Return width and height of the smallest sheet, upright or across; beyond A1 a sheet of its own."""
    for short, long in _PAPERS_MM.values():
        for paper in ((short, long), (long, short)):
            if width_mm + 2 * _MARGIN_MM <= paper[0] and height_mm + 2 * _MARGIN_MM <= paper[1]:
                return paper
    return width_mm + 2 * _MARGIN_MM, height_mm + 2 * _MARGIN_MM


def _stream(dictionary: str, content: bytes) -> bytes:
    return dictionary.encode() + b"\nstream\n" + content + b"\nendstream"


def _pdf(objects: list[bytes]) -> bytes:
    """Put numbered objects and their table of places into one file."""
    page = bytearray(b"%PDF-1.4\n")
    places = []
    for number, content in enumerate(objects, start=1):
        places.append(len(page))
        page += f"{number} 0 obj\n".encode() + content + b"\nendobj\n"
    start = len(page)
    page += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n".encode()
    page += b"".join(f"{place:010d} 00000 n \n".encode() for place in places)
    page += f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n".encode()
    return bytes(page)
