"""What the tests of all rooms share."""

from __future__ import annotations

import os
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from rfea_vision.readers.apart import isolated
from tests.types_checked import TypeCheck

ROOT = Path(__file__).resolve().parent.parent
_TYPES: pytest.StashKey[TypeCheck] = pytest.StashKey()


def pytest_configure(config: pytest.Config) -> None:
    """Compile the engine before there are workers: each of them would compile it, for all it knows.

    That keeps one core busy for over a minute. Where all tests are asked for, the type checker is at work on the other meanwhile,
    which takes as long; its test waits for what it found.
    """
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        if config.args_source is not pytest.Config.ArgsSource.ARGS and config.option.markexpr != "study":
            config.stash[_TYPES] = TypeCheck.begin(ROOT)
        for module in ("simulation", "inverse", "realtime"):
            import_module(f"rfea_vision.dynamics.{module}")


def pytest_unconfigure(config: pytest.Config) -> None:
    """Let nothing run on, nor lie about."""
    if _TYPES in config.stash:
        config.stash[_TYPES].end()


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real data made by others, beside the checkout; never copied into it."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        reason = "real data is not here: it is expected in ../shared/data beside the checkout"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    return folder


@pytest.fixture(autouse=True)
def nothing_left_on() -> Iterator[None]:
    """No test, and no command that it runs, leaves this process reading in another one: tests of the same worker would."""
    yield
    assert not isolated(), "still reading in a process of its own"


#: Files that take long (more than 15 s of processor time, the last four about 10 s): they go first, so that no core waits for the
#: last of them. The one that compiles the vision begins beside the type checker, and those that would compile it, too, come when
#: that is done.
LONG = (
    "test_contracts.py",
    "test_tracking.py",
    "test_docs_run.py",
    "test_body.py",
    "test_campaign.py",
    "test_hidden_effects.py",
    "test_pointing.py",
    "test_sync_films.py",
    "test_real_pictures.py",
    "test_in_chromium.py",
    "test_adding.py",
    "test_recordings.py",
    "test_agreement.py",
    "test_reproduce.py",
    "test_board_photos.py",
    "test_earlier.py",
    "test_clamped_beam.py",
    "test_rigs.py",
    "test_climbing.py",
    "test_paper.py",
    "test_resume.py",
    "test_gravity.py",
    "test_plant.py",
    "test_hostile.py",
    "test_guard.py",
    "test_page.py",
    "test_fuzzing.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the files: the long ones first."""
    items.sort(key=lambda item: LONG.index(item.path.name) if item.path.name in LONG else len(LONG))
