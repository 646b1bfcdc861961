"""Kills at random moments: a command is stopped with SIGKILL, run again, and must end with the results of an undisturbed one."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rfea_vision.twin import TwinOptions, simulate

ENOUGH = 200  # kills of the whole group
_RFEA = [sys.executable, "-c", "from rfea_vision.cli import main; main()"]
_RECIPE = "format: rfea-recipe/1\nsteps:\n  - fit: {segments: 2}\n  - compare\n"
_COMMANDS: dict[str, list[str]] = {
    "track": ["track", "CAMPAIGN"],
    "fit": ["fit", "CAMPAIGN", "--segments", "2"],
    "improve": ["improve", "CAMPAIGN", "--segments", "2"],
    "batch": ["batch", "CAMPAIGN", "--recipe", "RECIPE", "--index", "INDEX"],
}


@dataclass
class Killed:
    """What became of the kills of one command."""

    command: str
    kills: int = 0
    too_late: int = 0  # the command had ended before
    different: list[str] = field(default_factory=list)
    redone: int = 0  # stages that had been finished and ran again
    seconds: float = 0.0


def results_in(campaign: Path) -> dict[str, bytes]:
    """Every result in JSON or netCDF, by path; what is unfinished must not be there."""
    out = campaign / "rfea"
    kept = [
        path
        for path in out.rglob("*")
        if path.is_file() and ".stages" not in path.parts and path.name != "timings.json"
    ]
    left = [path.name for path in kept if path.name.startswith(".") and path.suffix != ".npz"]
    if left:
        raise AssertionError(f"left unfinished: {left}")
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in kept if path.suffix in (".json", ".nc")}


def kill_often(command: str, campaign: Path, kills: int, seed: int = 0) -> Killed:
    """Kill a command so many times, each time on a fresh copy of `campaign`, and compare what a re-run ends with."""
    chance, found = random.Random(f"{seed} {command}"), Killed(command)
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        calm = Path(name) / "calm"
        shutil.copytree(campaign, calm)
        begun = time.monotonic()
        _run(command, calm)
        found.seconds = time.monotonic() - begun
        wanted = results_in(calm)
        for number in range(kills):
            folder = Path(name) / f"killed-{number}" / calm.name
            shutil.copytree(campaign, folder)
            process = _start(command, folder)
            try:
                process.wait(chance.uniform(0.15, 1.0) * found.seconds)
                found.too_late += 1
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL) if command != "batch" else process.kill()
                process.wait()
            found.kills += 1
            before = {path.name: path.read_bytes() for path in (folder / "rfea" / ".stages").glob("*@*.json")}
            _run(command, folder)
            after = {path.name: path.read_bytes() for path in (folder / "rfea" / ".stages").glob("*@*.json")}
            found.redone += sum(after.get(key) != content for key, content in before.items())
            made = results_in(folder)
            different = sorted(key for key in wanted.keys() | made.keys() if wanted.get(key) != made.get(key))
            if different:
                found.different.append(f"{command}, kill {number}: {', '.join(different)}")
            shutil.rmtree(folder.parent)
    return found


def _start(command: str, campaign: Path) -> subprocess.Popen[bytes]:
    recipe = campaign.parent / "recipe.yaml"
    recipe.write_text(_RECIPE)
    places = {"CAMPAIGN": str(campaign), "RECIPE": str(recipe), "INDEX": str(campaign.parent / "index.html")}
    arguments = [places.get(word, word) for word in _COMMANDS[command]]
    return subprocess.Popen(
        [*_RFEA, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def _run(command: str, campaign: Path) -> None:
    code = _start(command, campaign).wait(timeout=600)
    if code != 0:
        raise AssertionError(f"{command}: a run after a kill ended with exit code {code}")


def small_campaign(folder: Path) -> Path:
    """Two short runs of a coarse twin."""
    options = TwinOptions(
        hidden={"gravity_tilt.angle": -0.08}, seed=3, roles=("train", "validate"), duration_s=0.6, rate_Hz=60.0, joints=4,
        sync="common_clock", write_truth=False,
    )  # fmt: skip
    simulate(folder, options)
    return folder


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    shares = {"track": 70, "fit": 70, "improve": 10, "batch": 50}
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        campaign = small_campaign(Path(name) / "tube")
        found = [kill_often(command, campaign, kills) for command, kills in shares.items()]
    different = [text for item in found for text in item.different]
    for text in different:
        sys.stderr.write(f"  {text}\n")
    kills = sum(item.kills for item in found)
    return [
        {"name": "kills (track, fit, improve, batch)", "value": kills, "unit": "kills", "target": f">= {ENOUGH}",
         "met": kills >= ENOUGH},
        {"name": "re-runs that ended with other results", "value": len(different), "unit": "runs", "target": "0", "met": not different},
        {"name": "finished stages that ran again", "value": sum(item.redone for item in found), "unit": "stages", "target": "0",
         "met": not any(item.redone for item in found)},
        {"name": "commands that had ended before they were killed", "value": sum(item.too_late for item in found), "unit": "kills"},
    ]  # fmt: skip
