"""Workers that are not what a batch needs are named in one sentence, before anything runs."""

from __future__ import annotations

import logging
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("distributed")

from rfea_vision.distributed import batch, cluster
from rfea_vision.distributed.tasks import Settings, fingerprint
from rfea_vision.errors import DataError, InputError


class Scheduler:
    """One worker, that gives this answer to the question which version it runs and which folders it does not see."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def scheduler_info(self, n_workers: int) -> dict[str, Any]:
        return {"workers": {"tcp://10.0.0.7:1": {}} if self.answer is not None else {}}

    def run(self, look: Any, on_error: str) -> dict[str, Any]:
        return {"tcp://10.0.0.7:1": self.answer if self.answer != "asked" else look()}


class Task:
    """One that ends well."""

    def result(self) -> None:
        return None


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (("0.5.0 (abc)", []), r"10\.0\.0\.7:1 runs rfea-vision 0\.5\.0 \(abc\), here it is .*; install the same"),
        (("", []), "has no rfea-vision of this kind; install"),
        ("asked", "does not see /nowhere/at/all; mount the folder there"),
        (OSError("lost"), r"does not answer \(lost\)"),
        (None, "it has no workers; start some with 'dask worker tcp://a:1'"),
    ],
)
def test_a_worker_that_will_not_do_is_named(answer, says, monkeypatch):
    monkeypatch.setattr(cluster, "_ANSWER_S", 0.2)
    with pytest.raises(InputError, match=says):
        cluster._check_workers(Scheduler(answer), "tcp://a:1", [Path("/nowhere/at/all")])  # type: ignore[arg-type]


def test_one_that_will_do_is_taken(tmp_path):
    cluster._check_workers(Scheduler((fingerprint(), [])), "tcp://a:1", [tmp_path])  # type: ignore[arg-type]
    cluster._check_workers(Scheduler("asked"), "tcp://a:1", [tmp_path])  # type: ignore[arg-type]


def test_only_folders_that_are_here_are_asked_for(tmp_path, monkeypatch):
    """What is missing here, or is a file among the folders, is a campaign that fails, not a worker's fault."""
    asked: list[Path] = []
    monkeypatch.setattr(cluster, "_connected", lambda *_: nullcontext())
    monkeypatch.setattr(cluster, "_check_workers", lambda client, scheduler, folders: asked.extend(folders))
    (tmp_path / "notes.txt").touch()
    with cluster.dask_client("tcp://a:1", folders=[tmp_path, tmp_path / "notes.txt", tmp_path / "nowhere"]):
        assert asked == [tmp_path]


def test_files_that_are_named_are_asked_for_and_reach_workers_by_their_whole_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yaml").write_text("steps: [sync]\n")
    asked: list[Path] = []
    monkeypatch.setattr(cluster, "_connected", lambda *_: nullcontext())
    monkeypatch.setattr(cluster, "_check_workers", lambda client, scheduler, needed: asked.extend(needed))
    with cluster.dask_client("tcp://a:1", folders=[tmp_path], files=[Path("own.yaml")]):
        assert asked == [tmp_path, Path("own.yaml")]
    with pytest.raises(InputError, match=r"does not see .*absent\.yaml"):
        monkeypatch.undo()
        cluster._check_workers(Scheduler("asked"), "tcp://a:1", [tmp_path, tmp_path / "absent.yaml"])  # type: ignore[arg-type]
    monkeypatch.chdir(tmp_path)
    told: list[Settings] = []
    monkeypatch.setattr(batch._Batch, "run", lambda self: told.append(self.settings) or [])
    batch.run_batch([], client=None, recipe="own.yaml", effect_files=[Path("own.py")])  # type: ignore[arg-type]
    assert told[0].recipe == str(tmp_path / "own.yaml")
    assert told[0].effect_files == (str(tmp_path / "own.py"),)
    batch.run_batch([], client=None, recipe="default")  # type: ignore[arg-type]
    assert told[1].recipe == "default"


def test_a_campaign_that_goes_while_its_camera_is_calibrated_ends_nothing(tmp_path, monkeypatch):
    """Its runs are known from the first reading; the task of each says what has gone."""
    run = SimpleNamespace(name="steps", role="train")
    found = SimpleNamespace(camera=object(), experiments=[run, SimpleNamespace(name="aside", role="ignore")])
    readings = iter([SimpleNamespace(campaign=found)])
    monkeypatch.setattr("rfea_vision.campaign.read_campaign", lambda *_, **__: next(readings))
    client = SimpleNamespace(submit=lambda *_, **__: Task())
    settings = Settings(fingerprint(), "", False, False, ())
    work = batch._Batch([tmp_path], None, client, settings, None)  # type: ignore[arg-type]
    work._begin(0)
    (future,) = work.pending
    work._heard(future, *work.pending.pop(future))
    assert [what for _, what in work.pending.values()] == ["measure steps"]


@pytest.mark.parametrize(
    ("own", "without_s", "given_up"), [(False, 20, False), (False, 60, True), (True, 60, False), (True, 900, True)]
)
def test_workers_of_this_machine_may_take_their_time_to_come_back(own, without_s, given_up):
    here = SimpleNamespace(workers={}, worker_spec={}) if own else None
    client = SimpleNamespace(status="running", cluster=here, scheduler_info=Scheduler(None).scheduler_info)
    settings = Settings(fingerprint(), "", False, False, ())
    run = batch._Batch([], None, client, settings, None)  # type: ignore[arg-type]
    run.seen_workers -= without_s
    with pytest.raises(DataError, match="all workers have gone") if given_up else nullcontext():
        run._look_after()


def test_a_worker_that_dask_gave_up_is_started_again():
    from distributed import Status

    workers = {0: SimpleNamespace(status=Status.failed), 1: SimpleNamespace(status=Status.running)}
    asked: list[int] = []
    here = SimpleNamespace(workers=workers, worker_spec=dict(workers), scale=asked.append)
    cluster.start_again(SimpleNamespace(cluster=here))  # type: ignore[arg-type]
    assert list(here.workers) == [1] and asked == [2]
    cluster.start_again(SimpleNamespace(cluster=None))  # type: ignore[arg-type]  # of others: theirs to start


@pytest.mark.parametrize("workers", [1, 2, 8])
def test_all_workers_together_have_the_memory_of_the_machine(workers):
    from distributed.system import MEMORY_LIMIT
    from distributed.worker_memory import parse_memory_limit

    share = cluster.share_of_memory("auto", workers)
    limit = parse_memory_limit(share, 1, logger=logging.getLogger("test"))
    assert limit == pytest.approx(MEMORY_LIMIT / workers, rel=1e-6)
    assert cluster.share_of_memory("2GB", workers) == "2GB"
