"""The process beside the page does what the command line would."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rfea_vision.artefacts import Correction, Hints
from rfea_vision.campaign.specs import CameraSpec
from rfea_vision.errors import DataError
from rfea_vision.stages import mechanics
from rfea_vision.workbench import trying
from rfea_vision.workbench.orders import order
from rfea_vision.workbench.worker import run_job


@pytest.mark.parametrize("asked", [{"model": "base"}, {}, {"model": "base", "effect_files": [__file__]}])
@pytest.mark.parametrize("do", ["diagnose", "propose"])
def test_a_job_names_its_model_as_the_command_does(fitted, monkeypatch, do, asked):
    told: list[Any] = []

    def stage(work: Any, model: str, *_: Any, **__: Any) -> SimpleNamespace:
        told.append(model)
        return SimpleNamespace(value=None, file="law.py", sentence="")

    monkeypatch.setattr(mechanics, do, stage)
    options, command = order("tube-A", None, do, asked)
    run_job({"do": do, "campaign": str(fitted), "options": options}, print)
    assert (f"--effect-file {__file__}" in command) == ("effect_files" in asked)
    assert told == ["base"]


@dataclass(frozen=True)
class Filmed:
    """What a trial asks of an experiment."""

    video: str
    camera: CameraSpec


def test_the_first_seconds_of_a_film_are_those_after_its_first_frame(monkeypatch):
    times_s, counts, corrected = 100 + np.arange(300) / 30, [], []
    again = tuple(Correction(frame, ((1.0, 2.0),)) for frame in (10, 40, 200))
    experiment = Filmed("film", CameraSpec(hints=Hints(corrections=again)))
    campaign = SimpleNamespace(experiment=lambda name: experiment)
    work = SimpleNamespace(campaign=campaign, calibration_of=lambda item: SimpleNamespace(value=None))
    source = SimpleNamespace(
        path=Path("frames"), size=(640, 480), rate_Hz=None, quarter_turns=0, times_s=lambda: times_s
    )

    def follow(item: Filmed, calibration: Any, piece: trying.FirstFrames) -> None:
        counts.append(len(piece.times_s()))
        corrected.append([later.frame for later in item.camera.hints.corrections])
        raise DataError("there is no tube")

    stubs = {"open_campaign": lambda *_: work, "open_source": lambda video: source, "follow": follow}
    for name, stub in (stubs | dict.fromkeys(("camera_vector", "matched_to"), lambda *_: None)).items():
        monkeypatch.setattr(trying, name, stub)
    with pytest.raises(DataError, match="no tube"):
        trying.try_hints(Path("campaign"), None, print, name="run", seconds=2.0)
    assert counts == [24, 60] and corrected == [[10], [10, 40]]
