"""`memory: carried`: a tube that was softened in one run is soft in the next."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from rfea_vision.errors import InputError
from rfea_vision.stages import open_campaign
from rfea_vision.twin import TwinOptions, simulate

CUT_S = 2.5
SOFTENING = {"mullins.c": 0.35, "mullins.s": 0.6}
SECOND = """format: rfea-experiment/1
role: {role}
track: {{file: track.csv}}
pressure: {{file: pressure.csv}}
sync: common_clock
{more}
"""


def _part(source: Path, target: Path, from_s: float, to_s: float) -> None:
    with source.open(newline="") as stream:
        head, *rows = list(csv.reader(stream))
    kept = [row for row in rows if from_s <= float(row[0]) < to_s]
    with target.open("w", newline="") as stream:
        csv.writer(stream).writerows([head, *kept])


def _write(folder: Path, source: Path, from_s: float, to_s: float, role: str, more: str) -> None:
    folder.mkdir()
    for name in ("track.csv", "pressure.csv"):
        _part(source / name, folder / name, from_s, to_s)
    (folder / "experiment.yaml").write_text(SECOND.format(role=role, more=more))


@pytest.fixture(scope="module")
def one_long_run(tmp_path_factory) -> Path:
    """A campaign with one run of 5 s, whose first half softens the tube for the second."""
    folder = tmp_path_factory.mktemp("memory") / "whole"
    options = TwinOptions(
        hidden=SOFTENING,
        seed=4,
        joints=4,
        duration_s=2 * CUT_S,
        rate_Hz=120,
        roles=("train",),
        kinds=("steps",),
        sync="common_clock",
        noise_mm=0.02,
        write_truth=False,
    )
    simulate(folder, options)
    return folder


def _halves(long: Path, root: Path, memory: str) -> Path:
    """Two runs: the whole as one that began fresh, and its second half as one that says how it began."""
    root.mkdir()
    (root / "campaign.yaml").write_text((long / "campaign.yaml").read_text())
    source = next(path for path in long.iterdir() if path.is_dir() and (path / "track.csv").exists())
    _write(root / "first", source, -9, CUT_S, "train", "recorded_at: 2026-03-01 10:00:00")
    # the first log begins half a second before its first frame
    _write(root / "second", source, CUT_S, 99, "train", f"recorded_at: 2026-03-01 10:00:03\nmemory: {memory}")
    return root


@pytest.mark.study
def test_carried_memory_explains_the_run_that_follows(one_long_run, tmp_path):
    left = {}
    for memory in ("carried", "fresh"):
        work = open_campaign(_halves(one_long_run, tmp_path / memory, memory))
        model = work.fit(name="soft", add=["mullins"], segments=4, joints="middle", starts=0)
        left[memory] = model.metrics["train"].tip_rmse_mm
    floor = 0.02 * np.sqrt(2)
    assert left["carried"] < 2 * floor
    assert left["fresh"] > 5 * left["carried"]


def test_the_order_of_runs_must_be_known(one_long_run, tmp_path):
    root = _halves(one_long_run, tmp_path / "unknown", "carried")
    text = (root / "first" / "experiment.yaml").read_text()
    (root / "first" / "experiment.yaml").write_text(text.replace("recorded_at: 2026-03-01 10:00:00", ""))
    with pytest.raises(InputError, match=r"first.experiment.yaml: recorded_at: is missing"):
        open_campaign(root).sync()


def test_a_moment_that_is_none_is_named(one_long_run, tmp_path):
    root = _halves(one_long_run, tmp_path / "odd", "carried")
    text = (root / "first" / "experiment.yaml").read_text()
    (root / "first" / "experiment.yaml").write_text(text.replace("2026-03-01 10:00:00", "after lunch"))
    with pytest.raises(InputError, match="'after lunch' is no date and time"):
        open_campaign(root).sync()
