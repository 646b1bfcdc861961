"""Kills at random moments: a command is stopped with SIGKILL, run again, and must end with the results of an undisturbed one.

``track``, ``fit`` and ``improve`` run in a fork of this process, which has loaded their libraries; ``batch`` is a command of its own,
and every second time one of its workers is killed in its place: then the batch itself must end as on a quiet day. A moment is a
share of the processor time of an undisturbed run: by the clock, a busy machine would have each command killed as it begins.
"""

from __future__ import annotations

import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from pathlib import Path

from rfea_vision.twin import TwinOptions, simulate

MOST_S = 900.0  # for one run of a command, on a busy machine
_RECIPE = "format: rfea-recipe/1\nsteps:\n  - fit: {segments: 2}\n  - compare\n"
_COMMANDS: dict[str, list[str]] = {
    "track": ["track", "CAMPAIGN"],
    "fit": ["fit", "CAMPAIGN", "--segments", "2"],
    "improve": ["improve", "CAMPAIGN", "--segments", "2"],
    "batch": ["batch", "CAMPAIGN", "--recipe", "RECIPE", "--index", "INDEX"],
}


@dataclass
class Kill:
    """What became of one kill."""

    command: str
    number: int
    what: str = "command"  # that was killed: the command, or a worker of a batch
    after_s: float = 0.0  # of processor time
    too_late: bool = False  # the command had ended before
    half_written: list[str] = field(default_factory=list)
    different: list[str] = field(default_factory=list)
    redone: list[str] = field(default_factory=list)  # stages that had been finished and ran again
    rungs: int = 0  # of a climb, that were finished when it was killed
    of_rungs: int = 0  # that it has when nobody disturbs it


def results_in(campaign: Path) -> dict[str, bytes]:
    """Every result but the pages, by path; what is unfinished must not be there."""
    out = campaign / "rfea"
    kept = [
        path
        for path in out.rglob("*")
        if path.is_file() and ".stages" not in path.parts and path.name != "timings.json"
    ]
    left = [path.name for path in kept if path.name.startswith(".") and path.suffix != ".npz"]
    if left:
        raise AssertionError(f"left unfinished: {left}")
    return {
        path.relative_to(out).as_posix(): path.read_bytes() for path in kept if path.suffix in (".json", ".nc", ".csv")
    }


def half_written(campaign: Path) -> list[str]:
    """Results and records that cannot be read, of those that have their name."""
    import h5py

    found = []
    for path in (campaign / "rfea").rglob("*"):
        if path.name.startswith(".") or path.suffix not in (".json", ".nc"):
            continue
        try:
            json.loads(path.read_bytes()) if path.suffix == ".json" else h5py.File(path, "r").close()
        except (OSError, ValueError) as error:
            found.append(f"{path.name}: {error}")
    return found


class Process:
    """A command that runs; forked from here, so that it need not load what is loaded, or (batch) of its own."""

    def __init__(self, command: str, campaign: Path) -> None:
        recipe = campaign.parent / "recipe.yaml"
        recipe.write_text(_RECIPE)
        places = {"CAMPAIGN": str(campaign), "RECIPE": str(recipe), "INDEX": str(campaign.parent / "index.html")}
        self.arguments = [places.get(word, word) for word in _COMMANDS[command]]
        self.own: subprocess.Popen[bytes] | None = None
        self.used_s = 0.0  # of processor time, once it has ended
        if command == "batch":
            started = [sys.executable, "-c", "from rfea_vision.cli import main; main()", *self.arguments]
            quiet = subprocess.DEVNULL
            self.own = subprocess.Popen(started, stdout=quiet, stderr=quiet, start_new_session=True)
            self.pid = self.own.pid
        else:
            self.pid = os.fork() or self._become()

    def _become(self) -> int:
        """Be the command; never returns."""
        code = 70
        try:
            os.setsid()
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(nowhere, stream)
            from rfea_vision.cli.root import run as run_command

            code = run_command(self.arguments)
        finally:
            os._exit(code)

    def wait(self, used_s: float = math.inf) -> int | None:
        """Return the exit code, or None once it has used so much processor time, or has not ended in `MOST_S`."""
        ends = time.monotonic() + MOST_S
        while True:
            done, status, usage = os.wait4(self.pid, os.WNOHANG)
            if done:
                self.used_s = usage.ru_utime + usage.ru_stime
                if self.own is not None:
                    self.own.returncode = os.waitstatus_to_exitcode(status)
                return os.waitstatus_to_exitcode(status)
            if time.monotonic() > ends or (used_s < math.inf and self._used_so_far_s() > used_s):
                return None
            time.sleep(0.002)

    def _used_so_far_s(self) -> float:
        """Processor time of the command until now, with that of a batch's workers."""
        return sum(map(_processor_s, [self.pid, *(() if self.own is None else _below(self.pid))]))

    def kill(self) -> None:
        """Kill the command; of a batch, its workers have to notice by themselves."""
        os.kill(self.pid, signal.SIGKILL)
        self.wait()


