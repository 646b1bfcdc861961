"""Small campaigns of a coarse twin, each made once for all tests of the critique."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import pytest

from rfea_vision import open_campaign
from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.twin import TwinOptions, simulate
from tests.once import made_once

Campaign = tuple[dict[str, Recording], Actuator]


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Campaign]:
    """Recordings of a short campaign with the given effect hidden in it."""

    @cache
    def make(
        hidden: tuple[tuple[str, float], ...] = (), bends: str = "left", roles: str = "train validate"
    ) -> Campaign:
        options = TwinOptions(
            hidden=dict(hidden),
            seed=7,
            roles=tuple(roles.split()),
            duration_s=2.0,
            rate_Hz=120.0,
            joints=10,
            actuator=Actuator(bends=bends),  # type: ignore[arg-type]
            sync="common_clock",
            write_truth=False,
        )
        name = "-".join([*(f"{key}={value}" for key, value in hidden), bends, *roles.split()])
        return made_once(tmp_path_factory, name, partial(_simulated, options))

    return make


def _simulated(options: TwinOptions, folder: Path) -> Campaign:
    simulate(folder / "tube", options)
    found = open_campaign(folder / "tube").sync()
    return {name: Recording(r.dataset.load()) for name, r in found.items()}, options.actuator
