from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from rfea_vision.artefacts import Actuator, Recording
from tests.once import made_once


@pytest.fixture(scope="session")
def complete_campaign(tmp_path_factory) -> tuple[dict[str, Recording], Actuator, Mapping[str, Any]]:
    """Two training runs and a validation run of the twin, nothing hidden, white noise of 0.06 mm."""
    pytest.importorskip("mujoco", reason="the twin needs MuJoCo: pip install 'rfea-vision[twin]'")
    return made_once(tmp_path_factory, "complete", _complete)


def _complete(folder: Path) -> tuple[dict[str, Recording], Actuator, Mapping[str, Any]]:
    from rfea_vision.stages import open_campaign
    from rfea_vision.twin import TwinOptions, simulate

    options = TwinOptions(roles=("train", "train", "validate"), duration_s=3.0, rate_Hz=120, seed=5)
    truth = simulate(folder / "complete", options)
    work = open_campaign(folder / "complete")
    recordings = work.recordings("train", "validate", "test")
    return (
        {name: Recording(item.dataset.load()) for name, item in recordings.items()},
        work.campaign.actuator,
        truth,
    )


@pytest.fixture(scope="session")
def exact(tmp_path_factory):
    """Noise-free runs of a chain that the model matches joint by joint, and the seven parameters behind them."""
    pytest.importorskip("mujoco", reason="the twin needs MuJoCo: pip install 'rfea-vision[twin]'")
    from tests.fitting.runs import exact_runs

    return made_once(tmp_path_factory, "exact", exact_runs)