def descendants(process: int) -> list[int]:
    """Workers below a batch: the processes that were spawned to compute, and those that look after them."""
    return [item for item in _below(process) if b"spawn_main" in _command_line(item)]


def _below(process: int) -> list[int]:
    """Every process that a process has started, and that these have."""
    parents: dict[int, list[int]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, ValueError):
            parents.setdefault(int((folder / "stat").read_text().rpartition(")")[2].split()[1]), []).append(
                int(folder.name)
            )
    found, look = [], [process]
    while look:
        below = parents.get(look.pop(), [])
        look += below
        found += below
    return found


def _processor_s(process: int) -> float:
    """Processor time of a process and of those below it that have ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def _command_line(process: int) -> bytes:
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return b""


def kill_often(
    command: str, campaign: Path, numbers: Iterable[int], *, heard: Callable[[Kill], None] = lambda kill: None
) -> list[Kill]:
    """Kill a command once for each number, each time on a fresh copy of `campaign`, and compare what a re-run ends with."""
    found = []
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        calm = Path(name) / "calm" / campaign.name
        shutil.copytree(campaign, calm)
        _run(command, calm)
        wanted = results_in(calm)
        shutil.rmtree(calm)
        shutil.copytree(campaign, calm)  # once more, with everything compiled: the time in which it can be killed
        took_s = _run(command, calm)
        if results_in(calm) != wanted:
            raise AssertionError(f"{command}: two undisturbed runs differ")
        for number in numbers:
            folder = Path(name) / f"killed-{number}" / campaign.name
            shutil.copytree(campaign, folder)
            found.append(_kill_once(command, number, folder, wanted, took_s))
            shutil.rmtree(folder.parent, ignore_errors=True)
            heard(found[-1])
    return found


def _kill_once(command: str, number: int, folder: Path, wanted: dict[str, bytes], took_s: float) -> Kill:
    chance = random.Random(f"{command} {number}")
    found = Kill(
        command,
        number,
        "worker" if command == "batch" and number % 2 else "command",
        chance.uniform(0.02, 1.0) * took_s,
    )
    process = Process(command, folder)
    code = process.wait(found.after_s)
    if code is None:
        time.sleep(chance.uniform(0.0, 0.02))  # that time is counted in hundredths of a second
    workers = descendants(process.pid) if found.what == "worker" and code is None else []
    found.too_late = code is not None or (found.what == "worker" and not workers)
    if found.what == "worker":
        if workers:
            with suppress(ProcessLookupError):
                os.kill(chance.choice(workers), signal.SIGKILL)
        code = process.wait() if code is None else code
        if code != 0:
            found.different.append(f"the batch ended with exit code {code}")
    else:
        if code is None:
            process.kill()
        found.half_written = half_written(folder)
        before = _records(folder)
        found.rungs = sum(name.startswith("diagnose@") for name in before)
        found.of_rungs = sum(path.endswith("/diagnosis.json") for path in wanted)
        _run(command, folder)
        after = _records(folder)
        found.redone = sorted(key for key, content in before.items() if after.get(key) != content)
    made = results_in(folder)
    found.different += sorted(key for key in wanted.keys() | made.keys() if wanted.get(key) != made.get(key))
    return found


def _records(folder: Path) -> dict[str, bytes]:
    found = (folder / "rfea" / ".stages").glob("*@*.json")
    return {path.name: path.read_bytes() for path in found if not path.name.startswith(".")}


def _run(command: str, campaign: Path) -> float:
    """Run a command to its end; return the processor time that it took."""
    process = Process(command, campaign)
    code = process.wait()
    if code is None:
        process.kill()
    if code != 0:
        raise AssertionError(f"{command}: ended with {'no answer' if code is None else f'exit code {code}'}")
    return process.used_s


def small_campaign(folder: Path) -> Path:
    """Two short runs of a coarse twin that hides two effects which two segments can tell: a climb of three rungs."""
    options = TwinOptions(
        hidden={"gravity_tilt.angle": -0.15, "maxwell.k1": 0.1, "maxwell.T": 0.2}, seed=3, roles=("train", "validate"),
        duration_s=1.5, rate_Hz=60.0, joints=4, sync="common_clock", write_truth=False,
    )  # fmt: skip
    simulate(folder, options)
    return folder


def load_commands(campaign: Path) -> None:
    """Run the commands here once, so that what they load and compile is there for all forks."""
    from rfea_vision.cli.root import run as run_command

    warm = campaign.with_name("warm")
    shutil.copytree(campaign, warm)
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        for command in ("track", "fit", "improve"):
            run_command([word.replace("CAMPAIGN", str(warm)) for word in _COMMANDS[command]])
