"""What the documents say is so: commands exist, options are spelt right, examples load."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
import yaml

from rfea_vision.campaign.schema import CampaignFile, ExperimentFile
from rfea_vision.cli.root import _HOME_OF, rfea
from rfea_vision.effects.catalogue import catalogue
from rfea_vision.stages.recipes import Recipe
from rfea_vision.twin.options import HIDDEN, OUTSIDE

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, *languages: str) -> list[str]:
    """Return the code blocks of a page in one of these languages."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    return [text for language, text in found if language in languages]


def commands() -> list[tuple[str, str]]:
    """Return every command line of the documents that begins with rfea."""
    return [
        (page.name, line.split("#")[0].strip())
        for page in PAGES
        for block in blocks(page, "sh", "bash", "console")
        for line in block.splitlines()
        if line.strip().startswith("rfea ")
    ]


def test_there_are_commands_to_check():
    assert len([page for page, _ in commands() if page == "README.md"]) >= 10


@pytest.mark.parametrize(("page", "line"), commands())
def test_every_command_line_of_the_documents_parses(page, line):
    name, *arguments = shlex.split(line)[1:]
    root = click.Context(rfea, info_name="rfea", **rfea.context_settings)
    command = rfea.get_command(root, name)
    assert command is not None, f"{page}: {line}"
    command.make_context(name, arguments, parent=root)


def test_the_page_of_commands_is_what_the_commands_say():
    spec = importlib.util.spec_from_file_location("generate_docs", ROOT / "docs" / "generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    committed = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert committed == module.commands_page(), "run 'make docs' and commit docs/commands.md"


def test_what_the_twin_can_hide_is_what_the_page_says():
    """It said "every effect but segments", which is none, and left three out that the twin does not know."""
    page = (ROOT / "docs" / "example.md").read_text(encoding="utf-8")
    exceptions = re.search(r"Every effect of the catalogue \(`rfea effects`\) but (.*?), with", page, re.DOTALL)
    rows = re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)
    hidden = {key.split(".")[0] for key in HIDDEN}
    assert exceptions is not None and set(re.findall(r"`(\w+)`", exceptions[1])) == set(catalogue()) - hidden
    assert set(rows) == set(OUTSIDE)


def test_the_documents_build_as_a_site_that_asks_nobody(tmp_path):
    if importlib.util.find_spec("mkdocs") is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)(
            "mkdocs is not installed: pip install -r requirements-docs.txt"
        )
    words = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(tmp_path)]
    built = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert built.returncode == 0, built.stderr  # strict: a link that leads nowhere is an error
    navigation = (tmp_path / "index.html").read_text(encoding="utf-8")
    for page in sorted((ROOT / "docs").glob("*.md")):
        assert f"{page.stem}.html" in navigation, f"mkdocs.yml: nav does not name {page.name}"
    loaded = re.findall(
        r'(?:<script[^>]* src|<link[^>]* rel="stylesheet"[^>]* href|<img[^>]* src)="(https?:[^"]*)"', navigation
    )
    assert loaded == []


@pytest.mark.parametrize("name", _HOME_OF)
def test_every_command_is_documented(name):
    assert f"## rfea {name}" in (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")


def test_the_yaml_of_the_documents_is_valid():
    models = {"rfea-campaign/1": CampaignFile, "rfea-experiment/1": ExperimentFile, "rfea-recipe/1": Recipe}
    seen = []
    for page in PAGES:
        for block in blocks(page, "yaml"):
            content = yaml.safe_load(block)
            models[content["format"]].model_validate(content)
            seen.append(content["format"])
    assert set(seen) == set(models)


def test_every_key_of_the_files_is_explained():
    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    schema = ExperimentFile.model_json_schema()
    keys = {key for part in [schema, *schema["$defs"].values()] for key in part["properties"]}
    assert [key for key in sorted(keys) if not re.search(rf"\b{key}\b", text)] == []


def test_links_between_the_documents_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_rooms_of_the_house_are_on_the_plan():
    plan = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rooms = {path.name for path in (ROOT / "rfea_vision").iterdir() if path.is_dir() and path.name != "__pycache__"}
    files = {path.name for path in (ROOT / "rfea_vision").glob("*.py")} - {"__init__.py"}
    assert [room for room in sorted(rooms) if f"`{room}/`" not in plan] == []
    assert [file for file in sorted(files) if f"`{file}`" not in plan] == []
