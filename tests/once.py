"""What several files of tests need and none changes: made by the first process that asks, read by the others."""

from __future__ import annotations

import fcntl
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

Made = TypeVar("Made")


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], Made]) -> Made:
    """What `make` returns for an empty folder, made once a test run whatever the number of workers.

    Everybody gets a copy of its own, read back from a file. What lies in the folder is everybody's: a test that writes there takes
    a copy first. Where making it fails, whoever asks next tries again, in a folder of its own.

    name : of the thing made; the same name is the same thing
    """
    base = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent  # that of all workers
    kept = base / f"once-{name}.pickle"
    with (base / f"once-{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            made = pickle.dumps(make(factory.mktemp(name)))
            kept.with_suffix(".part").write_bytes(made)
            kept.with_suffix(".part").rename(kept)
    return pickle.loads(kept.read_bytes())
