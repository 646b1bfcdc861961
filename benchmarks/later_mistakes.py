# ruff: noqa: E501 -- a row of the table is a line
"""Forty other mistakes of an experimenter, as in `benchmarks.mistakes`: written down, with what has to be said, before the first was made."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import av
import numpy as np
import pandas as pd

from benchmarks.mistakes import (
    RUN,
    RUNS,
    Mistake,
    Spoil,
    added,
    both,
    effect,
    films,
    kPa,
    rows,
    table,
    text,
    try_all,
)

FIT = "fit CAMPAIGN --segments 4"
SHOWN = ("check", "track", "sync")  # what somebody with films would try


def axes_swapped(track: pd.DataFrame) -> pd.DataFrame:
    return track.rename(columns=lambda name: name.translate(str.maketrans("xy", "yx")) if name[0] in "xy" else name)


def upside_down(track: pd.DataFrame) -> pd.DataFrame:
    return track.assign(**{name: -track[name] for name in track if name[0] == "y"})


def stuck(pressure: pd.Series) -> pd.Series:
    return pressure.where(pressure.index < 0.6 * len(pressure), pressure.iloc[int(0.6 * len(pressure))])


def seconds_only(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(
        time_s=(pd.Timestamp("2026-03-01 10:00:05") + pd.to_timedelta(log["time_s"], "s")).dt.floor("s").astype(str)
    )


def every_role(role: str) -> Spoil:
    def spoil(folder: Path) -> None:
        for path in folder.glob("*/experiment.yaml"):
            path.write_text(
                "".join(
                    f"role: {role}\n" if line.startswith("role:") else f"{line}\n"
                    for line in path.read_text().splitlines()
                )
            )

    return spoil


def within_itself(folder: Path) -> None:
    shutil.copytree(folder, folder / "copy of Friday", ignore=shutil.ignore_patterns("copy*"))


def settings_swapped(folder: Path) -> None:
    one, other = folder / "campaign.yaml", folder / RUN / "experiment.yaml"
    kept = one.read_text()
    one.write_text(other.read_text())
    other.write_text(kept)


def coded(folder: Path, run: str, pictures: list[np.ndarray], rate: int) -> None:
    with av.open(str(folder / run / "video.mp4"), "w") as made:
        stream = made.add_stream("libx264", rate=rate, options={"crf": "14"})
        stream.height, stream.width, stream.pix_fmt = *pictures[0].shape, "yuv420p"
        for picture in pictures:
            made.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="gray")))
        made.mux(stream.encode(None))


def pictures_of(folder: Path, run: str) -> list[np.ndarray]:
    with av.open(str(folder / run / "video.mp4")) as source:
        return [frame.to_ndarray(format="gray") for frame in source.decode(video=0)]


def backwards(folder: Path) -> None:
    coded(folder, RUN, pictures_of(folder, RUN)[::-1], 30)


def slow_motion(folder: Path) -> None:
    for run in RUNS:
        coded(folder, run, pictures_of(folder, run), 5)


def lying(folder: Path) -> None:
    coded(folder, RUN, [np.rot90(picture) for picture in pictures_of(folder, RUN)], 30)


def one_photo(folder: Path) -> None:
    photos = sorted((folder / "calibration").glob("board_*"))
    for photo in photos[1:]:
        shutil.copy(photos[0], photo)


def hints(lines: str) -> Spoil:
    return text("  vertical:", f"{lines}\n  vertical:")


def broken_effect(folder: Path) -> None:
    effect()(folder)
    text("(1 - self.c)", "(1 - self.c", "own.py")(folder)


LATER: dict[str, Mistake] = {
    "x and y of the points swapped": Mistake(table("track.csv", axes_swapped, RUNS), r"track: .*(swapped|x and y|hang|horizontal)"),
    "y counted downwards": Mistake(table("track.csv", upside_down, RUNS), r"track: .*(y |up|down)"),
    "log in mbar for kPa, every run": Mistake(kPa(lambda p: 10 * p, RUNS), r"pressure: .*mbar"),
    "log's time in ms": Mistake(table("pressure.csv", lambda t: t.assign(time_s=1000 * t["time_s"])), r"time_unit: ms"),
    "number of the row for the log's time": Mistake(table("pressure.csv", lambda t: t.assign(time_s=range(len(t))), RUNS), r"pressure: .*(number of|row)"),
    "volts of the sensor, 0.5 to 4.5 V, for kPa": Mistake(kPa(lambda p: 0.5 + p / 150, RUNS), r"pressure: .*(unit|bar|MPa|less pressure)"),
    "log ends half way": Mistake(table("pressure.csv", lambda t: t[: len(t) // 2]), rf"{RUN}.*(log|pressure).*(ends|only|half|%|cover)", "012"),
    "log of nothing: the pressure is 0 in every row": Mistake(kPa(lambda p: 0 * p), r"pressure: .*(never|does not change|constant|the same)", "012"),
    "sensor that ends at 100 kPa": Mistake(kPa(lambda p: p.clip(upper=100.0), RUNS), r"pressure: .*(100 kPa|range|saturat|clip)"),
    "sensor that hangs from half of the run on": Mistake(kPa(stuck), r"pressure: .*(stands still|stuck|hangs|does not change|same)"),
    "header once more in the middle of the log": Mistake(rows(lambda r: [*r[:900], r[0], *r[900:]]), r"row 900.*(header|time_s)", "02"),
    "newest row first": Mistake(rows(lambda r: [r[0], *r[:0:-1]]), r"(newest|last row first|backwards|sort the log|reverse)", "2"),
    "log's time rounded to 10 ms": Mistake(table("pressure.csv", lambda t: t.assign(time_s=t["time_s"].round(2))), r"time.*row.*(as the row before|equal|same|rounded|digits)", "02"),
    "dates without parts of a second": Mistake(table("pressure.csv", seconds_only), r"(whole seconds|part of a second|fraction|digits|same time|rounded)", "2"),
    "OVL where the meter ended": Mistake(rows(lambda r: [f"{x.split(',')[0]},OVL" if 700 <= k < 720 else x for k, x in enumerate(r)]), r"row (699|700|701).*OVL", "2"),
    "settings of campaign and experiment swapped": Mistake(settings_swapped, r"rfea-experiment/1.*rfea-campaign/1|format", "2"),
    "a campaign copied into itself": Mistake(within_itself, r"copy of Friday.*(campaign|not read)"),
    "a run called rfea": Mistake(lambda f: (f / RUN).rename(f / "rfea"), r"rfea.*(results|another name|rename|call)", "02"),
    "the log as the track": Mistake(text("file: track.csv", "file: pressure.csv", f"{RUN}/experiment.yaml"), r"track.*(tip_x_mm|x00_mm|angle_deg)", "2"),
    "every log 0.5 s late": Mistake(table("pressure.csv", lambda t: t.assign(time_s=t["time_s"] + 0.5), RUNS), r"(before|late|another run|sync)"),
    "gravity up where it hangs": Mistake(added("rig: {gravity: up}\n", "campaign.yaml"), r"gravity", "012", ("check", FIT)),
    "gravity none where it hangs": Mistake(added("rig: {gravity: none}\n", "campaign.yaml"), r"gravity", "012", ("check", FIT)),
    "length 150 for 155 mm": Mistake(text("155 mm", "150 mm"), r"actuator\.length"),
    "outer radius 5 for 4 mm": Mistake(text("outer_radius: 4 mm", "outer_radius: 5 mm"), r"actuator\.outer_radius"),
    "every run a test": Mistake(every_role("test"), r"role.*train|train.*role", "012", ("check", "fit")),
    "rate of 240 Hz for a film of 30": Mistake(text("file: video.mp4", "file: video.mp4\n  rate: 240 Hz", f"{RUN}/experiment.yaml"), r"video\.rate", "012", SHOWN, "films"),
    "film played backwards": Mistake(backwards, rf"{RUN}.*(backwards|another run|before)", "012", SHOWN, "films"),
    "squares counted for inner corners": Mistake(text("- 9\n    - 6", "- 10\n    - 7"), r"inner_corners.*9.*6", "2", SHOWN, "films"),
    "one photo of the board under every name": Mistake(one_photo, r"(same photo|same picture|copied|alike|copies)", "012", SHOWN, "films"),
    "a photo of the tilted board as the plane": Mistake(lambda f: shutil.copy(next(iter(sorted((f / "calibration").glob("board_*")))), next(iter((f / "calibration").glob("plane*")))), r"plane", "012", SHOWN, "films"),
    "hints of clamp and tip swapped": Mistake(hints("  clamp: [[561, 1069], [608, 1069]]\n  tip: [580, 219]"), r"camera\.(clamp|tip)", "012", SHOWN, "films"),
    "hints in pixels of a larger picture": Mistake(hints("  clamp: [[1203, 437], [1116, 438]]\n  tip: [1172, 2123]"), r"camera\.(clamp|tip).*(outside|beyond|picture)", "2", SHOWN, "films"),
    "one film turned on its side": Mistake(lying, rf"{RUN}.*(turn|1280 x 720)", "012", SHOWN, "films"),
    "every film mirrored": Mistake(films(lambda p, _: p[:, ::-1]), r"(mirror|actuator\.bends)", "012", SHOWN, "films"),
    "slow motion as the phone keeps it": Mistake(slow_motion, r"(video\.rate|slow|another run|never meet)", "012", SHOWN, "films"),
    "two effects with a comma": Mistake(lambda _: None, r"--add maxwell --add coulomb", "2", ("fit CAMPAIGN --add maxwell,coulomb",)),
    "a prior with +- for ±": Mistake(lambda _: None, r"±|base: done", "02", ("fit CAMPAIGN --segments 4 --prior r_hyd=3.6mm+-0.2mm",)),
    "init over a campaign that is there": Mistake(lambda _: None, r"(already|there is|exists)", "2", ("init CAMPAIGN",)),
    "an effect file with a bracket missing": Mistake(broken_effect, r"own\.py.*(line \d+|:\d+)", "2", ("fit CAMPAIGN --add softer --effect-file CAMPAIGN/own.py",)),
    "an effect whose units do not fit": Mistake(both(effect(), text("stiffness * (1 - self.c)", "stiffness - self.c", "own.py")), r"own\.py.*unit|unit.*own\.py|softer.*unit", "2", ("fit CAMPAIGN --add softer --effect-file CAMPAIGN/own.py",)),
}  # fmt: skip

if __name__ == "__main__":
    try_all(*(Path(word) for word in sys.argv[1:2]), *sys.argv[2:3], mistakes=LATER)
