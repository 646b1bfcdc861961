"""What the tests of all rooms share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


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
