"""Faults of the machine: disks that fill, folders that go away, clocks that jump, files that change, two commands at once.

Each is tried with real commands on a small campaign. Right is: one sentence where the command cannot go on, nothing lost
of earlier results, and after the fault the results of an undisturbed run. Each is a line of `ROWS`.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.damage.rows import ROWS, add_row, rows_of_this_code
from testing.kills import MOST_S, results_in, small_campaign

_RFEA = [sys.executable, "-c", "from rfea_vision.cli import main; main()"]
_FIT = ("fit", "CAMPAIGN", "--segments", "2")


@dataclass
class Ended:
    """How a command ended: its exit code and the last line that it said."""

    code: int
    said: str

    @property
    def in_a_sentence(self) -> bool:
        """Whether it refused in a sentence."""
        return self.code in (1, 2) and bool(self.said) and "a fault in" not in self.said


def begin(campaign: Path, *words: str) -> subprocess.Popen[str]:
    """Start a command on a campaign."""
    arguments = [str(campaign) if word == "CAMPAIGN" else word for word in words]
    return subprocess.Popen([*_RFEA, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def end(process: subprocess.Popen[str]) -> Ended:
    """Wait for a command."""
    _, said = process.communicate(timeout=MOST_S)
    if "Traceback" in said:
        raise AssertionError(f"a traceback: {said[-400:]}")
    lines = [line for line in said.splitlines() if line.strip()]
    return Ended(process.returncode, lines[-1].strip() if lines else "")


def command(campaign: Path, *words: str) -> Ended:
    """Run a command on a campaign."""
    return end(begin(campaign, *words))


@contextmanager
def disk(megabytes: float) -> Iterator[Path]:
    """A small disk of its own.

    Raises
    ------
    PermissionError
        If this user may not mount one.
    """
    with tempfile.TemporaryDirectory(prefix="disk-") as name:
        options = f"size={int(megabytes * 1024)}k"
        made = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", name], capture_output=True, check=False)
        if made.returncode:
            raise PermissionError("only root can mount a small disk")
        try:
            yield Path(name)
        finally:
            subprocess.run(["umount", "-l", name], check=False)


class Tried:
    """One campaign, and what an undisturbed fit of it gives."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.raw = small_campaign(folder / "raw" / "tube")
        calm = shutil.copytree(self.raw, folder / "calm" / "tube")
        assert command(calm, *_FIT).code == 0
        self.wanted = results_in(calm)

    def copy(self, where: Path) -> Path:
        """A fresh copy of the campaign below `where`."""
        return shutil.copytree(self.raw, where / "tube")

    def as_undisturbed(self, campaign: Path) -> bool:
        """Whether a fit ends now with the results of an undisturbed one."""
        return command(campaign, *_FIT).code == 0 and results_in(campaign) == self.wanted


def full_disk(tried: Tried, room_kB: int) -> tuple[bool, str]:
    """Fit where only so much room is left; then make room."""
    with disk(8) as place:
        campaign = tried.copy(place)
        assert command(campaign, "track", "CAMPAIGN").code == 0
        before = results_in(campaign)
        state = os.statvfs(place)
        filler = place / "filler"
        filler.write_bytes(bytes(max(0, state.f_bavail * state.f_frsize - 1024 * room_kB)))
        ended = command(campaign, *_FIT)
        kept = {key: content for key, content in results_in(campaign).items() if key in before} == before
        filler.unlink()
        right = tried.as_undisturbed(campaign)
    return ended.in_a_sentence and "full" in ended.said and kept and right, ended.said


def read_only(tried: Tried) -> tuple[bool, str]:
    """Fit in a folder that cannot be written to."""
    with disk(8) as place:
        campaign = tried.copy(place)
        assert command(campaign, "track", "CAMPAIGN").code == 0
        before = results_in(campaign)
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        ended = command(campaign, *_FIT)
        kept = results_in(campaign) == before
        subprocess.run(["mount", "-o", "remount,rw", str(place)], check=True)
        right = tried.as_undisturbed(campaign)
    return ended.in_a_sentence and kept and right, ended.said


def vanished(tried: Tried, stages: int) -> tuple[bool, str]:
    """Take the folder away during a fit, once so many of its stages are finished, and bring it back."""
    campaign = tried.copy(tried.folder / f"gone-{stages}")
    process = begin(campaign, *_FIT)
    ends = time.monotonic() + MOST_S
    while len(list(campaign.glob("rfea/.stages/*@*.json"))) < stages and process.poll() is None:
        if time.monotonic() > ends:
            raise AssertionError(f"{stages} stages were not finished in {MOST_S:g} s")
        time.sleep(0.001)
    too_late = process.poll() is not None
    away = campaign.rename(campaign.with_name("away"))
    ended = end(process)
    if campaign.exists():  # a result may have been written as if nothing were: the folder is not ours any more
        shutil.rmtree(campaign)
    away.rename(campaign)
    return not too_late and ended.in_a_sentence and tried.as_undisturbed(campaign), ended.said


