# ruff: noqa: E501 -- a row of the table is a line
"""Mistakes of an experimenter, each made in a campaign that is right: told in a sentence, or without effect.

A row of `MISTAKES` says how the campaign is spoilt, which commands somebody would try one after the other, with which exit codes the
mistake may end, and what has to be said (an expression over everything that was printed). The first command that says it ends the row.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pandas as pd

from benchmarks.damage.rows import ROWS, add_row, rows_of_this_code

MOST_S = 600.0  # for one command, on a busy machine
RUN, OTHER, TEST = "steps-1", "multisine-2", "mixed-3"
RUNS = (RUN, OTHER, TEST)
Spoil = Callable[[Path], None]
_HIDDEN = (
    "--hidden",
    "maxwell.k1=0.15",
    "--hidden",
    "maxwell.T=0.5s",
    "--roles",
    "train,validate,test",
    "--duration",
    "2s",
)
BASES = {
    "lines": (*_HIDDEN, "--observe", "midline", "--rate", "60Hz", "--sync", "common_clock"),
    "films": (*_HIDDEN, "--video", "--rate", "30Hz", "--sync", "common_clock"),
}
RIGHT = "0 errors, 0 warnings"


@dataclass(frozen=True)
class Mistake:
    """What is done to a campaign, and how it has to be told."""

    spoil: Spoil
    says: str | Callable[[Path, str], bool]
    codes: str = "0"
    commands: tuple[str, ...] = ("check",)
    base: str = "lines"


def text(old: str, new: str, file: str = "campaign.yaml") -> Spoil:
    """Write something else in a file."""

    def spoil(folder: Path) -> None:
        path = folder / file
        assert old in path.read_text(), (old, path)
        path.write_text(path.read_text().replace(old, new, 1))

    return spoil


def added(lines: str, file: str = f"{RUN}/experiment.yaml") -> Spoil:
    """Add lines to the end of a file."""
    return lambda folder: (folder / file).write_text((folder / file).read_text() + lines)


def table(
    file: str, change: Callable[[pd.DataFrame], pd.DataFrame], runs: tuple[str, ...] = (RUN,), **how: Any
) -> Spoil:
    """Change the table of some runs."""

    def spoil(folder: Path) -> None:
        for run in runs:
            change(pd.read_csv(folder / run / file)).to_csv(folder / run / file, index=False, **how)

    return spoil


def rows(change: Callable[[list[str]], list[str]], end: str = "\n", encoding: str = "utf-8") -> Spoil:
    """Change the log of a run as lines of text."""

    def spoil(folder: Path) -> None:
        path = folder / RUN / "pressure.csv"
        path.write_bytes((end.join(change(path.read_text().splitlines())) + end).encode(encoding))

    return spoil


def both(*spoils: Spoil) -> Spoil:
    """Make several changes."""

    def spoil(folder: Path) -> None:
        for each in spoils:
            each(folder)

    return spoil


def kPa(change: Callable[[pd.Series], pd.Series], runs: tuple[str, ...] = (RUN,)) -> Spoil:
    """Change the pressures of some runs."""
    return table("pressure.csv", lambda log: log.assign(pressure_kPa=change(log["pressure_kPa"])), runs)


def at(name: str, first: str, hours: Callable[[pd.Series], Any] = lambda time_s: 0, run: str = RUN) -> Spoil:
    """Give a table the time of the day."""

    def dated(found: pd.DataFrame) -> pd.DataFrame:
        shifted = found["time_s"] + 3600 * hours(found["time_s"])
        return found.assign(time_s=(pd.Timestamp(first) + pd.to_timedelta(shifted, unit="s")).astype(str))

    return table(name, dated, (run,))


def films(change: Callable[[np.ndarray, float], np.ndarray], runs: tuple[str, ...] = RUNS) -> Spoil:
    """Draw in the pictures (grey) of films; `change` is given a picture and the share of the film before it."""

    def spoil(folder: Path) -> None:
        for run in runs:
            path = folder / run / "video.mp4"
            with av.open(str(path)) as source:
                stream = source.streams.video[0]
                rate, pictures = (
                    stream.average_rate,
                    [frame.to_ndarray(format="gray") for frame in source.decode(stream)],
                )
            with av.open(str(path), "w") as made:
                stream = made.add_stream("libx264", rate=rate, options={"crf": "14"})
                stream.height, stream.width, stream.pix_fmt = *pictures[0].shape, "yuv420p"
                for number, picture in enumerate(pictures):
                    drawn = np.ascontiguousarray(change(picture, number / len(pictures)))
                    made.mux(stream.encode(av.VideoFrame.from_ndarray(drawn, format="gray")))
                made.mux(stream.encode(None))

    return spoil


def swapped(file: str) -> Spoil:
    """Swap a file of two runs."""

    def spoil(folder: Path) -> None:
        one, other = folder / RUN / file, folder / OTHER / file
        kept = one.read_bytes()
        one.write_bytes(other.read_bytes())
        other.write_bytes(kept)

    return spoil


def saved_again(folder: Path) -> None:
    shutil.copy(folder / RUN / "video.mp4", folder / OTHER / "video.mp4")
    films(lambda picture, _: picture, (OTHER,))(folder)


def cut_off(folder: Path) -> None:
    path = folder / RUN / "video.mp4"
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])


def plane_of_a_phone(folder: Path) -> None:
    path = folder / "calibration" / "plane.jpg"
    cv2.imwrite(str(path), cv2.resize(cv2.imread(str(path)), (960, 1280)))


def hose(picture: np.ndarray, _: float) -> np.ndarray:
    """A dark hose that leaves the clamp and hangs beside the tube."""
    x = np.array([520, 440, 330, 260, 240, 300, 420])
    line = np.column_stack([x, np.linspace(60, 1270, len(x))]).astype(np.int32)
    return cv2.polylines(picture.copy(), [line], isClosed=False, color=50, thickness=24, lineType=cv2.LINE_AA)


def tube_as_without(folder: Path, said: str) -> bool:
    """Whether the track is that of the film without the hose, or is doubted."""
    from rfea_vision.artefacts import Track

    tracks = [
        Track.load(place / "rfea" / RUN / "track.nc").dataset
        for place in (folder, folder.parents[1] / "right" / "films")
    ]
    apart_mm = np.linalg.norm(tracks[0]["tip"].values - tracks[1]["tip"].values, axis=1)
    return "warning" in said or bool(np.nanmedian(apart_mm) < 0.5 and np.isfinite(apart_mm).mean() > 0.9)


def saved_with_fewer_digits(folder: Path) -> None:
    for file in ("track.csv", "pressure.csv"):
        pd.read_csv(folder / RUN / file).to_csv(folder / TEST / file, index=False, float_format="%.3f")


def deeper(folder: Path) -> None:
    (folder / "monday").mkdir()
    (folder / OTHER).rename(folder / "monday" / OTHER)


def odd_names(folder: Path) -> None:
    (folder / RUN).rename(folder / "Läufe bei 20 °C (1)")
    folder.rename(folder.with_name("Schläuche 'A' & B"))


def can_be_pasted(folder: Path, said: str) -> bool:
    """Whether the next command is one that a shell takes as it stands."""
    line = said.rpartition("next: ")[2].splitlines()[0].partition("   (")[0]
    return str(folder.with_name("Schläuche 'A' & B")) in shlex.split(line)


def effect(**parts: str) -> Spoil:
    """Write an effect file with something wrong in it."""
    words = {"id": "softer", "low": "0", "high": "1", "absent": "0", "usual": "0.1"} | parts
    return lambda folder: (folder / "own.py").write_text(
        "import sympy as sp\nfrom rfea_vision.effects.base import Effect, EffectParameter, Joint\n\n\n"
        'class Softer(Effect):\n    """k_j becomes k_j (1 - c)."""\n\n'
        f'    id = "{words["id"]}"\n    title = "Softer"\n    reference = "mine"\n'
        f'    parameters = {{"c": EffectParameter("1", {words["absent"]}, {words["low"]}, {words["high"]}, {words["usual"]}, "share")}}\n\n'
        "    def stiffness(self, joint: Joint, stiffness: sp.Expr) -> sp.Expr:\n        return stiffness * (1 - self.c)\n"
    )


def half_a_result(folder: Path) -> None:
    run(folder, "sync CAMPAIGN")
    path = folder / "rfea" / RUN / "track.nc"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def nodes_swapped(track: pd.DataFrame) -> pd.DataFrame:
    new = {f"{axis}{a:02d}_mm": f"{axis}{b:02d}_mm" for axis in "xy" for a, b in ((6, 7), (7, 6))}
    return track.rename(columns=new)


def small_disk(folder: Path) -> None:
    (folder / "disk").mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(folder / "disk")], check=False)
    if made.returncode:
        raise PermissionError("only root can mount a small disk")


CLAMP = "  clamp: [[217, 558], [217, 601]]\n  vertical:"
ON_FULL_DISK = "simulate CAMPAIGN/disk/twin --experiments 2 --duration 20s"
MISTAKES: dict[str, Mistake] = {
    "one log in mmHg": Mistake(kPa(lambda p: 7.5 * p), rf"{RUN}.*pressure: .*times less for each kPa.*unit"),
    "kPa declared of a column called psi": Mistake(
        both(rows(lambda r: ["time_s,pressure_psi", *r[1:]]), text("file: pressure.csv", "file: pressure.csv\n  pressure: pressure_psi\n  unit: kPa", f"{RUN}/experiment.yaml")),
        r"pressure.*psi.*kPa", "02"),
    "standard errors in um called mm": Mistake(table("track.csv", lambda t: t.assign(sigma_mm=60.0)), r"sigma"),
    "density in lb/ft^3": Mistake(text("965 kg/m^3", "965 lb/ft^3"), r"actuator\.density"),
    "outer radius a diameter, inner radius a radius": Mistake(text("outer_radius: 4 mm", "outer_radius: 8 mm"), r"actuator\.outer_radius"),
    "squares of the board in cm": Mistake(text("square: 9 mm", "square: 9 cm"), r"actuator\.length.*square|square.*actuator\.length", "01", ("check", "track"), "films"),
    "payload in kg for g": Mistake(added("conditions: {payload: 10 kg}\n"), r"payload", "02"),
    "a parameter held in m for mm": Mistake(lambda _: None, r"r_hyd.*mm", "2", ("fit CAMPAIGN --fix r_hyd=3.6m",)),
    "every log with its sign turned": Mistake(kPa(lambda p: -0.3 * p, RUNS), r"pressure: .*(sign|turned|other side)"),
    "summer time ends during a run": Mistake(at("pressure.csv", "2026-10-25 02:59:59", lambda s: -1 * (s > 1)), r"pressure\.csv: time, row .*(hour|clock)", "2"),
    "log by local time, track by UTC": Mistake(both(at("pressure.csv", "2026-03-01 11:00"), at("track.csv", "2026-03-01 10:00")), rf"{RUN}.*(never meet|hour)"),
    "days of a spreadsheet": Mistake(table("pressure.csv", lambda t: t.assign(time_s=(45991.5 + t["time_s"] / 86400).round(9))), r"time_unit: day"),
    "an offset with the wrong sign": Mistake(
        both(table("pressure.csv", lambda t: t.assign(time_s=t["time_s"] + 0.4)), text("method: common_clock", "method: offset\n  value: -400 ms", f"{RUN}/experiment.yaml")),
        rf"{RUN}.*(late|early|after|before|another run)"),
    "held until after the run's end": Mistake(added("start: {held_until: 20 s}\n"), r"held_until", "012", ("check", "fit CAMPAIGN --segments 4")),
    "a title above the columns": Mistake(rows(lambda r: ["Run 7 of Monday", *r]), r"pressure\.csv.*(header|title|line|column)", "2"),
    "units in a row of their own": Mistake(rows(lambda r: [r[0], "s,kPa", *r[1:]]), rf"row 1.*kPa|{RIGHT}", "02"),
    "units inside the cells": Mistake(rows(lambda r: [r[0], *(f"{x} kPa" for x in r[1:])]), r"pressure_kPa.*row 1.*kPa'? is not a number", "2"),
    "sums below the columns": Mistake(rows(lambda r: [*r, "mean,123.4"]), r"row \d+: 'mean' is not a number", "2"),
    "line ends of an old Macintosh": Mistake(rows(lambda r: r, "\r"), rf"{RIGHT}|line ends?", "02"),
    "a degree sign of Windows in a column that is not used": Mistake(rows(lambda r: [f"{r[0]},T (°C)", *(f"{x},20" for x in r[1:])], encoding="cp1252"), rf"{RIGHT}|UTF-8", "02"),
    "two columns of one name": Mistake(rows(lambda r: [f"{r[0]},pressure_kPa", *(f"{x},0" for x in r[1:])]), r"pressure_kPa.*(twice|two columns|2 columns)", "02"),
    "two points of the line swapped": Mistake(table("track.csv", nodes_swapped, RUNS), r"track: .*(order|swapped|folds|back)"),
    "a test that is a training run saved with fewer digits": Mistake(saved_with_fewer_digits, r"the same (log|track)"),
    "a repeat of another pressure": Mistake(added(f"repeat_of: {RUN}\n", f"{OTHER}/experiment.yaml"), rf"{OTHER}.*repeat_of"),
    "a role written twice": Mistake(text("role: train", "role: train\nrole: test", f"{RUN}/experiment.yaml"), r"role.*(twice|already|again)", "2"),
    "a key of the board misspelt": Mistake(text("square:", "sqaure:"), r"camera\.board\.sqaure.*did you mean 'square'", "2", base="films"),
    "a run one folder too deep": Mistake(deeper, r"monday", "02"),
    "a run without its experiment.yaml": Mistake(lambda f: (f / OTHER / "experiment.yaml").unlink(), rf"{OTHER}.*experiment\.yaml", "02"),
    "umlauts, blanks and quotes in names": Mistake(odd_names, can_be_pasted),
    "a file called rfea": Mistake(lambda f: (f / "rfea").write_text("notes"), r"rfea: is a file", "2", ("sync",)),
    "a model's name with a slash": Mistake(lambda _: None, r"--name.*steps/first", "2", ("fit CAMPAIGN --name steps/first",)),
    "an effect that takes the id of another": Mistake(effect(id="maxwell"), r"own\.py.*maxwell", "2", ("fit CAMPAIGN --add maxwell --effect-file CAMPAIGN/own.py",)),
    "an effect with its bounds turned round": Mistake(effect(low="1", high="0"), r"own\.py.*(bound|lower)", "2", ("fit CAMPAIGN --add softer --effect-file CAMPAIGN/own.py",)),
    "an effect absent outside of its bounds": Mistake(effect(absent="2"), r"own\.py.*(absent|bound)", "2", ("fit CAMPAIGN --add softer --effect-file CAMPAIGN/own.py",)),
    "half a result, as a shared folder leaves it": Mistake(half_a_result, rf"track {RUN}: done", "0", ("sync",)),
    "a twin on a full disk": Mistake(small_disk, r"the disk is full", "2", (ON_FULL_DISK,)),
    "films of two runs swapped": Mistake(swapped("video.mp4"), rf"{RUN}.*another run", "012", ("check", "sync"), "films"),
    "one film in two runs, saved again": Mistake(saved_again, rf"{OTHER}.*(another run|the same film)", "012", ("check", "sync"), "films"),
    "a camera upside down": Mistake(films(lambda p, _: p[::-1, ::-1]), r"(upside|above|gravity|turned|level|vertical)", "012", ("check", "track", "sync"), "films"),
    "a film cut off": Mistake(cut_off, r"video\.mp4.*(cut|damaged|copy)", "02", base="films"),
    "the plane's photo by another camera": Mistake(plane_of_a_phone, r"plane.*(960|1280)", "2", base="films"),
    "a hose beside the tube": Mistake(films(hose, (RUN,)), tube_as_without, "01", (f"track CAMPAIGN -e {RUN}",), "films"),
    "light that goes out half way": Mistake(films(lambda p, s: p * 0 + 3 if s > 0.4 else p, (RUN,)), rf"{RUN}.*frames were measured", "01", (f"track CAMPAIGN -e {RUN}",), "films"),
    "the wrong side": Mistake(text("bends: left", "bends: right"), r"actuator\.bends", "012", ("check", "track", "sync"), "films"),
    "the clamp as rows and columns": Mistake(text("  vertical:", CLAMP), r"clamp", "012", ("check", f"track CAMPAIGN -e {RUN}"), "films"),
    "a charuco board declared": Mistake(text("kind: checkerboard", "kind: charuco\n    marker: 6 mm\n    dictionary: 4x4_50"), r"board", "2", base="films"),
}  # fmt: skip


def run(folder: Path, command: str) -> tuple[int, str]:
    """Run a command on a campaign: its exit code, and what it printed."""
    words = [word.replace("CAMPAIGN", str(folder)) for word in command.split()]
    words += [] if len(words) > 1 else [str(folder)]
    ended = subprocess.run(
        [sys.executable, "-m", "rfea_vision", *words], capture_output=True, text=True, check=False, timeout=MOST_S
    )
    return ended.returncode, ended.stdout + ended.stderr


def attempt(mistake: Mistake, folder: Path) -> tuple[str, str, str]:
    """Make a mistake in a campaign: how it ended (told, silent, wrong), by which command, and what was said."""
    mistake.spoil(folder)
    if not folder.exists():
        folder = next(folder.parent.iterdir())
    heard = []
    for command in mistake.commands:
        code, said = run(folder, command)
        flat = " ".join(said.split())
        told = mistake.says(folder, said) if callable(mistake.says) else bool(re.search(mistake.says, flat))
        lines = [line for line in said.splitlines() if re.match(r"\s*(error|warning|rfea|Error)[: ]", line)]
        heard = (
            [line for line in lines if not isinstance(mistake.says, str) or re.search(mistake.says, line)]
            or lines
            or heard
        )
        if told and str(code) in mistake.codes and "Traceback" not in said and "a fault in" not in said:
            return "told", command.split()[0], heard[0] if heard else said.strip().splitlines()[-1]
    return (
        ("wrong" if heard or "Traceback" in said else "silent"),
        command.split()[0],
        f"exit {code}: " + " / ".join(heard or [flat[-200:]]),
    )


def try_all(file: Path = ROWS, only: str = "", mistakes: dict[str, Mistake] = MISTAKES) -> None:
    """Make every mistake that is not in `file` yet, or those whose name holds `only`."""
    done = {row["mistake"] for row in rows_of_this_code("mistakes", file)}
    with tempfile.TemporaryDirectory(prefix="mistakes-") as name:
        place = Path(name)
        for base, options in BASES.items():
            if any(item.base == base and only in key for key, item in mistakes.items()):
                code, said = run(place, " ".join(["simulate", f"CAMPAIGN/right/{base}", *options]))
                assert code == 0, said
                code, said = run(place / "right" / base, "sync")  # what is right, is without a doubt
                assert code == 0 and "warning" not in said, said
        for number, (key, mistake) in enumerate(mistakes.items()):
            if key in done or only not in key:
                continue
            folder = place / f"m{number}" / mistake.base
            shutil.copytree(place / "right" / mistake.base, folder, ignore=shutil.ignore_patterns("rfea"))
            try:
                ended, command, said = attempt(mistake, folder)
            except PermissionError as error:
                sys.stderr.write(f"  {key}: not tried: {error}\n")
                continue
            except subprocess.TimeoutExpired:
                ended, command, said = "wrong", mistake.commands[-1], f"no end in {MOST_S:g} s"
            finally:
                subprocess.run(["umount", "-l", str(folder / "disk")], capture_output=True, check=False)
            said = " ".join(said.replace(str(place), "…").split())
            add_row("mistakes", {"mistake": key, "ended": ended, "command": command, "said": said}, file)
            sys.stderr.write(f"  {key}: {ended} by {command}: {said}\n")


if __name__ == "__main__":
    try_all(*(Path(word) for word in sys.argv[1:2]), *sys.argv[2:3])
