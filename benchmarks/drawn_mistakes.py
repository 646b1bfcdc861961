# ruff: noqa: E501 -- a row of the table is a line
"""Forty mistakes drawn by a seed out of 82, as in `benchmarks.mistakes`: written down, with what has to be said, before any check was looked at.

Tried as at a terminal of 60 columns, without colour, in a German locale.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from benchmarks.later_mistakes import SHOWN, coded, hints, pictures_of
from benchmarks.mistakes import (
    OTHER,
    RIGHT,
    RUN,
    RUNS,
    Mistake,
    Spoil,
    added,
    both,
    films,
    kPa,
    rows,
    swapped,
    table,
    text,
    try_all,
)

EXP = f"{RUN}/experiment.yaml"
FIT = "fit CAMPAIGN --segments 4"


def right(_: Path, said: str) -> bool:
    return not any(word in said for word in ("warning", "error:", "rfea:"))


def copied(run: str, to: str, *files: str) -> Spoil:
    def spoil(folder: Path) -> None:
        for file in files:
            shutil.copy(folder / run / file, folder / to / file)

    return spoil


def supplied(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(p_supply_kPa=400 + np.random.default_rng(1).normal(0, 0.05, len(log)))


def zoomed(picture: np.ndarray, _: float) -> np.ndarray:
    height, width = picture.shape
    larger = cv2.getRotationMatrix2D((width / 2, height / 2), 0, 1.1)
    return cv2.warpAffine(picture, larger, (width, height), borderMode=cv2.BORDER_REPLICATE)


def at_25_a_second(folder: Path) -> None:
    pictures = pictures_of(folder, RUN)
    coded(folder, RUN, [pictures[int(k * 30 / 25 + 0.5)] for k in range(int(len(pictures) * 25 / 30) - 1)], 25)


def linked(folder: Path) -> None:
    away = folder.parent / "disk of Tuesday"
    away.mkdir()
    (folder / RUN).rename(away / RUN)
    (folder / RUN).symlink_to(away / RUN)


def nodes_reversed(track: pd.DataFrame) -> pd.DataFrame:
    last = sum(name[0] == "x" for name in track) - 1
    return track.rename(columns={f"{a}{k:02d}_mm": f"{a}{last - k:02d}_mm" for a in "xy" for k in range(last + 1)})


def doubled(track: pd.DataFrame) -> pd.DataFrame:
    between = track.assign(time_s=track["time_s"] + track["time_s"].diff().median() / 2)
    return pd.concat([track, between]).sort_values("time_s", kind="stable")


def of_the_day(log: pd.DataFrame) -> pd.DataFrame:
    log = log[log["time_s"] >= 0]
    return log.assign(time_s=[f"14:05:{30 + seconds:06.3f}" for seconds in log["time_s"]])


def morning(log: pd.DataFrame) -> pd.DataFrame:
    before = log.sample(frac=1.0, random_state=1)["pressure_kPa"].to_numpy()
    pressure = np.concatenate([before, before, log["pressure_kPa"].to_numpy()])
    step_s = log["time_s"].diff().median()
    return pd.DataFrame({"time_s": log["time_s"].iloc[0] + step_s * np.arange(len(pressure)), "pressure_kPa": pressure})


def spikes(pressure: pd.Series) -> pd.Series:
    return pressure.where(~pressure.index.isin([700, 1100, 1101, 1500, 1900]), 65535.0)


def loose(pressure: pd.Series) -> pd.Series:
    return pressure.where((pressure.index < 1300) | (pressure.index >= 1340), 0.0)


def german(lines: list[str]) -> list[str]:
    return ["Zeit [s]\tDruck [kPa]", *(line.replace(",", "\t").replace(".", ",") for line in lines[1:])]


DRAWN: dict[str, Mistake] = {
    "German heads, not named in the settings": Mistake(rows(german), rf"{RIGHT}|pressure\.time.*Zeit|Zeit \[s\]", "02"),
    "Pa under a head that says kPa, every run": Mistake(kPa(lambda p: 1000 * p, RUNS), r"pressure: .*\bPa\b", "012"),
    "Unicode text of a spreadsheet (UTF-16, tabs)": Mistake(rows(lambda r: [x.replace(",", "\t") for x in r], "\r\n", "utf-16"), RIGHT),
    "a loose plug: 40 rows of 0": Mistake(kPa(loose), rf"{RUN}.*pressure: .*(leap|zero|0 kPa|row|jump|loose|faster)", "012"),
    "a method of synchronisation misspelt": Mistake(text("method: common_clock", "method: commonclock", EXP), r"sync\.method.*(did you mean|common_clock)", "2"),
    "a model's name misspelt": Mistake(lambda _: None, r"(base|no model)", "2", ("diagnose CAMPAIGN bass",)),
    "a recorder that paused for 0.4 s": Mistake(table("pressure.csv", lambda t: t[(t["time_s"] < .8) | (t["time_s"] > 1.2)]), r"pressure: .*(gap|missing|pause|0\.4|400 ms)"),
    "a repeat of itself": Mistake(added(f"repeat_of: {RUN}\n"), r"repeat_of.*(itself|another)", "02"),
    "a run called 50 % & #3 <b>": Mistake(lambda f: (f / RUN).rename(f / "50 % & #3 <b>"), right, "0", ("report",)),
    "a run that is a link to another disk": Mistake(linked, r"(leads out|--trust|link)", "02"),
    "a run's folder given for the campaign's": Mistake(lambda _: None, rf"(campaign|{RIGHT})", "02", (f"check CAMPAIGN/{RUN}",)),
    "a run's name misspelt": Mistake(lambda _: None, r"(did you mean|steps-1)", "2", ("sync CAMPAIGN -e stepps-1",)),
    "a sensor not zeroed in one run: 12 kPa more": Mistake(kPa(lambda p: p + 12), rf"{RUN}.*(zero|rest|offset)", "012", ("check", FIT)),
    "a validation run that is a copy of the training run": Mistake(copied(RUN, OTHER, "pressure.csv", "track.csv"), r"same (track|log)", "012"),
    "absolute pressure called gauge, every run": Mistake(kPa(lambda p: p + 101.3, RUNS), r"pressure: .*absolute"),
    "an effect asked for twice": Mistake(lambda _: None, r"twice|already|base\+maxwell", "02", ("fit CAMPAIGN --segments 4 --add maxwell --add maxwell",)),
    "an offset without a unit": Mistake(text("method: common_clock", "method: offset\n  value: 12", EXP), r"sync\.value.*(unit|ms)", "2"),
    "bends: links": Mistake(text("bends: left", "bends: links"), r"actuator\.bends.*left.*right", "2"),
    "campaign.yaml saved as campaign.yaml.txt": Mistake(lambda f: (f / "campaign.yaml").rename(f / "campaign.yaml.txt"), r"campaign\.yaml\.txt", "2"),
    "density 0.965 kg/m^3": Mistake(text("965 kg/m^3", "0.965 kg/m^3"), r"actuator\.density", "012"),
    "every frame twice": Mistake(table("track.csv", doubled), rf"{RUN}.*track.*(same|repeat|twice|still)|{RIGHT}"),
    "film made 25 pictures a second by leaving some out": Mistake(at_25_a_second, right, "0", ("sync",), "films"),
    "films saved at half size": Mistake(films(lambda p, _: cv2.resize(p, None, fx=.5, fy=.5, interpolation=cv2.INTER_AREA)), r"360 x 640", "2", SHOWN, "films"),
    "five rows of 65535": Mistake(kPa(spikes), rf"{RUN}.*pressure: .*(65535|leap|spike|row|jump)", "012"),
    "hints in mm for pixels": Mistake(hints("  clamp: [[-4, 0], [4, 0]]\n  tip: [0, -155]"), r"camera\.(clamp|tip).*(outside|px|pixel|picture)", "2", SHOWN, "films"),
    "length in cm called mm": Mistake(text("155 mm", "15.5 mm"), r"actuator\.length", "012"),
    "length with what is clamped: 175 mm": Mistake(text("155 mm", "175 mm"), r"actuator\.length"),
    "payloat": Mistake(added("conditions: {payloat: 10 g}\n"), r"payloat.*did you mean.*payload", "2"),
    "points from the tip to the clamp": Mistake(table("track.csv", nodes_reversed, RUNS), r"track: .*(order|tip to the clamp|clamp|reverse|turned)", "012"),
    "recorded_at as 01.03.2026": Mistake(added("recorded_at: 01.03.2026 14:05\n"), r"recorded_at.*2026-", "2"),
    "rows and columns of the board swapped": Mistake(text("- 9\n    - 6", "- 6\n    - 9"), rf"inner_corners|{RIGHT}", "012", SHOWN, "films"),
    "simulate over a campaign": Mistake(lambda _: None, r"(exists|already|empty|another)", "2", ("simulate CAMPAIGN",)),
    "tabs and decimal commas": Mistake(rows(lambda r: [r[0].replace(",", "\t"), *(x.replace(",", "\t").replace(".", ",") for x in r[1:])]), RIGHT),
    "the log by times of day, without a date": Mistake(table("pressure.csv", of_the_day), rf"{RIGHT}|with the date|date", "02"),
    "the log of a whole morning": Mistake(table("pressure.csv", morning), rf"{RUN}.*(another run|never meet|follows|clock|shift|late|before)", "012", ("check", "sync")),
    "the supply's column named for the chamber's": Mistake(both(table("pressure.csv", supplied), text("file: pressure.csv", "file: pressure.csv\n  pressure: p_supply_kPa", EXP)), r"pressure: .*(constant|barely|hardly|never|not change|follows|another column|sensor)", "012", ("check", "sync")),
    "track cut at its beginning, times from 0 again": Mistake(table("track.csv", lambda t: t[30:].assign(time_s=t["time_s"][30:] - t["time_s"].iloc[30])), rf"{RUN}.*(shift|another run|earlier|later|clock|before|late)", "012", ("check", "sync")),
    "tracks of two runs swapped": Mistake(swapped("track.csv"), r"another run"),
    "unit: Kpa": Mistake(text("file: pressure.csv", "file: pressure.csv\n  unit: Kpa", EXP), rf"{RIGHT}|kPa", "02"),
    "zoomed in by 10 % for one run": Mistake(films(zoomed, (RUN,)), rf"{RUN}.*(length|square|zoom|camera)", "012", SHOWN, "films"),
}  # fmt: skip

if __name__ == "__main__":
    os.environ |= {"COLUMNS": "60", "NO_COLOR": "1", "LANG": "de_DE.UTF-8", "LC_ALL": "de_DE.UTF-8"}
    try_all(*(Path(word) for word in sys.argv[1:2]), *sys.argv[2:3], mistakes=DRAWN)
