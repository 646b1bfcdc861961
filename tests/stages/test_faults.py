"""Two commands at once, commands that are killed, disks that fill, files that change: one sentence, and nothing lost."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from rfea_vision import open_campaign
from rfea_vision.cli.root import run
from rfea_vision.effects.catalogue import load_effect_file
from rfea_vision.errors import DataError, InputError
from rfea_vision.files import storage_error, sweep, whole_file, write_text
from rfea_vision.stages import locks
from rfea_vision.stages.locks import locked
from tests.campaign.campaigns import write_campaign

_HOLD = (
    "import sys, time; from pathlib import Path; from rfea_vision.stages.locks import locked\n"
    "with locked(Path(sys.argv[1])):\n    print('held', flush=True); time.sleep(60)"
)


@pytest.fixture
def held(tmp_path, root):
    """A lock that another process holds."""
    path = tmp_path / "rfea" / ".stages" / "lock"
    process = subprocess.Popen([sys.executable, "-c", _HOLD, str(path)], stdout=subprocess.PIPE, text=True, cwd=root)
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    yield path, process
    process.kill()
    process.wait()


def test_the_second_command_says_who_holds_the_first(held):
    path, process = held
    with (
        pytest.raises(DataError, match=rf"is held by '.*' \(process {process.pid} on .*, since 20"),
        locked(path, patience_s=0.2),
    ):
        pass


def test_no_lock_outlives_its_holder(held):
    path, process = held
    said: list[str] = []
    threading.Timer(1.0, process.send_signal, [signal.SIGKILL]).start()
    with locked(path, say=said.append):
        assert process.wait(timeout=60) == -signal.SIGKILL, "it was taken from one that still held it"
    assert len(said) == 1 and f"process {process.pid}" in said[0]


def test_a_command_waits_its_turn(tmp_path, root):
    campaign = write_campaign(tmp_path / "campaign")
    lock = campaign / "rfea" / ".stages" / "lock"
    order: list[str] = []

    def other() -> None:
        order.append(f"exit {run(['sync', str(campaign)])}")

    with locked(lock):
        thread = threading.Thread(target=other)
        thread.start()
        time.sleep(1.0)
        order.append("released")
    thread.join()
    assert order == ["released", "exit 0"]


def test_a_lock_may_be_shared(tmp_path):
    path = tmp_path / "lock"
    shared = threading.Thread(target=lambda: _hold_shared(path))
    with locked(path, shared=True):
        shared.start()
        shared.join(2.0)
        assert not shared.is_alive()


def _hold_shared(path: Path) -> None:
    with locked(path, shared=True, patience_s=1.0):
        pass


def test_another_host_holds_as_long_as_it_touches_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "SILENT_S", 1.5)
    path = tmp_path / "lock"
    about = {"host": "another", "pid": 7, "command": "rfea fit", "since": "2026-01-01", "shared": False}
    path.write_text(json.dumps(about))
    stop = threading.Event()

    def beat() -> None:
        while not stop.wait(0.1):
            os.utime(path, (0, time.monotonic()))  # its clock may be anything

    thread = threading.Thread(target=beat)
    thread.start()
    with pytest.raises(DataError, match="process 7 on another"), locked(path, patience_s=2.0):
        pass
    stop.set()
    thread.join()
    with locked(path, patience_s=5.0):
        assert json.loads(path.read_text())["pid"] == os.getpid()
    assert path.read_text() == ""


def test_what_a_killed_command_left_is_swept_and_what_a_running_one_writes_is_not(tmp_path):
    with whole_file(tmp_path / "a.json") as mine:
        dead = mine.with_name(mine.name.replace(f"-{os.getpid()}~", "-999999999~"))
        dead.write_text("half")
        sweep(tmp_path)
        assert mine.exists() and not dead.exists()
        mine.write_text("whole")
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_a_full_disk_keeps_what_was_there(tmp_path, monkeypatch):
    path = tmp_path / "model.json"
    write_text(path, "before")

    def full(self: Path, *_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(DataError, match=r"model.json: the disk is full; make room"):
        write_text(path, "after")
    assert path.read_text() == "before" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (errno.ENOSPC, 1),
        (errno.EDQUOT, 1),
        (errno.EROFS, 2),
        (errno.EACCES, 2),
        (errno.EPERM, 2),
        (errno.ENOENT, 1),
        (errno.EIO, 1),
        (errno.ESTALE, 1),
        (errno.EEXIST, 1),
        (errno.EISDIR, 1),
    ],
)
def test_a_fault_of_the_disk_is_one_sentence(tmp_path, number, code, capsys, monkeypatch):
    campaign = write_campaign(tmp_path / "campaign")

    def fault(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number), str(campaign / "rfea" / "steps"))

    monkeypatch.setattr("rfea_vision.readers.tracks.read_track", fault)
    assert run(["track", str(campaign)]) == code
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "a fault in" not in said and str(campaign) in said and "what was finished is kept" in said
    assert storage_error(OSError(errno.EINVAL, "x")) is None


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["init", "tube"], "or choose another folder;"),
        (["board", "checkerboard-9x6-12mm"], "or keep the results elsewhere with --output FILE;"),
        (["effects", "new", "mine.py"], "or choose another folder;"),
        (["propose", "tube"], "or keep the results elsewhere with --out DIR or --output FILE;"),
    ],
)
def test_a_place_that_may_not_be_written_to_is_left_by_what_the_command_has(tmp_path, arguments, says, capsys, monkeypatch):
    """`init` and `board` advised --out, which they have not."""
    write_campaign(tmp_path / "tube" if "propose" in arguments else tmp_path / "other")

    def refused(*_: object, **__: object) -> None:
        raise PermissionError(errno.EROFS, "Read-only file system", "here")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rfea_vision.files.tempfile.mkstemp", refused)
    assert run(arguments) == 2
    assert capsys.readouterr().err.strip() == f"rfea: here: Read-only file system; allow it, {says} what was finished is kept"


def test_what_is_in_the_way_is_told_from_what_has_gone(tmp_path):
    (tmp_path / "there").touch()
    said = {
        name: str(storage_error(FileExistsError(errno.EEXIST, "File exists", str(tmp_path / name))))
        for name in ("there", "gone")
    }
    assert "move it away" in said["there"] and "went away while it was worked on" in said["gone"]


def test_a_file_that_is_being_written_is_told_by_its_own_name(tmp_path):
    with pytest.raises(OSError) as failed, whole_file(tmp_path / "tube-A" / "recording.1.nc") as temporary:
        raise PermissionError(errno.EROFS, "Read-only file system", str(temporary))
    assert str(storage_error(failed.value)).startswith(f"{tmp_path}/tube-A/recording.1.nc: Read-only file system;")


def test_a_raw_file_that_changes_while_it_is_read_is_not_taken(tmp_path, monkeypatch):
    campaign = write_campaign(tmp_path / "campaign")
    from rfea_vision.readers import tracks

    read = tracks.read_track

    def grows(path: Path, **options: object):
        found = read(path, **options)
        with path.open("a") as stream:
            stream.write("9.0,0.0,-155.0\n")
        return found

    monkeypatch.setattr(tracks, "read_track", grows)
    with pytest.raises(DataError, match=r"track.csv: changed while it was read"):
        open_campaign(campaign).track(["steps"])
    monkeypatch.setattr(tracks, "read_track", read)
    assert open_campaign(campaign).track(["steps"])["steps"].time_s[-1] == 9.0


@pytest.mark.parametrize(
    "content",
    [
        "",
        "null",
        "[]",
        "{",
        "[" * 100_000,
        '{"key": "track/steps"}',
        '{"key": 1, "digest": [], "outputs": {"../../x": "y"}}',
    ],
)
def test_damaged_records_are_done_again(tmp_path, content):
    campaign = write_campaign(tmp_path / "campaign")
    open_campaign(campaign).track(["steps"])
    for path in (campaign / "rfea" / ".stages").glob("*.json"):
        path.write_text(content)
    work = open_campaign(campaign)
    work.track(["steps"])
    assert work.outcome("track", "steps") == "done"


def _reads_the_files_and_stops(*_: object, **given: object) -> None:
    raise DataError("far enough")


def test_the_code_of_a_stranger_does_not_run(tmp_path, capsys, monkeypatch):
    campaign = write_campaign(tmp_path / "campaign")
    monkeypatch.setattr("rfea_vision.fitting.fit_model", _reads_the_files_and_stops)
    monkeypatch.setattr("rfea_vision.critique.improve", _reads_the_files_and_stops)
    monkeypatch.setattr("rfea_vision.critique.diagnose", _reads_the_files_and_stops)
    spy = tmp_path / "ran"
    file = campaign / "mine.py"
    file.write_text(f"from pathlib import Path\nPath({str(spy)!r}).write_text('ran')\n")
    stages, model = campaign / "rfea" / ".stages", campaign / "rfea" / "models" / "base"
    record = {"digest": "0", "outputs": {}, "inputs": {}, "order": 1}
    for key in ("fit/base", "improve/ladder"):
        options = {"fit": {"effect_files": [str(file)]}, "critique": {"effect_files": [str(file)]}}
        write_text(stages / f"{key.replace('/', '@')}.json", json.dumps({**record, "key": key, "options": options}))
    write_text(model / "model.json", json.dumps({"name": "base", "effect_files": [str(file)], "effects": ["mine"]}))
    recipe = campaign / "recipe.yaml"
    recipe.write_text(f"steps:\n  - improve: {{effect_files: [{file}]}}\n")
    for arguments in (["report"], ["compare"], ["diagnose"], ["improve"], ["fit"], ["run", str(recipe)]):
        assert run([*arguments, str(campaign)]) in (0, 1, 2)
        assert "a fault in" not in capsys.readouterr().err
        assert not spy.exists(), arguments
    with pytest.raises(InputError, match="give --effect-file"):
        load_effect_file(file)
    with pytest.raises(InputError, match="declares no effect"):
        from rfea_vision.options import FitOptions

        load_effect_file(FitOptions(effect_files=(file,)).effect_files[0])
    assert spy.exists()


@pytest.mark.parametrize("name", ["../../../outside", "/outside", "a/b", ".hidden"])
def test_a_record_writes_nowhere_else(tmp_path, name, capsys, monkeypatch):
    campaign = write_campaign(tmp_path / "campaign")
    monkeypatch.setattr("rfea_vision.fitting.fit_model", _reads_the_files_and_stops)
    options = {"fit": {"name": name}}
    content = {"key": "fit/base", "digest": "0", "outputs": {}, "inputs": {}, "order": 1, "options": options}
    write_text(campaign / "rfea" / ".stages" / "fit@base.json", json.dumps(content))
    before = {path for path in tmp_path.rglob("*") if "rfea" not in path.parts}
    assert run(["compare", str(campaign), "base"]) in (0, 1, 2)
    assert "a fault in" not in capsys.readouterr().err
    assert before == {path for path in tmp_path.rglob("*") if "rfea" not in path.parts}
