"""A stage runs again if, and only if, something that it depends on has changed."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from campaign.campaigns import write_campaign

from rfea_vision import open_campaign
from rfea_vision.campaign import load_campaign
from rfea_vision.errors import DataError
from rfea_vision.stages import Listener, Workspace
from rfea_vision.stages.cache import StageCache, as_json
from rfea_vision.stages.runner import Stage


class Doubling:
    """A stage that doubles the number in a file, and counts how often it is asked to."""

    def __init__(self, folder: Path) -> None:
        self.campaign = load_campaign(write_campaign(folder))
        self.source = folder / "number.txt"
        self.source.write_text("21")
        self.result = self.campaign.out / "doubled.txt"
        self.calls = 0

    def make(self, progress):
        progress(1, 1)
        self.calls += 1
        self.result.parent.mkdir(parents=True, exist_ok=True)
        self.result.write_text(str(2 * int(self.source.read_text())))
        return int(self.result.read_text()), [self.result], "doubled"

    def run(self, *, force=(), options=None, code=None, also=()):
        work = Workspace(self.campaign, force=force)
        stage = Stage("double", "number", [self.source], also, options or {}, code)
        value = work.run(stage, make=self.make, load=lambda: int(self.result.read_text()))
        return value.value, work.outcome("double", "number")


@pytest.fixture
def stage(tmp_path):
    return Doubling(tmp_path / "c")


def test_an_unchanged_stage_is_not_run_again(stage):
    assert stage.run() == (42, "done")
    assert stage.run() == (42, "unchanged")
    assert stage.calls == 1


def test_force_runs_it_again(stage):
    stage.run()
    assert stage.run(force=["other"])[1] == "unchanged"
    assert stage.run(force=["double"]) == (42, "done")
    assert stage.calls == 2


def test_it_runs_again_when_an_input_changes(stage):
    stage.run()
    stage.source.write_text("22")
    assert stage.run() == (44, "done")
    assert stage.run()[1] == "unchanged"


def test_touching_a_file_changes_nothing(stage):
    stage.run()
    stage.source.touch()
    assert stage.run()[1] == "unchanged"


@pytest.mark.parametrize("change", [{"options": {"segments": 8}}, {"code": write_campaign}, {"also": ("abc",)}])
def test_it_runs_again_when_options_code_or_earlier_results_change(stage, change):
    stage.run()
    assert stage.run(**change)[1] == "done"
    assert stage.run(**change)[1] == "unchanged"


@pytest.mark.parametrize("spoil", [Path.unlink, lambda path: path.write_text("0")])
def test_it_runs_again_when_its_output_is_gone_or_altered(stage, spoil):
    stage.run()
    spoil(stage.result)
    assert stage.run() == (42, "done")


def test_damaged_records_only_cost_time(stage):
    stage.run()
    for path in (stage.campaign.out / ".stages").iterdir():
        path.write_text("{broken")
    assert stage.run() == (42, "done")


def test_a_failed_stage_leaves_no_record(stage):
    def fail(progress):
        raise DataError("no")

    stage.make = fail
    with pytest.raises(DataError):
        stage.run()
    assert StageCache(stage.campaign.out).record("double/number") is None


def test_the_listener_hears_of_progress_and_end(stage):
    heard = []

    class Ear(Listener):
        def begin(self, stage, subject):
            heard.append(("begin", stage, subject))
            return lambda done, total: heard.append(("progress", done, total))

        def end(self, stage, subject, outcome, sentence):
            heard.append(("end", outcome, sentence))

    work = Workspace(stage.campaign, listener=Ear())
    work.run(Stage("double", "number"), make=stage.make, load=lambda: 0)
    assert heard == [("begin", "double", "number"), ("progress", 1, 1), ("end", "done", "doubled")]


def test_records_keep_raw_inputs_by_their_place_in_the_campaign(stage):
    stage.run()
    record = StageCache(stage.campaign.out).record("double/number")
    assert record is not None and list(record.inputs) == ["number.txt"]
    assert len(record.inputs["number.txt"]) == 64


def test_options_become_plain_values():
    @dataclass(frozen=True)
    class Options:
        file: Path
        values: tuple[float, ...]
        more: dict

    kept = as_json(Options(Path("/somewhere/video.mp4"), (1.0, 2.0), {"a": np.float64(3.0), "b": np.arange(2)}))
    assert kept == {"file": "video.mp4", "values": [1.0, 2.0], "more": {"a": 3.0, "b": [0, 1]}}


def test_a_result_does_not_depend_on_where_one_stopped_before_it(tmp_path):
    at_once, in_two = (write_campaign(tmp_path / name) for name in ("a", "b"))
    open_campaign(at_once).sync()
    open_campaign(in_two).track()
    open_campaign(in_two).sync()  # reads the tracks back
    for file in (at_once / "rfea").glob("*/*.nc"):
        assert file.read_bytes() == (in_two / "rfea" / file.relative_to(at_once / "rfea")).read_bytes(), file.name


def test_a_model_names_the_files_of_the_runs_that_it_saw_whatever_else_was_measured(tmp_path):
    alone, all_measured = (write_campaign(tmp_path / name) for name in ("a", "b"))
    open_campaign(alone).sync(["sine"])
    open_campaign(all_measured).sync()
    named = [open_campaign(folder).raw_inputs(["sine"]) for folder in (alone, all_measured)]
    assert named[0] == named[1] and {Path(path).parts[0] for path in named[0]} == {"sine"}


def test_a_track_is_doubted_by_the_length_that_now_stands_in_the_file(tmp_path):
    file = write_campaign(tmp_path / "a") / "campaign.yaml"
    right = file.read_text()
    file.write_text(re.sub(r"length: \d+ mm", "length: 15 mm", right))
    doubts = []
    for text in (file.read_text(), right):
        file.write_text(text)
        work = open_campaign(file.parent)
        work.track(["sine"])
        with xr.open_dataset(work.out / "sine" / "track.nc") as track:
            doubts.append(track.attrs["doubts"])
    assert doubts[0] and not doubts[1]
