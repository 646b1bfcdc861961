"""The house rules that a machine can check: lint, types, and who may import whom."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

_TOOLS = {
    "ruff": ["-m", "ruff", "check", "."],
    "basedpyright": ["-m", "basedpyright", "--pythonpath", sys.executable],
    "import-linter": ["-c", "from importlinter.cli import lint_imports_command as lint; lint()"],
}


@pytest.mark.parametrize("tool", _TOOLS)
def test_the_tool_finds_nothing(tool: str, root: Path) -> None:
    result = subprocess.run([sys.executable, *_TOOLS[tool]], cwd=root, capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-2000:]


def test_only_the_command_line_prints(root: Path) -> None:
    # the rest of the package returns values and calls progress
    found = [
        f"{path.relative_to(root)}:{number}"
        for path in sorted((root / "rfea_vision").rglob("*.py"))
        if "cli" not in path.relative_to(root).parts
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if line.strip().startswith("print(")
    ]
    assert found == []


@pytest.mark.parametrize(
    ("room", "others"), [("tests", "benchmarks"), ("benchmarks", "tests"), ("testing", "tests|benchmarks")]
)
def test_tests_and_benchmarks_share_a_room_and_not_each_other(root: Path, room: str, others: str) -> None:
    found = re.compile(rf"^\s*(from|import) ({others})\b", re.MULTILINE)
    files = [path for path in (root / room).rglob("*.py") if found.search(path.read_text(encoding="utf-8"))]
    assert files == []


def _pins(root: Path) -> list[str]:
    files = ("requirements.txt", "requirements-dev.txt")
    return [line for file in files for line in (root / file).read_text(encoding="utf-8").splitlines()]


def test_pins_name_no_index(root: Path) -> None:
    for line in _pins(root):
        if not line.startswith(("#", "--requirement ")):
            name, separator, version = line.partition("==")
            assert name and separator and version and "/" not in line, line


def test_every_dependency_is_pinned_and_explained(root: Path) -> None:
    import tomllib

    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [
        *project["dependencies"],
        *(item for group in project["optional-dependencies"].values() for item in group),
    ]
    pins = _pins(root)
    versions = {canonicalize_name(line.partition("==")[0]): line.partition("==")[2] for line in pins if "==" in line}
    explained = (root / "docs" / "architecture.md").read_text(encoding="utf-8").lower()
    for text in wanted:
        requirement = Requirement(text)
        assert requirement.specifier.contains(versions[canonicalize_name(requirement.name)]), text
        assert requirement.name.lower() in explained, f"docs/architecture.md gives no reason for {requirement.name}"
