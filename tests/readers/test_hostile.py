"""Small files that announce, or unpack to, more than a machine holds; and containers that name other files."""

from __future__ import annotations

import io
import struct
import zlib

import asammdf
import cv2
import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from rfea_vision.errors import InputError
from rfea_vision.readers.kinds import base
from rfea_vision.readers.tables import read_table
from rfea_vision.readers.video import open_frames, open_video


def _parquet(path):
    repeated = pa.DictionaryArray.from_arrays(np.zeros(1_000_000, dtype=np.int32), [1.0])
    pq.write_table(pa.table({"time_s": repeated}), path)


def _mat(path):
    scipy.io.savemat(path, {"time_s": np.zeros(500_000)}, do_compression=True)


def _mdf(path):
    with asammdf.MDF() as file:
        file.append(asammdf.Signal(np.zeros(300_000), np.arange(300_000.0), name="p"))
        file.save(path, compression=2)


@pytest.mark.parametrize(("name", "write"), [("a.parquet", _parquet), ("a.mat", _mat), ("a.mf4", _mdf)])
def test_what_unpacks_to_too_much_is_refused_before(tmp_path, name, write, monkeypatch):
    monkeypatch.setattr(base, "MOST_VALUES", 250_000)
    # in this process, where the limit is lowered
    monkeypatch.setattr("rfea_vision.readers.tables.serving", lambda: True)
    write(tmp_path / name)
    with pytest.raises(InputError, match="are read at most"):
        read_table(tmp_path / name)


def _hdf5_elsewhere(path, target):
    with h5py.File(path, "w") as file:
        file["node_names"] = [b"tip"]
        file["tracks"] = h5py.ExternalLink(str(target), "/secret")


def test_a_file_that_leads_to_another_is_refused(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["secret"] = np.zeros((1, 2, 1, 5))
    _hdf5_elsewhere(tmp_path / "a.h5", tmp_path / "other.h5")
    with pytest.raises(InputError, match="'tracks' lies in another file"):
        read_table(tmp_path / "a.h5")


def test_a_long_text_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(base, "MOST_VALUES", 100)
    (tmp_path / "a.csv").write_text("time_s,pressure_kPa\n" + "1,2\n" * 1000)
    with pytest.raises(InputError, match="are read at most"):
        read_table(tmp_path / "a.csv")


def test_a_formula_in_a_log_is_not_run(tmp_path):
    signal = asammdf.Signal(np.arange(5.0), np.arange(5.0), name="p", conversion={"formula": "X1 * 2"})
    with asammdf.MDF() as file:
        file.append(signal)
        file.save(tmp_path / "a.mf4")
    with pytest.raises(InputError, match="channel 'p' is computed by a formula"):
        read_table(tmp_path / "a.mf4")


def test_dates_are_not_taken_for_seconds(tmp_path):
    moments = np.array(["2026-01-01T00:00:00", "2026-01-01T00:00:01"], dtype="datetime64[ns]")
    pq.write_table(pa.table({"time_s": moments}), tmp_path / "a.parquet")
    with pytest.raises(InputError, match="holds dates or durations"):
        read_table(tmp_path / "a.parquet").numbers("time_s")


@pytest.mark.parametrize(
    "text",
    ["#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n",
     "ffconcat version 1.0\nfile other.mp4\n", "hello\n" * 100],
)  # fmt: skip
def test_a_list_of_films_is_no_film(tmp_path, text):
    (tmp_path / "video.mp4").write_text(text)
    with pytest.raises(InputError, match="not a readable video"):
        open_video(tmp_path / "video.mp4")


def test_a_table_names_no_picture_elsewhere(tmp_path):
    frames = tmp_path / "campaign" / "frames"
    frames.mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "secret.png"), np.zeros((4, 4), np.uint8))
    (frames / "frames.csv").write_text("file,time_s\n../../secret.png,0\n")
    with pytest.raises(InputError, match=r"leads out of the campaign's folder.*--trust"):
        open_frames(frames, frames / "frames.csv", within=frames.parent)
    assert open_frames(frames, frames / "frames.csv").frame_count == 1


def test_a_picture_of_more_pixels_than_cameras_have_is_none(tmp_path):
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    content = io.BytesIO()
    content.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 30_000, 30_000, 8, 0, 0, 0, 0)))
    content.write(chunk(b"IDAT", zlib.compress(bytes(100_000))) + chunk(b"IEND", b""))
    (tmp_path / "a.png").write_bytes(content.getvalue())
    (tmp_path / "frames.csv").write_text("file,time_s\na.png,0\n")
    with pytest.raises(InputError, match="not a readable picture"):
        open_frames(tmp_path, tmp_path / "frames.csv")
