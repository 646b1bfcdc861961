"""The server's end of a worker: whatever becomes of the process, the next job can begin."""

from __future__ import annotations

import queue
from pathlib import Path

import pytest

from rfea_vision.workbench import process
from rfea_vision.workbench.app_state import AppState, Asked
from rfea_vision.workbench.evidence import stamps
from rfea_vision.workbench.process import WorkerProcess
from rfea_vision.workbench.routes import _said

LIMIT_S = 60


@pytest.fixture
def worker(tmp_path, monkeypatch):
    """Make a worker whose process is a shell script; what it tells stands in the attribute `told`."""
    made: list[WorkerProcess] = []

    def make(script: str) -> WorkerProcess:
        file = tmp_path / "worker"
        file.write_text(f"#!/bin/sh\n{script}\n")
        file.chmod(0o755)
        monkeypatch.setattr(process.sys, "executable", str(file))
        told: queue.SimpleQueue[dict] = queue.SimpleQueue()
        made.append(WorkerProcess(told.put))
        made[-1].told = told  # pyright: ignore[reportAttributeAccessIssue]
        return made[-1]

    yield make
    for one in made:
        one.stop()


def heard(worker, count: int) -> list[str]:
    return [worker.told.get(timeout=LIMIT_S)["event"] for _ in range(count)]


def test_a_line_that_was_cut_ends_the_job_and_the_next_begins(worker):
    hand = worker("""read job; printf '{"event": "prog'""")
    for _ in range(2):
        assert hand.submit({"do": "fit"})
        assert heard(hand, 2) == ["begun", "stopped"]


def test_a_job_that_is_stopped_leaves_the_next_one_alone(worker):
    hand = worker("""read job; echo '{"event": "note"}'; read end""")
    for number in range(3):
        assert hand.submit({"do": "fit", "index": number})
        assert heard(hand, 2) == ["begun", "note"] and (hand.job or {}).get("index") == number
        hand.stop()
        assert hand.job is None and heard(hand, 1) == ["stopped"]
    assert hand.told.empty()


def test_a_law_that_was_deleted_takes_nothing_else_away(fitted):
    app = AppState(fitted)
    app.own_files = {Path("/nowhere/gone.py")}
    try:
        assert _said("effects", Asked(app)).status_code == 200
        assert app.laws() == []
    finally:
        app.close()


def test_a_missing_file_is_told_in_a_sentence(monkeypatch):
    def missing(*_):
        Path("/nowhere/film.mp4").stat()

    monkeypatch.setattr("rfea_vision.workbench.answers.stop", missing)
    answer = _said("stop", Asked(None))
    assert answer.status_code == 422 and b"/nowhere/film.mp4: No such file" in answer.body


def test_results_are_read_anew_when_one_is_gone_or_older_and_not_while_one_is_written(tmp_path):
    first, second = tmp_path / "a.json", tmp_path / "b.json"
    first.write_text("1")
    before = stamps(tmp_path, "*.json")
    (tmp_path / ".b~half.json").write_text("")
    assert stamps(tmp_path, "*.json", "a.*") == before
    second.write_text("22")
    assert stamps(tmp_path, "*.json") != before
    second.unlink()
    assert stamps(tmp_path, "*.json") == before
