"""A few hundred damaged and made up files: a number that is right, or one sentence (``benchmarks/fuzzing.py`` reads 22,000)."""

from __future__ import annotations

import random

import numpy as np
import pytest

from rfea_vision.campaign import read_campaign
from rfea_vision.errors import InputError
from rfea_vision.files import write_text
from rfea_vision.readers.tracks import read_track
from rfea_vision.readers.video import open_frames
from rfea_vision.stages.cache import StageCache
from testing.damage.bombs import NAMES, bombs
from testing.damage.files import targets
from testing.damage.watched import Shard, Watched
from testing.damage.worker import content_of, given
from testing.written import MARKS, write_movement, write_sleap


def test_whatever_a_file_holds_is_read_or_refused_in_a_sentence(tmp_path):
    made_up = dict(bombs())
    assert tuple(made_up) == NAMES
    became: list[str] = []
    for target in targets(tmp_path):
        bomb = random.Random(target.name).choice(NAMES)
        for what in (
            "as it is",
            f"bomb {bomb}",
            *(f"{kind} {number}" for kind in ("bytes", "values") for number in range(2)),
        ):
            ended, fault = given(target, content_of(target, what, tmp_path, made_up), tmp_path)
            assert not fault, f"{target.name}, {what}: {fault}"
            assert what != "as it is" or ended == "accepted", target.name
            became.append(ended)
    assert len(became) > 200 and became.count("accepted") > 50 and became.count("refused") > 60


@pytest.mark.study
def test_the_watch_sees_a_process_that_ends_and_goes_on():
    watched, shard = Watched(), Shard("log csv", apart=False, number=0)
    try:
        watched.read(shard, ["as it is"])
        assert watched.process is not None
        watched.process.kill()
        watched.process.wait()
        watched.read(shard, ["bytes 1", "bytes 2"])
    finally:
        watched.end()
    assert shard.inputs == 3 and shard.accepted + shard.refused == 3


def test_times_that_are_no_numbers_are_no_times(tmp_path):
    import h5py

    spec = write_movement(tmp_path)
    with h5py.File(spec.file, "r+") as file:
        file["time"][7] = np.nan
    with pytest.raises(InputError, match="time, row 8: is not finite"):
        read_track(spec.file, spec=spec.keys.model_copy(update={"points": ["clamp", "tip"]}))


def test_marks_at_the_end_of_the_world_are_gaps(tmp_path):
    import h5py

    spec = write_sleap(tmp_path)
    named = spec.keys.model_copy(update={"points": list(MARKS)})
    with h5py.File(spec.file, "r+") as file:
        file["tracks"][0, 1, 2, 5], file["tracks"][0, 0, 1, 6] = 1e300, np.inf
    track = read_track(spec.file, spec=named)
    assert np.flatnonzero(~track.valid).tolist() == [5, 6]
    with h5py.File(spec.file, "r+") as file:
        file["tracks"][0, 1, 0, :] = np.inf
    with pytest.raises(InputError, match="at the clamp, is seen in no frame"):
        read_track(spec.file, spec=named)


def test_names_that_no_disk_can_hold(tmp_path):
    long = "9" * 5000
    (tmp_path / "times.csv").write_text(f"file,time_s\n{long},0\n")
    with pytest.raises(InputError, match=r"named in times\.csv but not there"):
        open_frames(tmp_path, tmp_path / "times.csv")
    cache = StageCache(tmp_path)
    write_text(cache.folder / "fit@base.json", f'{{"key": "fit/base", "digest": "0", "outputs": {{"{long}": "0"}}}}')
    assert not cache.is_fresh("fit/base", "0")


@pytest.mark.parametrize("key", ["~", "1", "[a]", "2026-01-01"])
def test_a_key_that_is_no_text_is_a_problem(tmp_path, key):
    (tmp_path / "campaign.yaml").write_text(f"name: x\n? {key}\n: y\n")
    assert any(problem.severity == "error" for problem in read_campaign(tmp_path).problems)
