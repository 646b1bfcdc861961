"""The house rules that a machine can check: lint, types, and who may import whom."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.types_checked import types_checked

_TOOLS = {
    "ruff": ["-m", "ruff", "check", "."],
    "import-linter": ["-c", "from importlinter.cli import lint_imports_command as lint; lint()"],
}


@pytest.mark.parametrize("tool", _TOOLS)
def test_the_tool_finds_nothing(tool: str, root: Path) -> None:
    result = subprocess.run([sys.executable, *_TOOLS[tool]], cwd=root, capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-2000:]


def test_the_type_checker_finds_nothing(root: Path) -> None:
    code, said = types_checked(root)
    assert code == 0, said[-4000:]


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


def _unexplained(path: Path) -> Iterator[str]:
    """Numbers that a module names without a word on what they are: beside them, above them, or above their group."""
    lines = path.read_text(encoding="utf-8").splitlines()
    for node in ast.parse("\n".join(lines)).body:
        if not isinstance(node, ast.Assign) or not ast.unparse(node.targets[0]).strip("(_").split("_")[0].isupper():
            continue
        if any(isinstance(part, ast.Call | ast.Lambda) for part in ast.walk(node)):
            continue
        numbers = [
            part for part in ast.walk(node) if isinstance(part, ast.Constant) and type(part.value) in (int, float)
        ]
        group = node.lineno - 1
        while group > 0 and lines[group - 1].strip():
            group -= 1
        if (
            numbers
            and not any("#" in line for line in lines[group : node.end_lineno])
            and '"""' not in lines[node.end_lineno]
        ):
            yield f"{path.name}:{node.lineno}: {lines[node.lineno - 1]}"


@pytest.mark.parametrize("room", ["artefacts", "calibration", "campaign", "cli", "critique", "distributed", "drive", "dynamics",
                                  "effects", "export", "figures", "fitting", "options", "readers", "report", "stages", "sync",
                                  "twin", "workbench"])  # fmt: skip
def test_every_number_with_a_name_says_what_it_is(root: Path, room: str) -> None:
    assert [found for path in (root / "rfea_vision" / room).rglob("*.py") for found in _unexplained(path)] == []


def _undocumented(root: Path) -> Iterator[str]:
    """Public classes, functions and methods without a docstring, but methods that a class of the package declares with one."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted((root / "rfea_vision").rglob("*.py"))}
    classes = {node.name: node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}

    def declared(kind: ast.ClassDef, name: str) -> bool:
        bases = [classes[base] for base in map(ast.unparse, kind.bases) if base in classes]
        own = (part for base in bases for part in base.body if getattr(part, "name", "") == name)
        return any(map(ast.get_docstring, own)) or any(declared(base, name) for base in bases)  # type: ignore[arg-type]

    def of(node: ast.Module | ast.ClassDef, where: str) -> Iterator[str]:
        for part in node.body:
            if not isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) or part.name.startswith("_"):
                continue
            if not ast.get_docstring(part) and not (isinstance(node, ast.ClassDef) and declared(node, part.name)):
                yield f"{where}:{part.lineno} {part.name}"
            if isinstance(part, ast.ClassDef):
                yield from of(part, where)

    for path, tree in trees.items():
        yield from of(tree, str(path.relative_to(root)))


def test_everything_public_says_what_it_is(root: Path) -> None:
    assert list(_undocumented(root)) == []


def _pins(root: Path) -> list[str]:
    files = ("requirements.txt", "requirements-dev.txt")
    return [line for file in files for line in (root / file).read_text(encoding="utf-8").splitlines()]


TOP_LEVEL = {
    *(".ci", ".dockerignore", ".gitignore", "CHANGELOG.md", "CITATION.cff", "Containerfile", "LICENSE", "Makefile", "README.md"),
    *("SECURITY.md", "benchmarks", "calib", "docs", "examples", "hatch_build.py", "mkdocs.yml", "pipelines", "pyproject.toml"),
    *("requirements-dev.lock", "requirements-dev.txt", "requirements-docs.txt", "requirements.lock", "requirements.txt"),
    *("rfea_vision", "testing", "tests"),
}


def test_nothing_else_stands_at_the_top_level(root: Path) -> None:
    """Results of runs had slipped in there once."""
    if shutil.which("git") is None:
        pytest.skip("no git here")
    listed = subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True, timeout=60)
    if listed.returncode:
        pytest.skip(f"not a clone that git lists here: {listed.stderr.strip()}")
    assert {name.split("/")[0] for name in listed.stdout.splitlines()} == TOP_LEVEL


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
