"""Files of strangers, read in a process of their own: the same numbers, and no harm to this one."""

from __future__ import annotations

import os
import signal

import cv2
import numpy as np
import pandas as pd
import pytest

from rfea_vision.errors import InputError
from rfea_vision.files import read_dataset
from rfea_vision.readers import apart
from rfea_vision.readers.pictures import read_grey
from rfea_vision.readers.tables import read_table
from rfea_vision.readers.tracks import read_track
from rfea_vision.readers.video import open_frames, open_video
from tests.measurement.test_video import write


@pytest.fixture
def strangers():
    with apart.isolating():
        yield


def _both(read):
    mine = read()
    with apart.isolating():
        return mine, read()


def test_tables_and_results_are_the_same(tmp_path):
    time_s = np.arange(20) / 7.0
    frame = pd.DataFrame({"time_s": time_s, "angle_deg": np.sin(time_s), "what": ["a", None] * 10})
    frame.to_csv(tmp_path / "a.csv", index=False)
    mine, theirs = _both(lambda: read_table(tmp_path / "a.csv"))
    assert list(mine.columns) == list(theirs.columns)
    assert all(mine.columns[name].tobytes() == theirs.columns[name].tobytes() for name in ("time_s", "angle_deg"))
    assert list(theirs.columns["what"][::2]) == ["a"] * 10
    read_track(tmp_path / "a.csv").save(tmp_path / "a.nc")
    mine, theirs = _both(lambda: read_dataset(tmp_path / "a.nc"))
    assert mine.identical(theirs)


def test_films_and_pictures_are_the_same(tmp_path):
    pictures = [
        np.roll(np.add.outer(np.arange(48), 3 * np.arange(64)).astype(np.uint8), shift, 1) for shift in range(60)
    ]
    write(tmp_path / "a.mp4", pictures, range(0, 600, 10))
    (tmp_path / "frames.csv").write_text("file,time_s\n0.png,0\n1.png,0.5\n")
    for number in range(2):
        cv2.imwrite(str(tmp_path / f"{number}.png"), pictures[number])
    for opened in (lambda: open_video(tmp_path / "a.mp4"), lambda: open_frames(tmp_path, tmp_path / "frames.csv")):
        mine, theirs = _both(opened)
        assert (mine.size, mine.frame_count, mine.rate_Hz) == (theirs.size, theirs.frame_count, theirs.rate_Hz)
        assert np.array_equal(mine.times_s(), theirs.times_s())
        for own, others in ((mine, theirs), (mine.colours(0.5), theirs.colours(0.5))):
            for (time, picture), (other_time, other) in zip(own, others, strict=True):
                assert time == other_time and np.array_equal(picture, other)
    assert np.array_equal(
        open_video(tmp_path / "a.mp4").frame(55), _both(lambda: open_video(tmp_path / "a.mp4"))[1].frame(55)
    )
    mine, theirs = _both(lambda: read_grey(tmp_path / "1.png"))
    assert np.array_equal(mine, theirs)


def test_what_is_wrong_is_said_as_ever(tmp_path, strangers):
    (tmp_path / "a.csv").write_text("time_s;x\n")
    with pytest.raises(InputError, match=r"gone.csv: not found"):
        read_table(tmp_path / "gone.csv")
    with pytest.raises(InputError, match="unknown kind"):
        read_table(tmp_path / "a.exe")


def test_a_reader_that_dies_is_a_sentence_and_the_next_file_is_read(tmp_path, strangers):
    (tmp_path / "a.csv").write_text("time_s,x\n1,2\n2,3\n")
    read_table(tmp_path / "a.csv")
    process = apart._reading.process
    assert process is not None
    os.kill(process.pid, signal.SIGSTOP)  # it hangs
    apart_answer, apart.ANSWER_S = apart.ANSWER_S, 0.3
    try:
        with pytest.raises(InputError, match=r"a.csv: cannot be read within 0.3 s"):
            read_table(tmp_path / "a.csv")
    finally:
        apart.ANSWER_S = apart_answer
    assert process.poll() is not None
    assert list(read_table(tmp_path / "a.csv").columns) == ["time_s", "x"]


def test_memory_is_bounded(tmp_path, strangers, monkeypatch):
    monkeypatch.setattr(apart, "MOST_BYTES", 300_000_000)
    monkeypatch.setattr(apart, "_reading", apart._Process())
    (tmp_path / "a.csv").write_text("time_s,x\n" + "1,2\n" * 6_000_000)
    with pytest.raises(InputError, match=r"memory|ended the process"):
        read_table(tmp_path / "a.csv")


def test_processor_time_is_bounded(tmp_path, strangers, monkeypatch):
    """A file may make a parser turn for minutes, as HDF5 does over a list of dimensions that announces millions."""
    monkeypatch.setattr(apart, "MOST_CPU_S", 0)
    monkeypatch.setattr(apart, "MORE_S_PER_MB", 0.001)
    monkeypatch.setattr(apart, "_reading", apart._Process())
    (tmp_path / "a.csv").write_text("time_s,x\n" + "1.5,2.5\n" * 9_000_000)
    with pytest.raises(InputError, match="within 0 s of processor time on this machine"):
        read_table(tmp_path / "a.csv")


def test_nothing_of_the_folder_it_stands_in_is_imported(tmp_path, strangers, monkeypatch):
    monkeypatch.setattr(apart, "_reading", apart._Process())
    spy = tmp_path / "ran"
    for name in ("numpy.py", "json.py", "sitecustomize.py"):
        (tmp_path / name).write_text(f"open({str(spy)!r}, 'w')\n")
    (tmp_path / "a.csv").write_text("time_s,x\n1,2\n2,3\n")
    monkeypatch.chdir(tmp_path)
    assert list(read_table(tmp_path / "a.csv").columns) == ["time_s", "x"] and not spy.exists()