def clock_back(tried: Tried) -> tuple[bool, str]:
    """The clock was a day ahead as the results were made; then a raw file changes, keeping its size, with an older time."""
    campaign = tried.copy(tried.folder / "clock")
    assert command(campaign, *_FIT).code == 0
    ahead = time.time() + 86400
    for path in (*campaign.rglob("*"), *(campaign / "rfea" / ".stages").iterdir()):
        os.utime(path, (ahead, ahead))
    unchanged = tried.as_undisturbed(campaign)
    log = next(campaign.glob("*/pressure.csv"))
    right = log.read_bytes()
    digit = next(place for place in range(len(right) - 1, 0, -1) if chr(right[place]).isdigit())
    log.write_bytes(right[:digit] + (b"1" if right[digit : digit + 1] != b"1" else b"2") + right[digit + 1 :])
    os.utime(log, (ahead - 7200, ahead - 7200))
    noticed = command(campaign, *_FIT).code == 0 and results_in(campaign) != tried.wanted
    log.write_bytes(right)
    os.utime(log, (ahead - 9000, ahead - 9000))
    return unchanged and noticed and tried.as_undisturbed(campaign), "an older file of the same size counts as changed"


def growing(tried: Tried) -> tuple[bool, str]:
    """A raw file is written to while it is read."""
    campaign = tried.copy(tried.folder / "growing")
    log = next(campaign.glob("*/pressure.csv"))
    right, stop = log.read_bytes(), threading.Event()
    last_s = float(right.splitlines()[-1].split(b",")[0])

    def grow() -> None:
        while not stop.wait(0.002):
            nonlocal last_s
            last_s += 0.001
            with log.open("ab") as stream:
                stream.write(b"%.6f,0\n" % last_s)

    writer = threading.Thread(target=grow)
    writer.start()
    ended = command(campaign, "sync", "CAMPAIGN")
    stop.set()
    writer.join()
    log.write_bytes(right)
    return ended.in_a_sentence and "changed while it was read" in ended.said and tried.as_undisturbed(
        campaign
    ), ended.said


def two_at_once(tried: Tried) -> tuple[bool, str]:
    """Two fits, and a third command, on one campaign at the same moment."""
    campaign = tried.copy(tried.folder / "two")
    processes = [begin(campaign, *_FIT), begin(campaign, *_FIT), begin(campaign, "sync", "CAMPAIGN")]
    ended = [end(process) for process in processes]
    return [item.code for item in ended] == [0, 0, 0] and results_in(
        campaign
    ) == tried.wanted, "each waited for the one before"


FAULTS: dict[str, Callable[[Tried], tuple[bool, str]]] = {
    **{f"full disk, {room} kB left": partial(full_disk, room_kB=room) for room in (0, 20, 60, 80, 100, 120, 160)},
    "folder that cannot be written to": read_only,
    **{
        f"folder that goes away after {stages} of 5 stages of a fit": partial(vanished, stages=stages)
        for stages in (1, 2, 3, 4)
    },
    "clock that jumps back": clock_back,
    "raw file that grows while it is read": growing,
    "two fits and a sync at once": two_at_once,
}


def try_all(file: Path = ROWS) -> None:
    """Try every fault that is not in `file` yet."""
    done = {row["fault"] for row in rows_of_this_code("faults", file)}
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        tried = Tried(Path(name))
        for fault, attempt in FAULTS.items():
            if fault in done:
                continue
            try:
                right, said = attempt(tried)
            except PermissionError as error:
                sys.stderr.write(f"  {fault}: not tried: {error}\n")
                continue
            except AssertionError as error:
                right, said = False, str(error)
            said = " ".join(said.replace(name, "…").split())
            # small disks are mounted in folders of their own, which nobody has again
            said = re.sub(r"\S*/disk-[^/]+", "…", said)
            add_row("faults", {"fault": fault, "right": right, "said": said}, file)
            sys.stderr.write(f"  {fault}: {'right' if right else 'WRONG'}: {said}\n")


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    try_all()
    rows = rows_of_this_code("faults")
    wrong = [row["fault"] for row in rows if not row["right"]]
    return [
        {"name": "faults of disk, clock and files that were tried", "value": len(rows), "unit": "faults", "target": f">= {len(FAULTS)}",
         "met": len(rows) >= len(FAULTS)},
        {"name": "of them without a sentence, or with something lost", "value": len(wrong), "unit": "faults", "target": "0",
         "met": not wrong},
    ]  # fmt: skip


if __name__ == "__main__":
    try_all(Path(sys.argv[1]) if len(sys.argv) > 1 else ROWS)
