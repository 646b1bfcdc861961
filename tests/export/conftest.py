import ctypes
import os

import pytest

from rfea_vision.export.fmu import build_library, compiler


@pytest.fixture(scope="session")
def cc():
    """A C compiler; where CI is set there must be one."""
    if compiler() is None:
        if os.environ.get("CI"):
            pytest.fail("no C compiler, and CI is set")
        pytest.skip("no C compiler here (cc, gcc or clang)")
    return compiler()[0]


@pytest.fixture
def compiled(cc, tmp_path):
    """Compile header and source, and load the library."""

    def load(header, source, name):
        (tmp_path / f"{name}.h").write_text(header)
        (tmp_path / f"{name}.c").write_text(source)
        build_library(tmp_path / f"{name}.c", tmp_path / f"{name}.so")
        return ctypes.CDLL(str(tmp_path / f"{name}.so"))

    return load
