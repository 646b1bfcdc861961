"""Loops that were compiled from other sources are forgotten, and no others."""

from __future__ import annotations

import threading

import pytest

from rfea_vision.loops import forget_stale_loops, one_at_a_time


@pytest.fixture
def room(tmp_path):
    for folder in (tmp_path, tmp_path / "inner"):
        (folder / "__pycache__").mkdir(parents=True)
        (folder / "part.py").write_text("FACTOR = 1\n")
    forget_stale_loops(tmp_path)
    for folder in (tmp_path, tmp_path / "inner"):
        (folder / "__pycache__" / "entry.loop-3.py311.nbi").write_bytes(b"1")
        (folder / "__pycache__" / "part.cpython-311.pyc").write_bytes(b"1")
    return tmp_path


def kept(room):
    return sorted(path.relative_to(room).as_posix() for path in room.rglob("*.nbi"))


def test_the_same_sources_keep_their_loops(room):
    forget_stale_loops(room)
    assert len(kept(room)) == 2


@pytest.mark.parametrize("change", ["changed", "renamed", "removed"])
def test_another_source_anywhere_in_the_room_forgets_all(room, change):
    part = room / "inner" / "part.py"
    if change == "changed":
        part.write_text("FACTOR = 2\n")
    elif change == "renamed":
        part.rename(part.with_name("piece.py"))
    else:
        part.unlink()
    forget_stale_loops(room)
    assert kept(room) == []
    assert len(list(room.rglob("*.pyc"))) == 2


def test_a_room_that_cannot_be_written_to_is_left_alone(room, monkeypatch):
    (room / "part.py").write_text("FACTOR = 2\n")
    monkeypatch.setattr("pathlib.Path.unlink", lambda *_, **__: (_ for _ in ()).throw(PermissionError))
    forget_stale_loops(room)
    assert len(kept(room)) == 2


def test_who_comes_second_waits_and_another_lock_is_free(tmp_path):
    pytest.importorskip("fcntl", reason="there are no such locks on Windows")
    entered = threading.Event()

    def second():
        with one_at_a_time(tmp_path / "a.lock"):
            entered.set()

    with one_at_a_time(tmp_path / "a.lock"):
        waiting = threading.Thread(target=second)
        waiting.start()
        with one_at_a_time(tmp_path / "b.lock"):
            assert not entered.wait(0.2)
    waiting.join(timeout=60)
    assert entered.is_set()


def test_where_no_lock_can_be_made_nobody_waits(tmp_path):
    with one_at_a_time(tmp_path / "no folder" / "a.lock"), one_at_a_time(tmp_path / "no folder" / "a.lock"):
        pass
