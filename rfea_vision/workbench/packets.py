"""What the page is sent of arrays: a JSON header and one block of 16-bit numbers, as `report.pack` makes them."""

from __future__ import annotations

import json
import struct

from rfea_vision.report.pack import Pack
from rfea_vision.units import finite


def packet(header: dict[str, object], pack: Pack) -> bytes:
    """Length of the header (4 bytes, little endian), the header, the block; the block begins at an even byte."""
    text = json.dumps(finite(header), separators=(",", ":"), allow_nan=False, default=str).encode()
    text += b" " * (-len(text) % 2)
    return struct.pack("<I", len(text)) + text + pack.bytes()
