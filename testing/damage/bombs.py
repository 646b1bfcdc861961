"""Files made up to hurt: small, and announcing or unpacking to far more than they are."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator

import numpy as np

NAMES = (
    "yaml aliases", "deep yaml", "deep json", "long number", "one long line", "many empty lines", "png", "mat", "hls", "concat",
    "parquet",
)  # fmt: skip


def bombs() -> Iterator[tuple[str, bytes]]:
    """Contents that announce or unpack to far more than they are."""
    yield (
        "yaml aliases",
        b"a0: &a0 [x,x,x,x,x,x,x,x,x]\n"
        + b"".join(f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 9)}]\n".encode() for i in range(1, 12)),
    )
    yield "deep yaml", b"a: " + b"[" * 50_000
    yield "deep json", b'{"a":' * 50_000
    yield "long number", b"time_s,pressure_kPa\n" + b"9" * 1_000_000 + b",1\n2,3\n"
    yield "one long line", b"time_s,pressure_kPa" + b",x" * 500_000 + b"\n1,2\n"
    yield "many empty lines", b"time_s,pressure_kPa\n" + b"\n" * 1_000_000

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0))
    yield "png", b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(bytes(10_000_000))) + chunk(b"IEND", b"")
    inner = zlib.compress(struct.pack("<II", 14, 2_000_000_000) + bytes(10_000_000))
    yield "mat", b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + struct.pack("<II", 15, len(inner)) + inner
    yield "hls", b"#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n"
    yield "concat", b"ffconcat version 1.0\nfile /etc/hostname\n"
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = io.BytesIO()
    column = pa.DictionaryArray.from_arrays(np.zeros(60_000_000, dtype=np.int8), pa.array([1.0]))
    pq.write_table(pa.table({"time_s": column, "pressure_kPa": column}), sink, compression="zstd")
    yield "parquet", sink.getvalue()
