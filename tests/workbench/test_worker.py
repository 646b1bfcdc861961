"""The process beside the page does what the command line would."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from rfea_vision.stages import mechanics
from rfea_vision.workbench.worker import run_job


@pytest.mark.parametrize("asked", [{"model": "base"}, {}])
@pytest.mark.parametrize("do", ["diagnose", "propose"])
def test_a_job_names_its_model_as_the_command_does(fitted, monkeypatch, do, asked):
    told: list[Any] = []

    def stage(work: Any, model: str, *_: Any, **__: Any) -> SimpleNamespace:
        told.append(model)
        return SimpleNamespace(value=None, file="law.py", sentence="")

    monkeypatch.setattr(mechanics, do, stage)
    run_job({"do": do, "campaign": str(fitted), "options": asked}, print)
    assert told == ["base"]
