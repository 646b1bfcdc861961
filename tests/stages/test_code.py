"""A stage's source follows from its imports: what a result depends on counts, and nothing else."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rfea_vision.stages import cameras, code, measurement, mechanics, publishing


def made_by(stage: Callable[..., Any]) -> Callable[..., Any]:
    """Stand in for the function `make` inside a stage: what counts of it is its file and its name."""
    inner = next(item for item in stage.__code__.co_consts if getattr(item, "co_name", "") == "make")

    def make() -> None: ...

    make.__code__, make.__qualname__ = inner.replace(co_freevars=()), f"{stage.__name__}.<locals>.make"
    return make


def modules(stage: Callable[..., Any]) -> set[str]:
    return {name.removeprefix("rfea_vision.") for name in code._read(*code._place(stage))[1]}


@pytest.mark.parametrize(
    ("stage", "needs", "not_"),
    [
        (measurement.synchronise, {"stages.earlier", "readers.pressure", "sync.motion"}, {"vision", "fitting"}),
        (cameras.calibrate, {"calibration.bundle", "calibration.thumbnails"}, {"vision", "sync", "dynamics"}),
        (mechanics._fitted, {"fitting.solver", "effects.maxwell", "dynamics.system", "critique.torque"}, {"vision", "report"}),
        (publishing.report, {"report.page"}, {"vision", "dynamics", "fitting"}),
    ],
)  # fmt: skip
def test_what_a_stage_depends_on(stage: Callable[..., Any], needs: set[str], not_: set[str]) -> None:
    found = modules(made_by(stage) if stage is not mechanics._fitted else stage)
    assert needs <= found
    assert not {name.partition(".")[0] for name in found} & not_


REMEMBERED = (code._hash, code._read, code._imports, code._file, code._resolved)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    root = tmp_path / "rfea_vision"
    (root / "law" / "__pycache__").mkdir(parents=True)
    (root / "stages").mkdir()
    files = {
        "law/__init__.py": "",
        "law/base.py": "from rfea_vision.units import mm\n",
        "law/other.py": "x = 1\n",
        "units.py": "mm = 1e-3\n",
        "stages/work.py": "from rfea_vision.law import base, other\n\ndef fit(law: other.Law):\n    return helped()\n\n"
        "def helped():\n    return base.mm\n\ndef report():\n    return other.x\n",
    }
    for name, text in files.items():
        (root / name).write_text(text)
    monkeypatch.setattr(code, "_PACKAGE", root)
    yield root
    for memory in REMEMBERED:
        memory.cache_clear()


def stage_of(root: Path, name: str) -> Callable[..., Any]:
    for memory in REMEMBERED:
        memory.cache_clear()
    space: dict[str, Any] = {}
    file = root / "stages" / "work.py"
    exec(compile(f"def {name}(): ...", str(file), "exec"), space)
    return space[name]


@pytest.mark.parametrize(
    ("file", "text", "counts"),
    [
        ("law/base.py", "from rfea_vision.units import mm\nk = 2\n", True),
        ("units.py", "mm = 2e-3\n", True),
        ("law/table.csv", "1,2\n", True),
        ("law/other.py", "x = 2\n", False),  # named in an annotation alone
        ("law/__pycache__/base.nbi", "compiled", False),
        ("law/base.nbc", "compiled", False),
    ],
)
def test_only_what_is_imported_counts(package: Path, file: str, text: str, counts: bool) -> None:
    before = code.code_of(stage_of(package, "fit")), code.code_of(stage_of(package, "report"))
    (package / file).write_text(text)
    assert (code.code_of(stage_of(package, "fit")) != before[0]) is counts


def test_a_stage_s_own_lines_count_and_its_comments_do_not(package: Path) -> None:
    before = code.code_of(stage_of(package, "fit"))
    work = package / "stages" / "work.py"
    work.write_text(work.read_text().replace("def helped():", "def helped():  # in plain words"))
    assert code.code_of(stage_of(package, "fit")) == before
    work.write_text(work.read_text().replace("return base.mm", "return 2 * base.mm"))
    assert code.code_of(stage_of(package, "fit")) != before


def test_what_a_stage_holds_is_not_kept_with_its_hash() -> None:
    def stage_with(track: set[int]) -> Callable[..., Any]:
        def make() -> set[int]:
            return track

        return make

    track = {1}
    gone = weakref.ref(track)
    code.code_of(stage_with(track))
    del track
    gc.collect()
    assert gone() is None
