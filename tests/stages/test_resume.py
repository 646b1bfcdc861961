"""An interrupted climb goes on from its last finished rung, as a person sees it: files kept, nothing fitted twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rfea_vision import open_campaign
from rfea_vision.artefacts import Ladder
from rfea_vision.critique import ladder as climbing
from rfea_vision.stages import mechanics
from rfea_vision.twin import TwinOptions, simulate
from rfea_vision.units import rounded

CHOICES = {"segments": 4, "starts": 0}


def test_an_interrupted_improve_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = TwinOptions(
        hidden={"gravity_tilt.angle": -0.08},
        seed=7,
        roles=("train", "validate"),
        duration_s=2.0,
        rate_Hz=120.0,
        joints=10,
        sync="common_clock",
        write_truth=False,
    )
    simulate(tmp_path / "tube", options)
    judge = climbing.judge
    judged: list[tuple[str, ...]] = []

    def interrupted(problem: Any, fitted: Any, **given: Any) -> Any:
        judged.append(fitted.options.effects)
        if len(judged) == 2:
            raise KeyboardInterrupt
        return judge(problem, fitted, **{**given, "candidates": ["gravity_tilt", "payload"]})

    monkeypatch.setattr(climbing, "judge", interrupted)
    with pytest.raises(KeyboardInterrupt):
        open_campaign(tmp_path / "tube").improve(**CHOICES)
    kept = Ladder.load(tmp_path / "tube" / "rfea" / "ladder.json")
    assert [rung.model for rung in kept.rungs] == ["base"] and kept.stopped_because == "not finished"

    monkeypatch.setattr(climbing, "fit", lambda *_: pytest.fail("the base model is fitted already"))
    with monkeypatch.context() as saving:
        saving.setattr(mechanics, "save_diagnosis", _interrupt)
        with pytest.raises(KeyboardInterrupt):
            open_campaign(tmp_path / "tube").improve(**CHOICES)
    noted = [path.name for path in (tmp_path / "tube" / "rfea" / ".stages").glob("*@base+gravity_tilt.json")]
    assert noted == [], "a rung is noted whole: what is noted is not done again"

    ladder = open_campaign(tmp_path / "tube").improve(**CHOICES)
    assert judged == [(), *3 * [("gravity_tilt",)]], "the first rung is not judged again"
    assert [rung.added for rung in ladder.rungs] == [None, "gravity_tilt"]
    assert ladder.rungs[-1].verdict == "complete"
    told = rounded(ladder.rungs[-1].error("validate"))
    assert f"the held-out error is {told} mm" in ladder.stopped_because, "one figure of one error"


def _interrupt(*_: Any) -> None:
    raise KeyboardInterrupt
